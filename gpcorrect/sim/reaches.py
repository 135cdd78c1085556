"""Recordings of reaches: the debridement of Mahler et al. 2014, Sec. V, and random ones for trying things out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import RemoteCentreArm
from gpcorrect.errors import DataError
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.model import Model, preset
from gpcorrect.sim.plan import Plan, Segment, payload_in_turn, plan_of
from gpcorrect.sim.reaching import Pace, Workspace, joint_tour, tour, upright, working_posture
from gpcorrect.sim.record import simulate
from gpcorrect.sim.resolve import machine_of, rehomed
from gpcorrect.sim.settings import TrackerFaults
from gpcorrect.types import CalibrationLog, FloatArray

REST_BETWEEN_RUNS = 10.0  # s; chosen by hand

# The study's recording: 303 reaches at 5 cm/s of 24,000 samples. What it does not state is chosen to be plausible.
DEBRIDEMENT_PRESET = "raven2_debridement"
DEBRIDEMENT_PACE = Pace(speed=0.05, acceleration=0.5, turn_rate=1.5)
REACHES = 303  # of the study
REACHES_BETWEEN_RESTS = 25  # then the arm goes home
DEBRIDEMENT_SIZE, DEBRIDEMENT_TILT = np.array([0.08, 0.08, 0.02]), np.deg2rad(25.0)  # m, the last one vertical; rad
CROWDING = 1.9  # of fragments around the middle: with it the reaches last the study's 24,000 samples

# Random reaches, all chosen by hand so that a short recording has reversals, rests and a ladder of speeds.
REACHES_PER_RUN = 10  # payloads change between runs
SIZE, TILT = np.array([0.06, 0.06, 0.04]), np.deg2rad(30.0)  # m, the last one vertical; rad
SPEEDS = (0.02, 0.1)  # m/s, mean over a reach, drawn evenly on a logarithmic scale
PAUSE = 0.2  # s
RETURN_EVERY = 5  # every fifth reach goes straight back where the one before came from


def debridement_log(
    seed: int = 0,
    *,
    reaches: int = REACHES,
    faults: bool = True,
    position_only: bool = False,
    model: Model | None = None,
) -> CalibrationLog:
    """Simulate the debridement recording: 303 reaches of a RAVEN-II to fragments.

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
    machine = machine_of(preset(DEBRIDEMENT_PRESET) if model is None else model)
    if not faults:
        machine = replace(machine, faults=TrackerFaults())
    plan = debridement_plan(_reaching(machine), reaches, machine.log_rate_hz, np.random.default_rng([seed, 1]))
    return simulate(machine, plan, seed, position_only=position_only)


def debridement_plan(arm: RemoteCentreArm, reaches: int, rate_hz: float, rng: np.random.Generator) -> Plan:
    """Plan reaches from home to a fragment and on from fragment to fragment, in runs of 25, one after the other.

    Parameters
    ----------
    arm : RemoteCentreArm
    reaches : int
    rate_hz : float, samples a second
    rng : numpy.random.Generator, of the fragments
    """
    workspace = _workspace(arm, DEBRIDEMENT_SIZE, DEBRIDEMENT_TILT, CROWDING)
    segments, start, T_home = [], 0.0, arm.forward(working_posture(arm))
    for first in range(0, reaches, REACHES_BETWEEN_RESTS):
        numbers = list(range(first, min(first + REACHES_BETWEEN_RESTS, reaches)))
        stops = np.concatenate([T_home[None], workspace.sample(arm, len(numbers), rng)])
        path = tour(stops, numbers, [DEBRIDEMENT_PACE] * len(numbers), rate_hz)
        segments.append(Segment(joint_tour(arm, path), path.trajectory, start=start))
        start += len(path.trajectory) / rate_hz + REST_BETWEEN_RUNS
    return plan_of(segments, rate_hz)


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
    arm : str, "raven2_left", "raven2_right" or "dvrk_psm"; the packaged model of that name is used
    n_trajectories : int, reaches, one trajectory each, over all sessions
    seed : int, of targets, homings, noise and faults
    sessions : int, the arm is homed anew between sessions, which shifts its joints' zeros
    payloads : sequence of float
        Payloads at the tip, kg, taken in turn by runs of ten reaches; the model's own when empty.
    position_only : bool, leave the tracker's orientations out
    faults : bool, whether the tracker fails now and then
    model : Model, optional, another machine, of all six joints of an arm; `arm` is then not used

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
    body = _reaching(machine)
    workspace = _workspace(body, SIZE, TILT, 1.0)
    segments: list[Segment] = []
    for session, numbers in enumerate(np.array_split(np.arange(n_trajectories), sessions)):
        start = 0.0
        for first in range(0, len(numbers), REACHES_PER_RUN):
            run = numbers[first : first + REACHES_PER_RUN].tolist()
            stops = workspace.sample(body, len(run) + 1, rng)
            back = np.arange(RETURN_EVERY, len(stops), RETURN_EVERY)
            stops[back] = stops[back - 2]
            slow, fast = np.log(SPEEDS)
            speeds = np.exp(rng.uniform(slow, fast, len(run))).tolist()
            paces = [Pace(speed=speed, law="minimum-jerk", pause=PAUSE) for speed in speeds]
            path = tour(stops, run, paces, machine.log_rate_hz)
            payload = payload_in_turn(payloads, len(segments))
            segments.append(Segment(joint_tour(body, path), path.trajectory, session, start, payload))
            start += len(segments[-1].q) / machine.log_rate_hz + REST_BETWEEN_RUNS
    return simulate(machine, plan_of(segments, machine.log_rate_hz), seed, position_only=position_only)


def _reaching(machine: Machine) -> RemoteCentreArm:
    if not isinstance(machine.description, RemoteCentreArm):
        raise DataError(
            f"reaches are planned for arms with a remote centre, {machine.arm} is none.",
            hint="Simulate joint motion: gpcorrect simulate joints.",
        )
    return machine.description


def _workspace(arm: RemoteCentreArm, size: FloatArray, tilt: float, crowding: float) -> Workspace:
    """Box of a size (m, the last one vertical) around the tool in the arm's working posture."""
    T = arm.forward(working_posture(arm))
    return Workspace(se3.pose(upright(arm.gravity), T[:3, 3]), size, T[:3, :3], tilt, crowding)
