"""A case before anything is hidden in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truth.hidden import Hidden
from truth.history import History, Readings
from truth.machine import Machine, draw_machine, simulate
from truth.noise import NoiseLaw, draw_noise
from truth.reference import Reference, separating, zigzag
from truth.sizing import ratio_of
from truth.spec import Spec

Array = NDArray[np.float64]

JOINT_NOISE = np.array([2.5e-4, 2.5e-4, 4e-5])  # rad, rad, m; typical white part of the outside joint sensors
TRACKER_NOISE = np.full(3, 1.5e-4)  # m
LEVER = 0.1  # m; from a tracker's noise to a joint's


@dataclass(frozen=True, eq=False)
class Setting:
    """A case before anything is hidden in it."""

    spec: Spec
    machine: Machine
    reference: Reference
    history: History
    readings: Readings
    joint_noise: NoiseLaw
    tracker_noise: NoiseLaw
    registered: bool

    @property
    def tracker(self) -> float | None:
        """RMS of the tracker's noise where it is the only sensor."""
        return float(np.sqrt(np.mean(self.tracker_noise.rms**2))) if self.spec.signals == "tracker" else None

    @property
    def scene_noise(self) -> Array:
        """RMS (3,) of the noise as seen at the joints."""
        tracker = self.tracker
        return self.joint_noise.rms if tracker is None else tracker / np.array([LEVER, LEVER, 1.0])

    def ratio(self, hidden: Hidden, with_it: Readings, without: Readings, rows: NDArray[np.int64]) -> float:
        """Ratio of one cause between two runs."""
        return ratio_of(hidden, with_it, without, rows, self.joint_noise.rms, self.tracker, not self.registered)

    def louder(self, factor: float) -> Setting:
        """Return the same with another level of noise."""
        return replace(self, joint_noise=self.joint_noise.times(factor), tracker_noise=self.tracker_noise.times(factor))


def prepare(spec: Spec, rng: np.random.Generator) -> Setting:
    """Draw a machine, a motion and the sensors' noise, and run it without any hidden cause."""
    machine = draw_machine(rng, tracked=spec.signals == "tracker")
    run = separating if spec.motion == "separating" else zigzag
    reference = run(rng, spec.trajectories, spec.seconds, spec.sessions)
    history, readings = simulate(machine, reference)
    registered = "registration_error" in spec.hidden or bool(rng.random() < 0.5)
    joint_noise = draw_noise(rng, JOINT_NOISE, spec.awkward)
    tracker_noise = draw_noise(rng, TRACKER_NOISE, spec.awkward)
    return Setting(spec, machine, reference, history, readings, joint_noise, tracker_noise, registered)
