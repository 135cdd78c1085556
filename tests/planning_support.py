"""Correctors whose every answer is known, and stations that they are right about."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect import se3
from gpcorrect.correction import Correction, Reason
from gpcorrect.types import FloatArray
from gpcorrect_studies.debridement.scene import Station


@dataclass(frozen=True)
class Moves:
    """Moves every pose by a rigid motion; unsure by `interval`, and lost beyond `domain` metres from the origin."""

    T: FloatArray
    interval: float = 1e-4
    domain: float = np.inf

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Correction:
        n = len(poses)
        assert len(times) == n
        position, quaternion = se3.to_parts(se3.compose(self.T, se3.from_parts(poses[:, :3], poses[:, 3:])))
        inside = np.linalg.norm(poses[:, :3], axis=1) < self.domain
        interval = np.full((n, 6), self.interval)
        reasons = np.where(inside, 0, int(Reason.OUTSIDE))
        return Correction(position, quaternion, None, interval / 2, interval, reasons)


def ideal(station: Station) -> Station:
    """Return the station with an arm that has no error but its registration."""
    machine = replace(station.machine, effects=())
    drive = replace(machine.drive, feedforward="rigid-body")
    return replace(station, machine=replace(machine, drive=drive))
