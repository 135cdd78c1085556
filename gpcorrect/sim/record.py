"""From a machine and a plan to a recording: what encoders, outside sensors and tracker wrote down."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.sim.faults import corrupted
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.plan import NOT_LOGGED, Plan
from gpcorrect.sim.plant import run
from gpcorrect.sim.sensors import Sensors
from gpcorrect.sim.settings import TrackerFaults
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, LogMeta, PoseSignal

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
        did to it (:class:`~gpcorrect.sim.faults.Fault`), when the machine's tracker has faults.
    """
    rng = np.random.default_rng(seed)
    outcome = run(machine, plan)
    readings = Sensors(machine, rng).read(outcome.motion, outcome.torque, outcome.q, outcome.T_base_tip)
    rows = _recorded(plan)
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


def _recorded(plan: Plan) -> tuple[IntArray, IntArray]:
    """Sample and run indices of the log's rows: run by run in the order of their clocks."""
    order = np.lexsort((plan.start, plan.session))
    run_index, sample = np.nonzero(plan.trajectory.T[order] != NOT_LOGGED)
    return sample, order[run_index]


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
