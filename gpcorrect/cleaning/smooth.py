"""The second look: how far each error is from what such poses and velocities show elsewhere in the recording.

Systematic errors (stretch, play, friction) depend smoothly on the commanded pose and velocity; a fault does not. What
differs from the smooth model by many robust scales is suspicious. The model sees commands only, which faults leave
intact. It is coarse and robust: it judges, and the correction is learned elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.cleaning.field import ErrorField
from gpcorrect.cleaning.inputs import FieldInputs, commanded_twists
from gpcorrect.cleaning.samples import Samples, part_norms
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, IntArray

__all__ = ["SecondLook", "SmoothModel", "judged_rows", "scaled_remainder", "trend_inputs"]

TREND_ROWS = 7  # slopes over position and velocity, and the level
JUDGED_SAMPLES = 4000  # the field is smooth along a path: between these it is interpolated


@dataclass(frozen=True, eq=False)
class SecondLook:
    """How n samples look beside the smooth model.

    Parameters
    ----------
    remainder : (n, k) array
        What the model leaves of the error, m and rad; in training, the model of the other folds.
    along : (n, k) array
        The same by one model throughout, so that steps in it are steps of the error.
    distance : (n,) array
        Robust scales between error and model, of the worse part.
    scale : (parts,) array
        Typical robust standard deviation of a component about the model, m and rad.
    """

    remainder: FloatArray
    along: FloatArray
    distance: FloatArray
    scale: FloatArray

    @classmethod
    def none(cls, error: FloatArray) -> Self:
        """Nothing is expected, so nothing is far: the look of a recording without a model."""
        return cls(error, error, np.zeros(len(error)), np.full(error.shape[1] // 3, np.inf))


@dataclass(frozen=True, eq=False)
class SmoothModel:
    """Trend, field and scale of the systematic error.

    Parameters
    ----------
    scaling : FieldInputs
        Inputs of the field.
    trend : (7, k) array
        Slopes and level of the error over commanded positions and velocities (an arm that follows late errs in
        proportion to its velocity), found by least median of squares; see :func:`trend_inputs`.
    unit : (parts,) array
        Robust spread of what the trend leaves, m and rad: the field's unit.
    field : ErrorField
        What else is systematic.
    scale : (parts,) array
        Robust standard deviation of a component about the field, as a multiple of the field's own.
    """

    scaling: FieldInputs
    trend: FloatArray
    unit: FloatArray
    field: ErrorField
    scale: FloatArray

    def __post_init__(self) -> None:
        if len(self.trend) != TREND_ROWS:
            raise DataError(f"the trend of a smooth model has {TREND_ROWS} rows, got {len(self.trend)}.")

    def look(self, samples: Samples) -> SecondLook:
        """Return what the model leaves of each error."""
        rows, twist = judged_rows(samples), commanded_twists(samples)
        x = self.field.kernel.inputs(*self.scaling.transform(samples, twist))
        mean, deviation = self.field.predict(x[rows])
        left = scaled_remainder(samples, twist, self.trend, self.unit)
        return self.beside(left, rows, mean, deviation)

    def beside(self, left: FloatArray, rows: IntArray, mean: FloatArray, deviation: FloatArray) -> SecondLook:
        """Hold scaled errors `left` (n, k) against a mean (m, k) and deviation (m,) that are known at `rows`."""
        index = np.arange(len(left))
        expected = np.stack([np.interp(index, rows, column) for column in mean.T], axis=1)
        spread = np.interp(index, rows, deviation)[:, None]
        distance = (part_norms(left - expected) / (spread * self.scale)).max(axis=1)
        remainder = (left - expected) * np.repeat(self.unit, 3)
        typical = self.unit * self.scale * np.median(spread)
        return SecondLook(remainder, remainder, distance, typical)


def trend_inputs(samples: Samples, twist: FloatArray, part: int) -> FloatArray:
    """Return inputs (n, 6) of a part's trend: commanded position and velocity, linear (part 0) or angular (part 1)."""
    return np.hstack([samples.command.position, twist[:, 3 * part : 3 * part + 3]])


def scaled_remainder(samples: Samples, twist: FloatArray, trend: FloatArray, unit: FloatArray) -> FloatArray:
    """Return what the trend (7, k) leaves of the error (n, k), in units (parts,) of its spread."""
    slopes = np.split(trend[:-1], len(unit), axis=1)
    expected = [trend_inputs(samples, twist, part) @ slope for part, slope in enumerate(slopes)]
    left: FloatArray = (samples.error - np.hstack(expected) - trend[-1]) / np.repeat(unit, 3)
    return left


def judged_rows(samples: Samples) -> IntArray:
    """Rows at which the model is asked: evenly spaced, and both ends of every trajectory and run."""
    n = len(samples)
    stride = max(1, n // JUDGED_SAMPLES)
    ends = np.flatnonzero((np.diff(samples.trajectory) != 0) | (np.diff(samples.run) != 0))
    rows: IntArray = np.unique(np.concatenate([np.arange(0, n, stride), ends, ends + 1, [n - 1]]))
    return rows
