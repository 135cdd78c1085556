"""Physical limits that a sample keeps or breaks by itself: small objects with one method, in a list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.samples import Samples, part_norms
from gpcorrect.types import BoolArray, FloatArray, PoseSignal, frozen_array

__all__ = ["PhysicalLimit", "RotationLimit", "Workspace", "bad_numbers", "breaches"]

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

    def to_dict(self) -> dict[str, Any]:
        """Return the box as JSON-able values."""
        return {"low": self.low.tolist(), "high": self.high.tolist(), "limit": self.limit}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Rebuild the box from :meth:`to_dict`."""
        return cls(frozen_array(values["low"]), frozen_array(values["high"]), float(values["limit"]))


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
            finite = np.isfinite(signal.quaternion).all(axis=1)
            norm = np.linalg.norm(np.where(finite[:, None], signal.quaternion, [1.0, 0.0, 0.0, 0.0]), axis=1)
            count += np.where(finite, 4.0 * (np.abs(norm - 1.0) > NORM_TOLERANCE), (~np.isfinite(signal.quaternion)).sum(axis=1))
    return count


def breaches(limits: Sequence[PhysicalLimit], samples: Samples) -> list[tuple[PhysicalLimit, BoolArray, FloatArray]]:
    """Each limit with the mask (n,) of samples that break it and the values (n,) measured."""
    measured = [(limit, limit.measure(samples)) for limit in limits]
    return [(limit, values > limit.limit, values) for limit, values in measured]
