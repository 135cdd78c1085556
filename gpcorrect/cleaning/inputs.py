"""What the smooth model of the error sees: commanded pose and velocity, scaled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect import se3
from gpcorrect.cleaning.samples import Samples
from gpcorrect.types import FloatArray, frozen_array
from gpcorrect.velocity import twists

__all__ = ["FieldInputs", "commanded_twists"]

TINY = 1e-9


def commanded_twists(samples: Samples) -> FloatArray:
    """Twist (n, 6) of the commands in m/s and rad/s; zero where a run is too short or has no orientation.

    Commands are not measured, so no rejection interrupts them.
    """
    quaternion = samples.command.quaternion
    rotations = None if quaternion is None else se3.matrix_from_quaternion(quaternion)
    return np.nan_to_num(twists(samples.time, samples.command.position, rotations, samples.run))


@dataclass(frozen=True, eq=False)
class FieldInputs:
    """Scaling of inputs, learned once: each group by one number, so that no choice of axes matters.

    Parameters
    ----------
    centre : (12,) array
        Middle position, m, and mean rotation matrix, row by row.
    spread : (2,) array
        Spread of positions, m, and of rotation-matrix entries.
    speed : (2,) array
        Speeds, m/s and rad/s, at which a velocity input is half saturated: friction depends on the direction of
        motion more than on its speed.
    """

    centre: FloatArray
    spread: FloatArray
    speed: FloatArray

    @classmethod
    def learn(cls, samples: Samples, twist: FloatArray) -> Self:
        """Scaling of these samples, by medians."""
        entries = _pose_entries(samples)
        centre = np.median(entries, axis=0)
        away = (entries - centre).reshape(len(entries), 4, 3)
        spread = [np.median(np.linalg.norm(away[:, k], axis=(1, 2))) for k in (slice(0, 1), slice(1, 4))]
        norms = np.linalg.norm(twist.reshape(-1, 2, 3), axis=2)
        speed = [np.median(v[v > TINY]) if (v > TINY).any() else 1.0 for v in norms.T]
        return cls(frozen_array(centre), frozen_array(np.maximum(spread, TINY)), frozen_array(speed))

    def transform(self, samples: Samples, twist: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pose inputs (n, 12) of unit spread and velocity inputs (n, 6) of length at most one each."""
        pose = (_pose_entries(samples) - self.centre) / np.repeat(self.spread, (3, 9))
        velocity = twist.reshape(-1, 2, 3)
        speed = np.linalg.norm(velocity, axis=2, keepdims=True)
        saturated = velocity / (speed + self.speed[:, None])
        return pose, saturated.reshape(-1, 6)


def _pose_entries(samples: Samples) -> FloatArray:
    """Position and rotation-matrix entries (n, 12); the identity where no orientation was commanded."""
    command = samples.command
    if command.quaternion is None:
        rotation = np.tile(np.eye(3).ravel(), (len(samples), 1))
    else:
        rotation = se3.matrix_from_quaternion(command.quaternion).reshape(-1, 9)
    return np.hstack([command.position, rotation])
