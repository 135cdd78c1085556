"""The recording that a debridement arm learns from: the task's own motions under the tracker.

A few motions first, to register the frames: the arm as it comes misses by centimetres and would rehearse beside the
fragments. What the registration leaves is what the rehearsal shows.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from gpcorrect import se3
from gpcorrect.atomic import write_file
from gpcorrect.calibration import FitSettings, fit_corrector, save
from gpcorrect.errors import DataError
from gpcorrect.rigid import RigidModel, fit_pose
from gpcorrect.sim import Plan, Segment, TrackerFaults, plan_of, simulate
from gpcorrect.sim.reaching import Pace, joint_tour, tour
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal
from gpcorrect_studies.debridement.scene import Scene, Station, grasps
from gpcorrect_studies.debridement.strategies import ACCELERATION, TURN_RATE

# Chosen by hand on simulated recordings.
ROOM = np.array([0.02, 0.02, 0.014])  # m by which rehearsed places go beyond the fragments' box: what still misses
REGISTERING = 4  # fragments of the motions that register the frames
CYCLES_PER_RUN = 8  # fragments; then the arm starts anew
GRASP_REST = 0.8  # s at the fragment, as when the arm settles and closes its jaws
REST_BETWEEN_RUNS = 10.0  # s
INDUCING = 150  # of the models: enough for one task in a box of a few centimetres
SEARCH = 200  # samples that hyperparameters are searched among: a miss of 2 mm stays one, in a third of the time
FEATURES = ("pose", "velocity")  # joints do not help on this machine, and finding that out takes as long as the fit
AFTER_REHEARSAL = 60.0  # s between the end of the rehearsals and the task
DRAWS = 50  # tries to find a place that the arm reaches


def rehearsal_log(
    scene: Scene, station: Station, fragments: int, speed: float, rng: np.random.Generator, seed: int
) -> CalibrationLog:
    """Rehearse the way to so many places and back to the bowl, and record it; DataError where hardly any is reached.

    Parameters
    ----------
    scene : Scene
    station : Station
    fragments : int, rehearsed places; each is one trajectory, with a random one of the grasps
    speed : float, m/s, the task's own
    rng : numpy.random.Generator, of places and grasps
    seed : int, of the tracker's noise and faults
    """
    without_faults = replace(station.machine, faults=TrackerFaults())
    seen = simulate(without_faults, _plan(scene, station, REGISTERING, speed, rng, None), seed)
    assert seen.tracker_cp is not None
    assert seen.setpoint_cp is not None
    registered = fit_pose(seen.tracker_cp, seen.setpoint_cp)
    return simulate(station.machine, _plan(scene, station, fragments, speed, rng, registered), seed + 1)


def _plan(
    scene: Scene,
    station: Station,
    fragments: int,
    speed: float,
    rng: np.random.Generator,
    registered: RigidModel | None,
) -> Plan:
    """Return runs of a few fragments each; without `registered` the frames are those by hand."""
    wide = replace(scene, size=scene.size + ROOM)
    going = Pace(speed, ACCELERATION, TURN_RATE, pause=0.1)
    rate = station.machine.log_rate_hz
    segments, start = [], 0.0
    for first in range(0, fragments, CYCLES_PER_RUN):
        numbers = range(first, min(first + CYCLES_PER_RUN, fragments))
        cycles = [_cycle(wide, station, rng, registered) for _ in numbers]
        stops = np.concatenate([cycles[-1][-1:], *cycles])
        paces = [going, replace(going, pause=GRASP_REST), going, going] * len(numbers)
        path = tour(stops, [number for number in numbers for _ in range(4)], paces, rate)
        segments.append(Segment(joint_tour(station.arm, path), path.trajectory, start=start))
        start += len(path.trajectory) / rate + REST_BETWEEN_RUNS
    return plan_of(segments, rate)


def _cycle(scene: Scene, station: Station, rng: np.random.Generator, registered: RigidModel | None) -> FloatArray:
    """Commands `(4, 4, 4)` over, at and again over a random place within reach, and over the bowl."""
    for _ in range(DRAWS):
        ways = grasps(scene, station, scene.fragments(1, rng)[0])
        way = ways[int(rng.integers(len(ways)))]
        T = np.stack([way.T_above, way.T_grasp, way.T_above, way.T_bowl])
        if registered is None:
            T = se3.compose(se3.invert(station.T_tracker_base), T)
        else:
            command = registered.apply(PoseSignal(*se3.to_parts(T)))
            assert command.quaternion is not None
            T = se3.from_parts(command.position, command.quaternion)
        if station.arm.solutions(T).within_limits.any(axis=-1).all():
            return T
    raise DataError(f"{station.name} reaches hardly any place of the scene.")


def learn(scene: Scene, place: Station, folder: Path | None, rehearsals: int, speed: float, seed: int) -> float:
    """Rehearse, and fit a model unless there is one of this very rehearsal; return when it ended, s.

    Parameters
    ----------
    scene : Scene
    place : Station
    folder : Path or None, the model is `<name of the place>.gpc` in it; None where a service has one: nothing is fitted
    rehearsals : int
    speed : float, m/s
    seed : int

    Raises
    ------
    DataError
        The folder holds a model of that name that this rehearsal did not make: it is somebody's, and is not replaced.
    """
    salt = int(place.name.removeprefix("arm"))
    rng = np.random.default_rng([seed, salt])
    log = rehearsal_log(scene, place, rehearsals, speed, rng, 1000 * seed + 10 * salt)
    if folder is None:
        return float(log.time[-1])
    model, note = folder / f"{place.name}.gpc", folder / f"{place.name}.rehearsal"
    made_from = (
        repr((rehearsals, speed, seed, log.signals, INDUCING, SEARCH, FEATURES)).encode()
        + np.asarray(log.setpoint_jp).tobytes()
    )
    digest = hashlib.sha256(made_from).hexdigest()
    if not model.exists():
        settings = FitSettings(inducing=INDUCING, search_samples=SEARCH, features=FEATURES, marker="none", seed=seed)
        made = fit_corrector(log, settings)
        write_file(note, digest)  # first: a model without it is somebody's own
        save(made, model)
    elif not (note.exists() and note.read_text() == digest):
        raise DataError(
            f"{model} was not made by this rehearsal (its number, speed and seed count), and is not replaced.",
            hint="Name another folder with --models, or serve that model and name its address with --endpoint.",
        )
    return float(log.time[-1])
