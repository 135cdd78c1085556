"""From a machine and a plan to a recording: what encoders, outside sensors and tracker wrote down, faults included."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from gpcorrect import se3
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.plan import NOT_LOGGED, Plan
from gpcorrect.sim.plant import run
from gpcorrect.sim.sensors import Sensors
from gpcorrect.sim.settings import TrackerFaults
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, LogMeta, PoseSignal

DROPOUT_LENGTH = 3.0  # samples in a row, on average; chosen by hand, as optical trackers lose a few at a time


class Fault(IntEnum):
    """Truth about a tracked sample: what, if anything, was done to it."""

    GOOD = 0
    LOST_FIDUCIAL = 1
    OCCLUSION_JUMP = 2
    OUTLIER = 3
    FLIP = 4
    DROPOUT = 5


def corrupted(
    T: FloatArray, rate_hz: float, faults: TrackerFaults, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """Let a tracker fail.

    Parameters
    ----------
    T : (n, 4, 4) array, tracked poses in recorded order
    rate_hz : float, of the samples
    faults : TrackerFaults
    rng : numpy.random.Generator

    Returns
    -------
    poses : (n, 4, 4) array, a missing sample is NaN
    code : (n,) int array, :class:`Fault` of each sample; a sample fails in one way only, the first of the list
    """
    poses, code = np.array(T), np.zeros(len(T), dtype=np.int64)
    for fault, events in _events(len(T), rate_hz, faults, rng):
        for start, stop in events:
            rows = np.arange(start, min(stop, len(T)))
            rows = rows[code[rows] == Fault.GOOD]
            poses[rows] = _failed(T[rows], fault, faults, rng)
            code[rows] = fault
    return poses, code


Event = tuple[int, int]


def _events(n: int, rate_hz: float, faults: TrackerFaults, rng: np.random.Generator) -> list[tuple[Fault, list[Event]]]:
    block = round(faults.lost_share * n)
    begin = int(rng.integers(0, n - block + 1))
    jumps = rng.poisson(faults.jumps_hz * n / rate_hz)
    mean_jump = max(1.0, faults.jump_seconds * rate_hz)
    return [
        (Fault.LOST_FIDUCIAL, [(begin, begin + block)] if block else []),
        (Fault.OCCLUSION_JUMP, _bursts(n, jumps, mean_jump, rng)),
        (Fault.OUTLIER, _bursts(n, rng.binomial(n, faults.outlier_share), 1.0, rng)),
        (Fault.FLIP, _bursts(n, rng.binomial(n, faults.flip_share), 1.0, rng)),
        (Fault.DROPOUT, _bursts(n, rng.binomial(n, faults.dropout_share / DROPOUT_LENGTH), DROPOUT_LENGTH, rng)),
    ]


def _bursts(n: int, count: int, mean_length: float, rng: np.random.Generator) -> list[Event]:
    starts = rng.integers(0, n, count)
    lengths = rng.geometric(1.0 / mean_length, count)
    return [(int(s), int(s + k)) for s, k in zip(starts, lengths, strict=True)]


def _failed(T: FloatArray, fault: Fault, faults: TrackerFaults, rng: np.random.Generator) -> FloatArray:
    """Poses of one event: a constant shift and turn, chance on each sample, half a turn, or nothing at all."""
    match fault:
        case Fault.LOST_FIDUCIAL:
            return _displaced(T, faults.lost_shift * _direction(rng), faults.lost_turn * _direction(rng))
        case Fault.OCCLUSION_JUMP:
            size = rng.uniform(0.5, 1.5)
            return _displaced(T, size * faults.jump_shift * _direction(rng), size * faults.jump_turn * _direction(rng))
        case Fault.OUTLIER:
            return _displaced(
                T,
                faults.outlier_shift * rng.standard_normal((len(T), 3)),
                faults.outlier_turn * rng.standard_normal((len(T), 3)),
            )
        case Fault.FLIP:
            return _displaced(T, np.zeros(3), np.pi * np.eye(3)[rng.integers(3)])
        case _:
            return np.full(T.shape, np.nan)


def _displaced(T: FloatArray, shift: FloatArray, turn: FloatArray) -> FloatArray:
    return se3.pose(T[:, :3, :3] @ se3.matrix_from_rotvec(turn), T[:, :3, 3] + shift)


def _direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


SIMULATED = "simulated"
"""What simulated logs name as their robot and tracker."""

SESSION_BREAK = 600.0  # s between the end of one session and the start of the next on the log's clock


def simulate(machine: Machine, plan: Plan, seed: int = 0, *, position_only: bool = False) -> CalibrationLog:
    """Let a machine follow a plan and record it.

    Parameters
    ----------
    machine : Machine
        Arm, drives, effects and sensors.
    plan : Plan
        Desired paths; only their recorded samples become rows.
    seed : int
        Of noise and faults; the same seed gives the same log.
    position_only : bool
        Leave the tracker's orientations out.

    Returns
    -------
    CalibrationLog
        Sessions and runs one after the other. Its `extra` column `fault` says of each tracked sample what the simulator
        did to it (:class:`~gpcorrect.sim.record.Fault`), when the machine's tracker has faults.
    """
    rng = np.random.default_rng(seed)
    outcome = run(machine, plan)
    readings = Sensors(machine, rng).read(outcome.motion, outcome.torque, outcome.q, outcome.T_base_tip)
    order = np.lexsort((plan.start, plan.session))  # the log's rows: run by run in the order of their clocks
    run_index, sample = np.nonzero(plan.trajectory.T[order] != NOT_LOGGED)
    rows = sample, order[run_index]
    q_set, q_measured = plan.q[rows], readings.measured_jp[rows]
    extra, tracker = {}, None
    if readings.T_tracker_marker is not None:
        T, code = corrupted(readings.T_tracker_marker[rows], plan.rate_hz, machine.faults, rng)
        tracker = _signal(T, position_only)
        if machine.faults != TrackerFaults():
            extra = {"fault": code.astype(np.float64)}
    payload = machine.payload(plan)[rows[1]]
    return CalibrationLog(
        time=_log_time(plan)[rows],
        trajectory=plan.trajectory[rows],
        session=plan.session[rows[1]],
        setpoint_cp=_nominal_pose(machine, q_set),
        measured_cp=_nominal_pose(machine, q_measured),
        tracker_cp=tracker,
        setpoint_jp=q_set,
        measured_jp=q_measured,
        measured_jv=readings.measured_jv[rows],
        measured_jf=readings.measured_jf[rows],
        external_jp=readings.external_jp[rows],
        payload=payload if payload.any() else None,
        extra=extra,
        meta=LogMeta(
            robot=SIMULATED, arm=machine.arm, joint_types=machine.body.types, tracker=SIMULATED, source="gpcorrect.sim"
        ),
        name=f"simulated {machine.arm}",
    )


def _log_time(plan: Plan) -> FloatArray:
    """Sample times `(n, N)` on one clock on which a session begins well after the one before."""
    times = plan.session_time
    ends = [times[:, plan.session == s].max(initial=0.0) + SESSION_BREAK for s in range(plan.session.max() + 1)]
    begins = np.concatenate([[0.0], np.cumsum(ends)[:-1]])
    shifted: FloatArray = times + begins[plan.session]
    return shifted


def _nominal_pose(machine: Machine, q: FloatArray) -> PoseSignal | None:
    T = machine.body.forward(q)
    return None if T is None else _signal(T)


def _signal(T: FloatArray, position_only: bool = False) -> PoseSignal:
    position, quaternion = se3.to_parts(T)
    return PoseSignal(position, None if position_only else quaternion)
