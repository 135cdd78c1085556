"""The recipe of cleaning: a robust registration, the rules, the smooth model, whole trajectories, and the hand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.cleaning.classifier import Thresholds, label_motion, label_samples
from gpcorrect.cleaning.least_median import least_median_pose
from gpcorrect.cleaning.report import CleaningReport, Labels, Reason
from gpcorrect.cleaning.settings import CleaningSettings, segment_mask
from gpcorrect.cleaning.signals import POSES, Pair, pose_pair, recorded_order, samples_of, unusable
from gpcorrect.cleaning.smooth import Residual, SmoothModel, learn_smooth_model
from gpcorrect.cleaning.steps import StepThresholds
from gpcorrect.errors import DataError, LogError
from gpcorrect.one_thread import on_one_thread
from gpcorrect.rigid import MarkerOption, RigidModel, register
from gpcorrect.robust import robust_scale
from gpcorrect.types import CalibrationLog, FloatArray, IntArray
from gpcorrect.velocity import sampled_rows

FEWEST_SAMPLES = 4  # that a rigid model with orientations is fitted to
FEWEST_FOR_FIELD = 12  # fresh samples, chosen by hand: fewer cannot tell a smooth error from a fault


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
    physical = label_samples(samples, thresholds, settings)
    residual, smooth = Residual.without_model(samples.error), None
    trusted = label_motion(samples, physical, residual, thresholds, settings).keep
    if samples[trusted].fresh >= FEWEST_FOR_FIELD:
        smooth, residual = learn_smooth_model(samples, trusted, settings, rng)
        thresholds = replace(thresholds, steps=StepThresholds.learn(samples, residual, settings))
    final = label_motion(samples, physical, residual, thresholds, settings)
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

    Returns
    -------
    CleaningReport

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
                hint="Give a log with the same signals: orientations where there were some, and the same joints.",
                path=log.name,
            )
        physical = label_samples(samples, cleaner.thresholds, settings)
        none = Residual.without_model(samples.error)
        residual = none if cleaner.smooth is None else cleaner.smooth.residual(samples)
        labels = labels.replaced(rows, label_motion(samples, physical, residual, cleaner.thresholds, settings))
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
    found = least_median_pose(rigid.apply(observed), command, settings.resolution("PR" if both else "P"), rng)
    return rigid.followed_by(found.model), found.scales


def _usable(log: CalibrationLog, pair: Pair, settings: CleaningSettings) -> tuple[IntArray, Labels]:
    """Rows that the rules label, in recorded order, and the labels of all others: unusable, or dropped by hand."""
    order = recorded_order(log)
    labels = Labels.passing(len(log)).rejecting_above(unusable(log, pair, order), Reason.INVALID, 0.0)
    by_hand = segment_mask(log, settings.drop) & ~segment_mask(log, settings.keep)
    labels = labels.rejecting(by_hand, Reason.MANUAL, np.nan, np.nan)
    return order[labels.keep[order]], labels


def _report(log: CalibrationLog, labels: Labels, cleaner: FittedCleaner) -> CleaningReport:
    """Drop trajectories that are nearly all rejected (Mahler 2014, Sec. IV-A), and let the hand overrule every rule."""
    settings = cleaner.settings
    forced = segment_mask(log, settings.keep) & (labels.reason != Reason.INVALID.value)
    numbers, index = np.unique(log.trajectory, return_inverse=True)
    read = np.zeros(len(log), dtype=bool)
    read[sampled_rows(labels.reason != Reason.INVALID.value)] = True
    passed = np.bincount(index, weights=read & (labels.keep | forced))
    rejected = 1.0 - passed / np.maximum(np.bincount(index, weights=read), 1.0)
    dropped = rejected > settings.trajectory_share
    labels = labels.rejecting_above(rejected[index], Reason.TRAJECTORY, settings.trajectory_share)
    return CleaningReport(
        time=log.time,
        trajectory=log.trajectory,
        reason=np.where(forced, "", labels.reason),
        value=labels.value,
        limit=labels.limit,
        overruled=np.where(forced, labels.reason, ""),
        dropped_trajectories=dict(zip(numbers[dropped].tolist(), rejected[dropped].tolist(), strict=True)),
        settings=settings,
        scales=cleaner.thresholds.scales,
        rigid=cleaner.rigid,
    )
