"""Physical limits that a sample keeps or breaks by itself: small objects with one method, in a list."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np

from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.samples import Samples, part_norms
from gpcorrect.types import FloatArray, PoseSignal, frozen_array

__all__ = ["PhysicalLimit", "RotationLimit", "Workspace", "bad_numbers"]

NORM_TOLERANCE = 1e-3  # the log format's: a quaternion off by more is a bad sample


class PhysicalLimit(Protocol):
    """Something no sample of a working arm and tracker exceeds."""

    @property
    def reason(self) -> Reason:
        """Code of a breach."""
        ...

    @property
    def limit(self) -> float:
        """Largest value that is possible."""
        ...

    def measure(self, samples: Samples) -> FloatArray:
        """Return the value (n,) that is held against the limit."""
        ...


@dataclass(frozen=True, eq=False)
class Workspace:
    """The mapped observation stays within `limit` metres of the box of commanded positions.

    Parameters
    ----------
    low, high : (3,) arrays
        Corners of the box, base frame, m.
    limit : float
        Margin, m.
    """

    low: FloatArray
    high: FloatArray
    limit: float
    reason: ClassVar[Reason] = Reason.WORKSPACE

    @classmethod
    def around(cls, command: PoseSignal, margin: float) -> Self:
        """Box of the commanded positions."""
        return cls(frozen_array(command.position.min(axis=0)), frozen_array(command.position.max(axis=0)), margin)

    def measure(self, samples: Samples) -> FloatArray:
        """Distance (n,) in m from the box, 0 inside."""
        p = samples.mapped.position
        outside: FloatArray = np.linalg.norm(np.maximum(np.maximum(self.low - p, p - self.high), 0.0), axis=1)
        return outside


@dataclass(frozen=True)
class RotationLimit:
    """The mapped orientation is turned from the commanded one by at most `limit` radians."""

    limit: float
    reason: ClassVar[Reason] = Reason.ROTATION

    def measure(self, samples: Samples) -> FloatArray:
        """Angle (n,) in rad between mapped and commanded orientation; 0 where only positions are observed."""
        norms = part_norms(samples.error)
        angles: FloatArray = norms[:, 1] if norms.shape[1] > 1 else np.zeros(len(norms))
        return angles


def bad_numbers(*signals: PoseSignal) -> FloatArray:
    """Count (n,) of missing numbers in a sample's poses, a quaternion that is not of unit norm counting as four."""
    count = np.zeros(len(signals[0]))
    for signal in signals:
        count += (~np.isfinite(signal.position)).sum(axis=1)
        if signal.quaternion is not None:
            missing = (~np.isfinite(signal.quaternion)).sum(axis=1)
            skewed = np.abs(np.linalg.norm(signal.quaternion, axis=1) - 1.0) > NORM_TOLERANCE
            count += np.where(missing == 0, 4.0 * skewed, missing)
    return count
