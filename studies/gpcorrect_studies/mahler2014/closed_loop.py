"""Table II: the robot is sent to places again and again, and where its tool really comes to rest is compared.

Every repetition visits all places in an order of its own, so that the arm comes from elsewhere each time and its play
and friction stand elsewhere. Three commands for the same desired poses, in the tracker's frame: the desired path
itself; the path corrected sample by sample; and straight reaches to corrected end poses only. Each is sent through the
inverse kinematics, the servo loop and the transmission of the machine that made the training data, later in the same
session.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import arm_named
from gpcorrect.calibration import CommandCorrector, Experiment
from gpcorrect.errors import LogError
from gpcorrect.rigid import pose_residual
from gpcorrect.sim import Machine, Segment, plan_of, run
from gpcorrect.sim.reaches import DEBRIDEMENT_PACE
from gpcorrect.sim.reaching import Tour, joint_tour, tour
from gpcorrect.types import FloatArray, IntArray, PoseSignal
from gpcorrect_studies.mahler2014.table1 import held_out_of

SETTLING = 0.5  # s of rest after each reach; chosen by hand: the simulated arm has come to rest by then
AFTER_TRAINING = 60.0  # s between the recording's end and the first repetition, and between repetitions; chosen by hand


Landing = Mapping[str, FloatArray]
"""Desired minus true tool pose with one kind of command, `on_arrival` and `at_rest` half a second later: arrays
(repetitions, places, 6), m and rad, tracker frame."""


def summary_of(error: FloatArray) -> dict[str, dict[str, float]]:
    """Return mean and SD of the components of position and of both errors' lengths, mm and degrees.

    Of the lengths, repeatability too: RMS spread of a place's visits about their mean.

    Parameters
    ----------
    error : (repetitions, places, 6) array, m and rad
    """
    parts = error.reshape(*error.shape[:2], 2, 3)
    spread = np.sqrt(((parts - parts.mean(axis=0)) ** 2).sum(axis=-1).mean(axis=(0, 1)))
    figures = {
        name: _mean_and_sd(1e3 * np.abs(parts[..., 0, axis])) for axis, name in enumerate(("x_mm", "y_mm", "z_mm"))
    }
    for i, (name, scale) in enumerate((("position_mm", 1e3), ("rotation_deg", 180 / np.pi))):
        lengths = scale * np.linalg.norm(parts[..., i, :], axis=-1)
        figures[name] = {**_mean_and_sd(lengths), "repeatability": scale * float(spread[i])}
    return figures


def _mean_and_sd(values: FloatArray) -> dict[str, float]:
    return {"mean": float(values.mean()), "sd": float(values.std())}


def places_to_visit(experiment: Experiment, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw end poses of held-out reaches as the tracker saw them; LogError where too few are held out.

    The first of the `(count + 1, 4, 4)` poses, tracker frame, is where each run starts.

    Parameters
    ----------
    experiment : Experiment, with held-out reaches
    count : int
    rng : numpy.random.Generator, of which reaches
    """
    log, evaluation = held_out_of(experiment)
    passed = np.flatnonzero(evaluation.cleaning.keep)
    assert log.tracker_cp is not None
    assert log.tracker_cp.quaternion is not None
    ends = passed[np.flatnonzero(np.diff(log.trajectory[passed], append=-1) != 0)]
    if len(ends) <= count:
        hint = "Simulate more reaches."
        raise LogError(f"{count} places need {count + 1} held-out reaches, there are {len(ends)}.", hint=hint)
    rows = rng.permutation(ends)[: count + 1]
    return se3.from_parts(log.tracker_cp.position[rows], log.tracker_cp.quaternion[rows])


def closed_loop(
    corrector: CommandCorrector,
    machine: Machine,
    places: FloatArray,
    repetitions: int,
    begin: float,
    rng: np.random.Generator,
    early: float = 0.0,
) -> dict[str, Landing]:
    """Visit all places so many times; a landing for each of "none", "full trajectory" and "endpoint".

    Parameters
    ----------
    corrector : CommandCorrector, fitted to recordings of this machine
    machine : Machine
    places : (k + 1, 4, 4) array, desired poses in the tracker frame; the runs start at the first
    repetitions : int
    begin : float, session time of the recording's end, s: the robot has drifted since
    rng : numpy.random.Generator, orders of the visits
    early : float, by how many seconds before a path's stop its last corrected command is given, and then held
    """
    orders = [rng.permutation(len(places) - 1) for _ in range(repetitions)]
    tours: Mapping[str, Callable[[FloatArray], Tour]] = {
        "none": lambda stops: _tour(stops, machine),
        "full trajectory": lambda stops: _corrected_path(corrector, _tour(stops, machine), machine, early),
        "endpoint": lambda stops: _tour(_corrected_stops(corrector, stops), machine),
    }
    return {
        name: _landing(
            machine, [tour_of(places[np.concatenate([[0], 1 + order])]) for order in orders], orders, places[1:], begin
        )
        for name, tour_of in tours.items()
    }


def _landing(machine: Machine, tours: list[Tour], orders: list[IntArray], places: FloatArray, begin: float) -> Landing:
    """Drive the tours one after the other; errors are those at the end of each visit."""
    arm = arm_named(machine.arm)
    starts = begin + AFTER_TRAINING * (1 + np.arange(len(tours)))
    segments = [
        Segment(joint_tour(arm, path), path.trajectory, start=start) for path, start in zip(tours, starts, strict=True)
    ]
    plan = plan_of(segments, machine.log_rate_hz)
    outcome = run(machine, plan)
    assert outcome.T_base_tip is not None
    arrival, rest = np.empty((2, len(orders), len(places), 6))
    for i, order in enumerate(orders):
        ends = np.flatnonzero(np.diff(plan.trajectory[:, i], append=-1) != 0)[: len(order)]
        for errors, back in ((rest, 0), (arrival, round(SETTLING * machine.log_rate_hz))):  # a visit ends with its rest
            T = se3.compose(machine.T_tracker_base, outcome.T_base_tip[ends - back, i], machine.T_tip_marker)
            errors[i, order] = pose_residual(PoseSignal(*se3.to_parts(T)), PoseSignal(*se3.to_parts(places[order])))
    return {"on_arrival": arrival, "at_rest": rest}


def _tour(stops: FloatArray, machine: Machine) -> Tour:
    count = len(stops) - 1
    return tour(stops, range(count), [replace(DEBRIDEMENT_PACE, pause=SETTLING)] * count, machine.log_rate_hz)


def _corrected_path(corrector: CommandCorrector, path: Tour, machine: Machine, early: float) -> Tour:
    times = np.arange(len(path.T_base_tip)) / machine.log_rate_hz
    answer = corrector.correct_path(np.hstack(se3.to_parts(path.T_base_tip)), times)
    assert answer.position is not None
    assert answer.quaternion is not None
    commands = se3.from_parts(answer.position, answer.quaternion)
    if early:
        ends = np.flatnonzero(np.diff(path.trajectory, append=-1) != 0)
        for end in ends:
            last = end - round((SETTLING + early) * machine.log_rate_hz)
            commands[last + 1 : end + 1] = commands[last]
    return Tour(commands, path.trajectory)


def _corrected_stops(corrector: CommandCorrector, stops: FloatArray) -> FloatArray:
    answers = [corrector.correct(pose) for pose in np.hstack(se3.to_parts(stops))]
    quaternions = [answer.quaternion for answer in answers if answer.quaternion is not None]
    return se3.from_parts(np.array([answer.position for answer in answers]), np.array(quaternions))
