"""Recordings of random reaches: the small default for demonstrations and tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Arm, arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim.model import Model, preset
from gpcorrect.sim.plan import Plan, Segment, plan_of
from gpcorrect.sim.reaching import Pace, Workspace, joint_tour, tour, upright, working_posture
from gpcorrect.sim.record import simulate
from gpcorrect.sim.resolve import machine_of, rehomed
from gpcorrect.sim.settings import TrackerFaults
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

__all__ = ["random_reaches_log"]

REACHES_PER_RUN = 10
SIZE = np.array([0.06, 0.06, 0.04])  # m, the last one vertical
TILT = np.deg2rad(30.0)
SPEEDS = (0.02, 0.1)  # m/s, mean over a reach, drawn evenly on a logarithmic scale
PAUSE = 0.2  # s
RETURN_EVERY = 5  # every fifth reach goes straight back where the one before came from
REST_BETWEEN_RUNS = 10.0  # s


def random_reaches_log(
    arm: str = "raven2_left",
    n_trajectories: int = 40,
    seed: int = 0,
    *,
    sessions: int = 1,
    payloads: Sequence[float] = (),
    position_only: bool = False,
    faults: bool = True,
    model: Model | None = None,
) -> CalibrationLog:
    """Simulate minimum-jerk reaches to random poses, with pauses, reversals and different speeds.

    Parameters
    ----------
    arm : str
        "raven2_left", "raven2_right" or "dvrk_psm"; the packaged model of that name is used.
    n_trajectories : int
        Reaches, one trajectory each, over all sessions.
    seed : int
        Of targets, homings, noise and faults.
    sessions : int
        The arm is homed anew between sessions, which shifts its joints' zeros.
    payloads : sequence of float
        Payloads at the tip, kg, taken in turn by runs of ten reaches; the model's own when empty.
    position_only : bool
        Leave the tracker's orientations out.
    faults : bool
        Whether the tracker fails now and then.
    model : Model, optional
        Another machine, of all six joints of an arm; `arm` is then not used.

    Returns
    -------
    CalibrationLog

    Raises
    ------
    DataError
        There are more sessions than reaches, or the arm has no packaged model.
    """
    if not 1 <= sessions <= n_trajectories:
        raise DataError(f"{n_trajectories} reaches cannot fill {sessions} sessions.")
    rng = np.random.default_rng([seed, 2])
    machine = machine_of(rehomed(preset(arm) if model is None else model, sessions, rng))
    if not faults:
        machine = replace(machine, faults=TrackerFaults())
    plan = _random_reaches_plan(
        arm_named(machine.arm), n_trajectories, machine.log_rate_hz, rng, sessions=sessions, payloads=payloads
    )
    return simulate(machine, plan, seed, position_only=position_only)


def _random_reaches_plan(
    arm: Arm,
    n_trajectories: int,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    sessions: int = 1,
    payloads: Sequence[float] = (),
) -> Plan:
    """Plan runs of ten reaches around the arm's working posture, one after the other, shared among the sessions."""
    workspace = _workspace(arm)
    segments: list[Segment] = []
    for session, numbers in enumerate(np.array_split(np.arange(n_trajectories), sessions)):
        start = 0.0
        for first in range(0, len(numbers), REACHES_PER_RUN):
            q, labels = _run(arm, workspace, numbers[first : first + REACHES_PER_RUN].tolist(), rate_hz, rng)
            payload = payloads[len(segments) % len(payloads)] if payloads else None
            segments.append(Segment(q, labels, session, start, payload))
            start += len(q) / rate_hz + REST_BETWEEN_RUNS
    return plan_of(segments, rate_hz)


def _run(
    arm: Arm, workspace: Workspace, numbers: list[int], rate_hz: float, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    stops = workspace.sample(arm, len(numbers) + 1, rng)
    back = np.arange(RETURN_EVERY, len(stops), RETURN_EVERY)
    stops[back] = stops[back - 2]
    paces = [Pace(speed=float(np.exp(rng.uniform(*np.log(SPEEDS)))), law="minimum-jerk", pause=PAUSE) for _ in numbers]
    path = tour(stops, numbers, paces, rate_hz)
    return joint_tour(arm, path), path.trajectory


def _workspace(arm: Arm) -> Workspace:
    T = arm.forward(working_posture(arm))
    return Workspace(se3.pose(upright(arm.gravity), T[:3, 3]), SIZE, T[:3, :3], TILT)
