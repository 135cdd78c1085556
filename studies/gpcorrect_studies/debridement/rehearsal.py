"""The recording that a debridement arm learns from: the task's own motions under the tracker.

A few motions first, to register the frames: the arm as it comes misses by centimetres and would rehearse beside the
fragments. What the registration leaves is what the rehearsal shows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.rigid import RigidModel, fit_pose
from gpcorrect.sim import Plan, Segment, TrackerFaults, plan_of, simulate
from gpcorrect.sim.reaching import Pace, joint_tour, tour
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal
from gpcorrect_studies.debridement.scene import Scene, Station
from gpcorrect_studies.debridement.skills import Errand, errands
from gpcorrect_studies.debridement.strategies import ACCELERATION, TURN_RATE

__all__ = ["rehearsal_log", "rehearsal_seconds"]

ROOM = np.array([0.02, 0.02, 0.014])  # m by which rehearsed places go beyond the fragments' box: what still misses
REGISTERING = 4  # fragments of the motions that register the frames
CYCLES_PER_RUN = 8  # fragments; then the arm starts anew
GRASP_REST = 0.8  # s at the fragment, as when the arm settles and closes its jaws
REST_BETWEEN_RUNS = 10.0  # s
DRAWS = 50  # tries to find a place that the arm reaches


def rehearsal_log(
    scene: Scene, station: Station, fragments: int, speed: float, rng: np.random.Generator, seed: int
) -> CalibrationLog:
    """Rehearse the way to so many places and back to the bowl, and record it.

    Parameters
    ----------
    scene, station : Scene, Station
    fragments : int
        Rehearsed places; each is one trajectory, with a random one of the grasps.
    speed : float
        m/s, the task's own.
    rng : numpy.random.Generator
        Of places and grasps.
    seed : int
        Of the tracker's noise and faults.
    """
    blind = replace(station.machine, faults=TrackerFaults())
    first = _Rehearsal(scene, station, speed, None).plan(REGISTERING, rng)
    seen = simulate(blind, first, seed)
    assert seen.tracker_cp is not None
    assert seen.setpoint_cp is not None
    registered = fit_pose(seen.tracker_cp, seen.setpoint_cp)
    plan = _Rehearsal(scene, station, speed, registered).plan(fragments, rng)
    return simulate(station.machine, plan, seed + 1)


def rehearsal_seconds(log: CalibrationLog) -> float:
    """Session time at which the recording ended, s."""
    return float(log.time[-1])


class _Rehearsal:
    """Motions of the task to random places.

    Parameters
    ----------
    scene, station, speed
        See :func:`rehearsal_log`.
    registered : RigidModel or None
        From the tracker's frame to the arm's base; as registered by hand without it.
    """

    def __init__(self, scene: Scene, station: Station, speed: float, registered: RigidModel | None) -> None:
        self._scene, self._station, self._registered = scene, station, registered
        self._wide = replace(scene, size=scene.size + ROOM)
        self._going = Pace(speed, ACCELERATION, TURN_RATE, pause=0.1)

    def plan(self, fragments: int, rng: np.random.Generator) -> Plan:
        """Return runs of a few fragments each, one run after the other."""
        rate = self._station.machine.log_rate_hz
        segments, start = [], 0.0
        for first in range(0, fragments, CYCLES_PER_RUN):
            numbers = range(first, min(first + CYCLES_PER_RUN, fragments))
            path = tour(*self._stops(list(numbers), rng), rate)
            segments.append(Segment(joint_tour(self._station.arm, path), path.trajectory, start=start))
            start += len(path.trajectory) / rate + REST_BETWEEN_RUNS
        return plan_of(segments, rate)

    def _stops(self, numbers: list[int], rng: np.random.Generator) -> tuple[FloatArray, list[int], list[Pace]]:
        """Poses to command, base frame, the trajectory of each reach, and its pace."""
        going, parts = self._going, []
        for _ in numbers:
            parts.append(self._reachable(rng))
        stops = np.concatenate([parts[-1][-1:], *parts])
        paces = [going, replace(going, pause=GRASP_REST), going, going] * len(numbers)
        return stops, [number for number in numbers for _ in range(4)], paces

    def _reachable(self, rng: np.random.Generator) -> FloatArray:
        """Commands `(4, 4, 4)` over, at and again over a random place, and over the bowl."""
        for _ in range(DRAWS):
            ways = errands(self._scene, self._station, self._wide.fragments(1, rng)[0])
            T = self._commands(ways[int(rng.integers(len(ways)))])
            if self._station.arm.solutions(T).within_limits.any(axis=-1).all():
                return T
        raise DataError(f"{self._station.name} reaches hardly any place of the scene.")

    def _commands(self, errand: Errand) -> FloatArray:
        T = np.stack([errand.T_above, errand.T_grasp, errand.T_above, errand.T_bowl])
        if self._registered is None:
            return se3.compose(se3.invert(self._station.T_tracker_base), T)
        command = self._registered.apply(PoseSignal(*se3.to_parts(T)))
        assert command.quaternion is not None
        return se3.from_parts(command.position, command.quaternion)
