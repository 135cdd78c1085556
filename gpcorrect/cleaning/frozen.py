"""Observations that stand still while the command travels: a tracker that repeats its last value."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.cleaning.samples import Samples
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["frozen_travel"]

HABIT = 1 / 150  # more runs of repeats a sample are how the log was made (held samples, no noise), not a fault
LEVER = 0.05  # m: a turn counts as travel by this arm, about the size of a workspace


def frozen_travel(samples: Samples) -> FloatArray:
    """Commanded travel (n,) in m of the run of exact repeats that a sample lies in; 0 outside.

    A real sensor has noise and never repeats itself in every digit. Logs that do so habitually (a slow tracker that is
    held between its samples, a simulation without noise) show it nowhere.
    """
    repeats = _repeats(samples)
    run = np.cumsum(~repeats) - 1
    first = np.flatnonzero(~repeats)
    travel = _extent(samples, first, run)[run]
    travel[~repeats] = 0.0  # the run's first sample was measured
    moving_runs = np.unique(run[repeats & _commanded(samples)])
    return np.zeros(len(samples)) if len(moving_runs) > HABIT * len(samples) else travel


def _repeats(samples: Samples) -> BoolArray:
    """(n,) mask of samples that equal their predecessor in every digit."""
    mapped = samples.mapped
    values = mapped.position if mapped.quaternion is None else np.hstack([mapped.position, mapped.quaternion])
    same: BoolArray = np.concatenate([[False], (values[1:] == values[:-1]).all(axis=1)])
    same[1:] &= samples.run[1:] == samples.run[:-1]
    return same


def _commanded(samples: Samples) -> BoolArray:
    """(n,) mask of samples whose command moved since the sample before."""
    moved: BoolArray = np.concatenate([[False], (np.diff(samples.command.position, axis=0) != 0).any(axis=1)])
    return moved


def _extent(samples: Samples, first: IntArray, run: IntArray) -> FloatArray:
    """Diameter (runs,) in m of the box of commands in each run."""
    coordinates = samples.command.position
    if samples.command.quaternion is not None:
        R = se3.matrix_from_quaternion(samples.command.quaternion).reshape(len(samples), 9)
        coordinates = np.hstack([coordinates, LEVER * R / np.sqrt(2.0)])
    low, high = (f.reduceat(coordinates, first, axis=0) for f in (np.minimum, np.maximum))
    extent: FloatArray = np.linalg.norm(high - low, axis=1)
    return extent
