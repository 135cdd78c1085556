"""A case of this truth before anything is hidden in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truth import recipe
from truth.hidden import Hidden, rigidly
from truth.history import History, Readings
from truth.kinds import kind_named
from truth.machine import draw_machine, readings_of, simulate
from truth.noise import draw_noise
from truth.reference import Reference, separating, zigzag
from truth.spec import Spec

Array = NDArray[np.float64]

JOINT_NOISE = np.array([2.5e-4, 2.5e-4, 4e-5])  # rad, rad, m; typical white part of the outside joint sensors
TRACKER_NOISE = np.full(3, 1.5e-4)  # m
LEVER = 0.1  # m; from a tracker's noise to a joint's


@dataclass(frozen=True, eq=False)
class Setting(recipe.Setting):
    """A case before anything is hidden in it, with its history."""

    history: History

    @property
    def tracker(self) -> float | None:
        """RMS of the tracker's noise where it is the only sensor."""
        return float(np.sqrt(np.mean(self.tracker_noise.rms**2))) if self.spec.signals == "tracker" else None

    @property
    def scene_noise(self) -> Array:
        """RMS (3,) of the noise as seen at the joints."""
        tracker = self.tracker
        return self.joint_noise.rms if tracker is None else tracker / np.array([LEVER, LEVER, 1.0])

    @property
    def moved(self) -> tuple[Array, Array]:
        """Motors as they are reported, and commanded torques."""
        return self.history.motion.motor, self.history.motion.command

    def along(self, reference: Reference) -> Setting:
        """Run along another reference."""
        history, readings = simulate(self.machine, reference)
        return replace(self, reference=reference, history=history, readings=readings)

    def run(self, hidden: Sequence[Hidden]) -> Readings:
        """Run with causes."""
        return simulate(self.machine, self.reference, hidden, self.history.motion)[1]

    def read(self, hidden: Sequence[Hidden]) -> Readings:
        """Read the motion as it was."""
        return readings_of(self.machine, self.history, hidden)

    def ratio(self, hidden: Hidden, with_it: Readings, without: Readings, rows: NDArray[np.int64]) -> float:
        """RMS of the trace over RMS of the noise."""
        kind, j, noise = kind_named(hidden.name), hidden.column, self.joint_noise.rms
        if kind.channel == "noise":
            return float(np.sqrt(np.mean(with_it.extra_noise[rows, j] ** 2)) / noise[j])
        if self.tracker is not None:
            before, after = without.tip[rows, :3, 3], with_it.tip[rows, :3, 3]
            # a registration left to the data takes up what a rigid motion can
            miss = after - (before if self.registered else rigidly(before, after))
            return float(np.sqrt(np.mean(miss**2))) / self.tracker
        trace = with_it.outside[rows] - without.outside[rows]
        if kind.channel == "reported":
            trace = (with_it.reported - with_it.outside - without.reported + without.outside)[rows]
        each = np.sqrt(np.mean(trace**2, axis=0)) / noise
        return float(each[j] if kind.where == "joint" else each.max())


def prepare(spec: Spec, rng: np.random.Generator) -> Setting:
    """Draw a machine, a motion and the sensors' noise, and run it without any hidden cause."""
    machine = draw_machine(rng, tracked=spec.signals == "tracker")
    run = separating if spec.motion == "separating" else zigzag
    reference = run(rng, spec.trajectories, spec.seconds, spec.sessions)
    history, readings = simulate(machine, reference)
    registered = "registration_error" in spec.hidden or bool(rng.random() < 0.5)
    joint_noise = draw_noise(rng, JOINT_NOISE, spec.awkward)
    tracker_noise = draw_noise(rng, TRACKER_NOISE, spec.awkward)
    return Setting(spec, machine, reference, readings, joint_noise, tracker_noise, registered, history)
