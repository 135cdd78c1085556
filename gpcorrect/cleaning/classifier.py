"""The rules of cleaning, applied one after the other to samples whose thresholds are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.cleaning.report import Labels, Reason
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.signals import Samples
from gpcorrect.cleaning.smooth import Residual
from gpcorrect.cleaning.steps import Path, Pieces, StepThresholds, excursions, largest_chain, split_pieces
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

# The constants here were chosen by hand on the simulated recordings of bench/cleaning_faults.py.
SMOOTH_LEEWAY = 1.25  # a piece that leaves the model smoothly and comes back is more likely a gap of the model
FEW = 8  # samples: fewer are no motion of their own, however slow the recording
HABIT = 1 / 150  # more runs of repeats a sample are how the log was made (held samples, no noise), not a fault
LEVER = 0.05  # m: a turn counts as travel by this arm, about the size of a workspace
NEARBY = 8  # samples on either side
SURROUNDED = 0.6  # fraction of them that is rejected, beyond which what is left is no motion


@dataclass(frozen=True, eq=False)
class Thresholds:
    """What is learned from training data to label samples by themselves and by their neighbours in time.

    Parameters
    ----------
    scales : (g,) array, robust standard deviation of an error component about the registration, m and rad
    low, high : (g, w) arrays, corners of the box of commands; infinite for rotations
    steps : StepThresholds, how far the error can change from sample to sample
    """

    scales: FloatArray
    low: FloatArray
    high: FloatArray
    steps: StepThresholds

    @classmethod
    def learn(cls, samples: Samples, scales: FloatArray, settings: CleaningSettings) -> Self:
        """Return thresholds before there is a smooth model, from training samples and robust scales (g,).

        Parameters
        ----------
        samples : Samples, n samples
        scales : (g,) array, robust standard deviations about the registration, m and rad
        settings : CleaningSettings, factors and floors
        """
        shape = samples.error.shape[1:]
        low, high = np.full(shape, -np.inf), np.full(shape, np.inf)
        for group, unit in enumerate(samples.units):
            if unit == "P":
                low[group], high[group] = (f(samples.command[group], axis=0) for f in (np.min, np.max))
        return cls(
            frozen_array(scales * samples.small_sample_factor),
            frozen_array(low),
            frozen_array(high),
            StepThresholds.learn(samples, Residual.without_model(samples.error), settings),
        )


def label_samples(samples: Samples, thresholds: Thresholds, settings: CleaningSettings) -> Labels:
    """Return labels of the physical limits and of frozen observations.

    Parameters
    ----------
    samples : Samples, n samples
    thresholds : Thresholds, from training data
    settings : CleaningSettings, limits
    """
    outside, turned = np.zeros(len(samples)), np.zeros(len(samples))
    for group, unit in enumerate(samples.units):
        if unit == "P":
            p = samples.command[group] - samples.error[:, group]
            beyond = np.maximum(np.maximum(thresholds.low[group] - p, p - thresholds.high[group]), 0.0)
            outside = np.maximum(outside, np.linalg.norm(beyond, axis=1))
        else:
            turned = np.maximum(turned, samples.error_lengths[:, group])
    labels = Labels.passing(len(samples)).rejecting_above(outside, Reason.WORKSPACE, settings.workspace_margin)
    labels = labels.rejecting_above(turned, Reason.ROTATION, settings.max_rotation)
    return labels.rejecting_above(_frozen_travel(samples), Reason.FROZEN, settings.frozen_travel)


def label_motion(
    samples: Samples, labels: Labels, residual: Residual, thresholds: Thresholds, settings: CleaningSettings
) -> Labels:
    """Return which samples can be one motion, and which of them the registration and the smooth model explain.

    Parameters
    ----------
    samples : Samples, n samples
    labels : Labels, on these n so far; rejected samples take no part
    residual : Residual, what the smooth model leaves of their error
    thresholds, settings
        Limits and factors.
    """
    left = np.flatnonzero(labels.keep)
    if len(left) == 0:
        return labels
    steps = thresholds.steps
    path = Path.of(samples[left], residual.along[left], steps, settings.response_time)
    pieces = split_pieces(path)
    from_rigid = pieces.medians((path.samples.error_lengths / thresholds.scales).max(axis=1))
    from_smooth = pieces.medians(residual.distance[left])
    badness = np.maximum(from_rigid / settings.outlier_factor, from_smooth / settings.offset_factor)
    occlusion = _occlusion_samples(path, settings)
    scores = pieces.counts * (1 - badness**2)
    long_enough = (scores > 0) & (pieces.counts >= FEW)
    away = excursions(pieces, long_enough, path, residual.left[left], occlusion)
    chained = largest_chain(pieces, np.where(away, 0.0, scores), path, occlusion)
    labels = _reject_pieces(labels, left, pieces, from_rigid, Reason.OUTLIER, settings.outlier_factor)
    labels = _reject_pieces(labels, left, pieces, from_smooth, Reason.OFFSET, settings.offset_factor)
    labels = _reject_unconnected(labels, left, pieces, ~chained, steps)
    if not samples.joints:  # an outside encoder fails with a jump; what grows without one is the robot's (a wrist near
        # its singularity errs by 30 degrees, smoothly and again and again)
        labels = labels.rejecting_above(residual.distance, Reason.OFFSET, SMOOTH_LEEWAY * settings.offset_factor)
    return labels.rejecting_above(_rejected_nearby(samples.run, labels.keep), Reason.SURROUNDED, SURROUNDED)


def _frozen_travel(samples: Samples) -> FloatArray:
    """Commanded travel (n,) in m of the run of exact repeats that a sample lies in; 0 outside.

    A real sensor has noise and never repeats itself in every digit. Logs that do so habitually (a slow tracker that is
    held between its samples, a simulation without noise) show it nowhere. Each joint has a sensor of its own.
    """
    travel = np.zeros(len(samples))
    if samples.joints:
        for observed, place, unit in zip(samples.observed, samples.place, samples.units, strict=True):
            travel = np.maximum(travel, _sensor_travel(samples, observed, place * (1.0 if unit == "P" else LEVER)))
        return travel
    # Matrices of rotations that differ by a small angle a differ by sqrt(2) a.
    metres = [place * lever for place, lever in zip(samples.place, (1.0, LEVER / np.sqrt(2.0)), strict=False)]
    return _sensor_travel(samples, np.hstack(samples.observed), np.hstack(metres))


def _sensor_travel(samples: Samples, observed: FloatArray, commanded: FloatArray) -> FloatArray:
    """Commanded travel (n,) in m during repeats of one sensor, from its values (n, k) and commands (n, d) in m."""
    inside = samples.run[1:] == samples.run[:-1]
    repeats = np.concatenate([[False], (observed[1:] == observed[:-1]).all(axis=1) & inside])
    run = np.cumsum(~repeats) - 1
    first = np.flatnonzero(~repeats)
    low, high = (f.reduceat(commanded, first, axis=0) for f in (np.minimum, np.maximum))
    travel: FloatArray = np.linalg.norm(high - low, axis=1)[run]
    travel[~repeats] = 0.0  # the run's first sample was measured
    moves = np.concatenate([[False], (np.diff(commanded, axis=0) != 0).any(axis=1)])
    moving_runs = np.unique(run[repeats & moves])
    return np.zeros(len(samples)) if len(moving_runs) > HABIT * len(samples) else travel


def _occlusion_samples(path: Path, settings: CleaningSettings) -> float:
    """Count the samples of the longest occlusion: what an impossible step inside a chain must be worth."""
    steps = np.diff(path.samples.time)
    typical = np.median(steps[steps > 0]) if (steps > 0).any() else settings.occlusion_time
    return float(max(FEW, settings.occlusion_time / typical))


def _spread(values: FloatArray, n: int, rows: IntArray, pieces: Pieces) -> FloatArray:
    """Values (m,) of pieces as values (n,) of all samples, NaN for those in no piece."""
    spread = np.full(n, np.nan)
    spread[rows] = values[pieces.label]
    return spread


def _reject_pieces(
    labels: Labels, rows: IntArray, pieces: Pieces, values: FloatArray, reason: Reason, limit: float
) -> Labels:
    """Reject the pieces whose value (m,) exceeds the limit."""
    return labels.rejecting_above(_spread(values, len(labels.keep), rows, pieces), reason, limit)


def _reject_unconnected(
    labels: Labels, rows: IntArray, pieces: Pieces, mask: BoolArray, steps: StepThresholds
) -> Labels:
    """Name the limit that the step into a piece breaks, or the step out of it where that breaks more."""
    out_ratio = np.append(pieces.ratio[1:], 0.0)
    cause = np.where(out_ratio > pieces.ratio, np.append(pieces.cause[1:], 0), pieces.cause)
    ratio = np.where(mask, np.maximum(out_ratio, pieces.ratio), np.nan)
    causes = _spread(cause.astype(np.float64), len(labels.keep), rows, pieces)
    for k, (reason, limit) in enumerate(steps.limits):
        value = _spread(ratio * limit, len(labels.keep), rows, pieces)
        labels = labels.rejecting(np.isfinite(value) & (causes == k), reason, value, limit)
    return labels


def _rejected_nearby(run: IntArray, keep: BoolArray) -> FloatArray:
    """Fraction (n,) of rejected samples among each sample's neighbours in its run, eight on either side.

    In a stretch that is shuffled, a few samples lie by chance where they should; they are no motion.
    """
    n = len(run)
    bounds = np.flatnonzero(np.concatenate([[True], np.diff(run) != 0, [True]]))
    stretch = np.searchsorted(bounds, np.arange(n), side="right") - 1
    low = np.maximum(np.arange(n) - NEARBY, bounds[stretch])
    high = np.minimum(np.arange(n) + NEARBY + 1, bounds[stretch + 1])
    rejected = np.concatenate([[0], np.cumsum(~keep)])
    fraction: FloatArray = (rejected[high] - rejected[low] - ~keep) / np.maximum(high - low - 1, 1)
    return fraction
