"""The recipe of cleaning: a robust registration, the rules, the smooth model, whole trajectories, and the hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gpcorrect.cleaning.least_median import least_median_pose
from gpcorrect.cleaning.report import CleaningReport, Labels, Reason
from gpcorrect.cleaning.settings import CleaningSettings, segment_mask
from gpcorrect.cleaning.signals import POSES, Pair, Samples, pose_pair, samples_of, unusable
from gpcorrect.cleaning.smooth import Residual, SmoothModel, learn_smooth_model
from gpcorrect.cleaning.steps import Path, Pieces, StepThresholds, excursions, largest_chain, split_pieces
from gpcorrect.errors import DataError, LogError
from gpcorrect.one_thread import on_one_thread
from gpcorrect.rigid import MarkerOption, RigidModel, register
from gpcorrect.robust import medians_of, robust_scale
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, frozen_array
from gpcorrect.velocity import sampled_rows

FEWEST_SAMPLES = 4  # that a rigid model with orientations is fitted to
FEWEST_FOR_FIELD = 12  # fresh samples, chosen by hand: fewer cannot tell a smooth error from a fault

# The others were chosen by hand on the simulated recordings of bench/cleaning_faults.py.
SMOOTH_LEEWAY = 1.25  # a piece that leaves the model smoothly and comes back is more likely a gap of the model
FEW = 8  # samples: fewer are no motion of their own, however slow the recording
HABIT = 1 / 150  # more runs of repeats a sample are how the log was made (held samples, no noise), not a fault
LEVER = 0.05  # m: a turn counts as travel by this arm, about the size of a workspace
USUAL = 0.99  # of trusted samples have an error that another recording may have; chosen by hand: the rest are spikes
NEARBY = 8  # samples on either side
SURROUNDED = 0.6  # fraction of them that is rejected, beyond which what is left is no motion


@dataclass(frozen=True, eq=False)
class Thresholds:
    """What is learned from training data to label samples by themselves and by their neighbours in time."""

    # (g,) robust standard deviation of an error component about the registration, m and rad; of joints more where
    # trusted samples err more
    scales: FloatArray
    # (g, w) each: corners of the box of commands; infinite for rotations
    low: FloatArray
    high: FloatArray
    steps: StepThresholds  # how far the error can change from sample to sample

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


@dataclass(frozen=True, eq=False)
class FittedCleaner:
    """What training data taught, for labelling any log of the same arm and sensor.

    Parameters
    ----------
    pair : Pair, signals that are compared
    rigid : RigidModel, robust registration of the tracker; the identity for joints
    thresholds : Thresholds, scales and limits
    smooth : SmoothModel or None, smooth model of the error; None where there were too few samples to learn one
    settings : CleaningSettings
        Factors, and segments by hand: these hold in every log that is labelled, by its trajectory numbers and times.
    """

    pair: Pair
    rigid: RigidModel
    thresholds: Thresholds
    smooth: SmoothModel | None
    settings: CleaningSettings


@on_one_thread
def fit_cleaner(
    log: CalibrationLog,
    settings: CleaningSettings | None = None,
    *,
    rng: np.random.Generator,
    pair: Pair = POSES,
    marker: MarkerOption = "none",
    rigid: RigidModel | None = None,
) -> tuple[FittedCleaner, CleaningReport]:
    """Learn what is normal from a log that holds faults, and find them.

    Least median of squares around the registration gives robust scales (Mahler 2014, Sec. IV-A); samples that pass the
    physical limits and the limits on steps teach a smooth model of the error; then all samples are labelled beside it.

    Parameters
    ----------
    log : CalibrationLog, holds both signals of the pair; poses each with or without orientations
    settings : CleaningSettings, optional, what differs from the defaults
    rng : numpy Generator, source of the random samples; the same state gives the same report
    pair : Pair, signals to compare: :data:`POSES`, :data:`TOOL` or :func:`joint_pair`
    marker : "none", "solve" or "auto"
        Where the tracked marker may be another point than the tool tip: the registration that comes first, since such
        a marker moves by decimetres against the tip. See :func:`gpcorrect.rigid.register`.
    rigid : RigidModel, optional, a registration that comes first instead, such as that of the training recording

    Returns
    -------
    cleaner : FittedCleaner, what was learned, for :func:`clean_with`
    report : CleaningReport, which samples of `log` pass, and why the others do not

    Raises
    ------
    LogError
        The log lacks one of the signals.
    DataError
        Fewer than four samples are complete and not dropped by hand.
    DegenerateError
        The motion does not determine a registration.
    """
    settings = settings or CleaningSettings()
    rows, labels = _usable(log, pair, settings)
    if len(rows) < FEWEST_SAMPLES:
        raise DataError(
            f"cleaning needs at least {FEWEST_SAMPLES} complete samples that are not dropped by hand, got {len(rows)}"
            f" of {len(log)}.",
            hint=f"Look for missing numbers in {pair.observed} and {pair.command}, times that repeat, and segments to"
            " drop.",
        )
    found, scales = _registered(log, pair, rows, settings, rng, marker, rigid)
    samples = samples_of(log, pair, rows, found)
    if pair.joints:
        scales = np.maximum(robust_scale(samples.error_lengths), settings.resolution(samples.units))
    thresholds = Thresholds.learn(samples, scales, settings)
    physical = _label_samples(samples, thresholds, settings)
    residual, smooth = Residual.without_model(samples.error), None
    trusted = _label_motion(samples, physical, residual, thresholds, settings).keep
    if pair.joints and trusted.any():
        # A joint's error about its median is near zero for most samples where slack holds it at one of two ends, and
        # the median of another recording may be at the other end.
        usual = np.quantile(samples.error_lengths[trusted], USUAL, axis=0) / settings.outlier_factor
        thresholds = replace(thresholds, scales=frozen_array(np.maximum(thresholds.scales, usual)))
    if samples[trusted].fresh >= FEWEST_FOR_FIELD:
        smooth, residual = learn_smooth_model(samples, trusted, settings, rng)
        thresholds = replace(thresholds, steps=StepThresholds.learn(samples, residual, settings))
    final = _label_motion(samples, physical, residual, thresholds, settings)
    cleaner = FittedCleaner(pair, found, thresholds, smooth, settings)
    return cleaner, _report(log, labels.replaced(rows, final), cleaner)


@on_one_thread
def clean_with(cleaner: FittedCleaner, log: CalibrationLog) -> CleaningReport:
    """Label the samples of another log by what training data taught.

    Nothing is learned from it but the zeros of its sessions' joints.

    Parameters
    ----------
    cleaner : FittedCleaner, from :func:`fit_cleaner`
    log : CalibrationLog, of the same arm and sensor, in the same tracker frame

    Raises
    ------
    LogError
        The log lacks one of the signals, or it holds other joints.
    """
    settings = cleaner.settings
    rows, labels = _usable(log, cleaner.pair, settings)
    if len(rows):
        samples = samples_of(log, cleaner.pair, rows, cleaner.rigid)
        if samples.units != (known := cleaner.thresholds.steps.units):
            raise LogError(
                f"the cleaning was fitted to groups of units {known}, the log has {samples.units} (P: m, R: rad).",
                hint="Give a log with the same signals: orientations where there were some, and the same joints and "
                "joint_types.",
                path=log.name,
            )
        physical = _label_samples(samples, cleaner.thresholds, settings)
        none = Residual.without_model(samples.error)
        residual = none if cleaner.smooth is None else cleaner.smooth.residual(samples)
        labels = labels.replaced(rows, _label_motion(samples, physical, residual, cleaner.thresholds, settings))
    return _report(log, labels, cleaner)


def _registered(
    log: CalibrationLog,
    pair: Pair,
    rows: IntArray,
    settings: CleaningSettings,
    rng: np.random.Generator,
    marker: MarkerOption,
    rigid: RigidModel | None,
) -> tuple[RigidModel, FloatArray]:
    """Registration of the usable rows, and the robust scales about it; for joints the identity and no scales."""
    if pair.joints:
        return RigidModel(), np.empty(0)
    observed, command = (signal[rows] for signal in pose_pair(log, pair))
    if rigid is None:
        # Least median of squares does not depend on a rigid motion that comes first, so "none" needs no other.
        trajectory = log.trajectory[rows]
        first = marker != "none"
        rigid = register(observed, command, trajectory, marker, held_out=False).model if first else RigidModel()
    both = observed.quaternion is not None and command.quaternion is not None
    found, scales = least_median_pose(rigid.apply(observed), command, settings.resolution("PR" if both else "P"), rng)
    return rigid.followed_by(found), scales


def _usable(log: CalibrationLog, pair: Pair, settings: CleaningSettings) -> tuple[IntArray, Labels]:
    """Rows that the rules label, in recorded order, and the labels of all others: unusable, or dropped by hand."""
    rank = np.empty(len(log), dtype=np.int64)  # of its trajectory, by when it was recorded
    for k, (_, rows) in enumerate(log.trajectories()):
        rank[rows] = k
    order = np.lexsort((log.time, rank))
    labels = Labels.passing(len(log)).rejecting_above(unusable(log, pair, order), Reason.INVALID, 0.0)
    by_hand = segment_mask(log, settings.drop) & ~segment_mask(log, settings.keep)
    labels = labels.rejecting(by_hand, Reason.MANUAL, np.nan, np.nan)
    return order[labels.keep[order]], labels


def _report(log: CalibrationLog, labels: Labels, cleaner: FittedCleaner) -> CleaningReport:
    """Drop trajectories that are nearly all rejected (Mahler 2014, Sec. IV-A), and let the hand overrule every rule."""
    settings = cleaner.settings
    forced = segment_mask(log, settings.keep) & (labels.reason != Reason.INVALID.value)
    _, index = np.unique(log.trajectory, return_inverse=True)
    read = np.zeros(len(log), dtype=bool)
    read[sampled_rows(labels.reason != Reason.INVALID.value)] = True
    passed = np.bincount(index, weights=read & (labels.keep | forced))
    rejected = 1.0 - passed / np.maximum(np.bincount(index, weights=read), 1.0)
    labels = labels.rejecting_above(rejected[index], Reason.TRAJECTORY, settings.trajectory_share)
    return CleaningReport(
        time=log.time,
        trajectory=log.trajectory,
        reason=np.where(forced, "", labels.reason),
        value=labels.value,
        limit=labels.limit,
        overruled=np.where(forced, labels.reason, ""),
    )


def _label_samples(samples: Samples, thresholds: Thresholds, settings: CleaningSettings) -> Labels:
    """Return labels of the physical limits and of frozen observations."""
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


def _label_motion(
    samples: Samples, labels: Labels, residual: Residual, thresholds: Thresholds, settings: CleaningSettings
) -> Labels:
    """Return which samples can be one motion, and which of them registration and smooth model explain.

    Samples that the labels so far reject take no part; the residual is what the smooth model leaves of the error.
    """
    left = np.flatnonzero(labels.keep)
    if len(left) == 0:
        return labels
    steps = thresholds.steps
    path = Path.of(samples[left], residual.along[left], steps, settings.response_time)
    pieces = split_pieces(path)
    from_rigid = medians_of((path.samples.error_lengths / thresholds.scales).max(axis=1), pieces.label)
    from_smooth = medians_of(residual.distance[left], pieces.label)
    badness = np.maximum(from_rigid / settings.outlier_factor, from_smooth / settings.offset_factor)
    dt = np.diff(path.samples.time)
    typical = np.median(dt[dt > 0]) if (dt > 0).any() else settings.occlusion_time
    # Samples of the longest occlusion: what an impossible step inside a chain must be worth.
    occlusion = float(max(FEW, settings.occlusion_time / typical))
    scores = pieces.counts * (1 - badness**2)
    long_enough = (scores > 0) & (pieces.counts >= FEW)
    away = excursions(pieces, long_enough, path, residual.left[left], occlusion)
    chained = largest_chain(pieces, np.where(away, 0.0, scores), path, occlusion)

    def spread(values: FloatArray) -> FloatArray:
        """Values (m,) of pieces as values (n,) of all samples, NaN for those in no piece."""
        whole = np.full(len(samples), np.nan)
        whole[left] = values[pieces.label]
        return whole

    labels = labels.rejecting_above(spread(from_rigid), Reason.OUTLIER, settings.outlier_factor)
    labels = labels.rejecting_above(spread(from_smooth), Reason.OFFSET, settings.offset_factor)
    labels = _reject_unconnected(labels, spread, pieces, ~chained, steps)
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


def _reject_unconnected(
    labels: Labels, spread: Callable[[FloatArray], FloatArray], pieces: Pieces, mask: BoolArray, steps: StepThresholds
) -> Labels:
    """Name the limit that the step into a piece breaks, or the step out of it where that breaks more."""
    out_ratio = np.append(pieces.ratio[1:], 0.0)
    cause = np.where(out_ratio > pieces.ratio, np.append(pieces.cause[1:], 0), pieces.cause)
    ratio = np.where(mask, np.maximum(out_ratio, pieces.ratio), np.nan)
    causes = spread(cause.astype(np.float64))
    for k, (reason, limit) in enumerate(steps.limits):
        value = spread(ratio * limit)
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
    return np.asarray((rejected[high] - rejected[low] - ~keep) / np.maximum(high - low - 1, 1))
