"""The debridement recording of Mahler et al. 2014, Sec. V, made again: 303 reaches of a RAVEN-II to fragments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Arm, arm_named
from gpcorrect.sim.model import Model, preset
from gpcorrect.sim.plan import Plan, Segment, plan_of
from gpcorrect.sim.reaching import Pace, Workspace, joint_tour, tour, upright, working_posture
from gpcorrect.sim.record import simulate
from gpcorrect.sim.resolve import machine_of
from gpcorrect.sim.settings import TrackerFaults
from gpcorrect.types import CalibrationLog

__all__ = ["debridement_log", "debridement_plan"]

PRESET = "raven2_debridement"
REACHES = 303
REACHES_PER_RUN = 25  # then the arm goes home and rests
WORKSPACE_SIZE = (0.08, 0.08, 0.02)  # m, the last one vertical
TILT = np.deg2rad(25.0)
CROWDING = 1.9  # with it 303 reaches at 5 cm/s last the study's 24,000 samples
PACE = Pace(speed=0.05, acceleration=0.5, turn_rate=1.5)
REST_BETWEEN_RUNS = 10.0  # s


def debridement_log(
    seed: int = 0,
    *,
    reaches: int = REACHES,
    faults: bool = True,
    position_only: bool = False,
    model: Model | None = None,
) -> CalibrationLog:
    """Simulate the recording.

    Parameters
    ----------
    seed : int
        Of fragments, noise and faults.
    reaches : int
        How many; the study had 303.
    faults : bool
        Whether the tracker fails now and then.
    position_only : bool
        Leave the tracker's orientations out.
    model : Model, optional
        Another machine than the packaged `raven2_debridement`; all six joints of an arm.

    Returns
    -------
    CalibrationLog
        One trajectory a reach, 100 Hz. The tracker frame is the nominal base frame, registered by hand: the raw error
        between `tracker_cp` and `setpoint_cp` means something. The column `fault` holds the truth about tracker faults.
    """
    machine = machine_of(preset(PRESET) if model is None else model)
    if not faults:
        machine = replace(machine, faults=TrackerFaults())
    plan = debridement_plan(arm_named(machine.arm), reaches, machine.log_rate_hz, np.random.default_rng([seed, 1]))
    return simulate(machine, plan, seed, position_only=position_only)


def debridement_plan(arm: Arm, reaches: int, rate_hz: float, rng: np.random.Generator) -> Plan:
    """Reaches from home to a fragment and on from fragment to fragment, in runs of 25, one run after the other."""
    T_home = arm.forward(working_posture(arm))
    workspace = Workspace(
        se3.pose(upright(arm.gravity), T_home[:3, 3]), np.array(WORKSPACE_SIZE), T_home[:3, :3], TILT, CROWDING
    )
    segments, start = [], 0.0
    for first in range(0, reaches, REACHES_PER_RUN):
        numbers = list(range(first, min(first + REACHES_PER_RUN, reaches)))
        stops = np.concatenate([T_home[None], workspace.sample(arm, len(numbers), rng)])
        path = tour(stops, numbers, [PACE] * len(numbers), rate_hz)
        segments.append(Segment(joint_tour(arm, path), path.trajectory, start=start))
        start += len(path.trajectory) / rate_hz + REST_BETWEEN_RUNS
    return plan_of(segments, rate_hz)
