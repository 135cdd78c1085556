"""The recipe of cleaning: a robust rigid model, the rules, a second look, whole trajectories, and the hand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.cleaning.judge import Ruler, judge_motion, judge_samples
from gpcorrect.cleaning.learning import learn_smooth_model
from gpcorrect.cleaning.limits import Workspace
from gpcorrect.cleaning.prepare import pose_pair, recorded_order, samples_of, unusable
from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.report import CleaningReport
from gpcorrect.cleaning.robust_rigid import fit_rigid_robustly
from gpcorrect.cleaning.samples import Register, RigidMap, Samples, fresh_samples, small_sample_factor
from gpcorrect.cleaning.segments import segment_mask
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.smooth import SecondLook, SmoothModel
from gpcorrect.cleaning.steps import StepRuler
from gpcorrect.cleaning.trajectories import rejected_shares
from gpcorrect.cleaning.verdicts import Verdicts
from gpcorrect.errors import DataError
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

__all__ = ["FittedCleaner", "clean", "clean_with", "fit_cleaner"]

FEWEST_SAMPLES = 4  # a rigid model with orientations and a marker offset
FEWEST_FOR_FIELD = 12  # fresh samples: fewer cannot tell a smooth error from a fault


@dataclass(frozen=True, eq=False)
class FittedCleaner:
    """The ruler that training data taught, for judging any log of the same arm and tracker.

    Parameters
    ----------
    rigid : RigidMap
        Robust registration.
    ruler : Ruler
        Scales and limits.
    smooth : SmoothModel or None
        Smooth model of the error; None where there were too few samples to learn one.
    settings : CleaningSettings
        Factors, and segments by hand: these hold in every log that is judged, by its trajectory numbers and times.
    """

    rigid: RigidMap
    ruler: Ruler
    smooth: SmoothModel | None
    settings: CleaningSettings


def clean(
    log: CalibrationLog, register: Register, settings: CleaningSettings | None = None, *, rng: np.random.Generator
) -> CleaningReport:
    """Find the faulty samples of a log.

    Parameters and errors are those of :func:`fit_cleaner`, which also returns what was learned.

    Returns
    -------
    CleaningReport
    """
    return fit_cleaner(log, register, settings, rng=rng)[1]


def fit_cleaner(
    log: CalibrationLog, register: Register, settings: CleaningSettings | None = None, *, rng: np.random.Generator
) -> tuple[FittedCleaner, CleaningReport]:
    """Learn what is normal from a log that holds faults, and find them.

    Least median of squares around the rigid model gives robust scales (Mahler 2014, Sec. IV-A); samples that pass the
    physical limits and the limits on steps teach a smooth model of the error; then all samples are judged beside it.

    Parameters
    ----------
    log : CalibrationLog
        Holds `tracker_cp` (observed) and `setpoint_cp` (commanded), each with or without orientations.
    register : callable
        Least-squares registration of any number of observed to commanded poses; called many times.
    settings : CleaningSettings, optional
        What differs from the defaults.
    rng : numpy Generator
        Source of the random samples; the same state gives the same report.

    Returns
    -------
    cleaner : FittedCleaner
        What was learned, for :func:`clean_with`.
    report : CleaningReport
        Which samples of `log` are kept, and why the others are not.

    Raises
    ------
    LogError
        The log lacks observed or commanded poses.
    DataError
        Fewer than four samples are complete and not dropped by hand.
    DegenerateError
        The motion does not determine a registration.
    """
    settings = settings or CleaningSettings()
    rows, verdicts = _usable(log, settings)
    _require_enough(len(rows), len(log))
    observed, command = pose_pair(log)
    found = fit_rigid_robustly(observed[rows], command[rows], register, settings.resolution, rng)
    samples = samples_of(log, rows, found.model)
    ruler = _first_ruler(samples, found.scales, settings)
    physical = judge_samples(samples, ruler, settings)
    look, smooth = SecondLook.none(samples.error), None
    trusted = judge_motion(samples, physical, look, ruler, settings).keep
    if fresh_samples(samples[trusted]) >= FEWEST_FOR_FIELD:
        smooth, look = learn_smooth_model(samples, trusted, settings, rng)
        ruler = replace(ruler, steps=StepRuler.learn(samples, look, settings))
    final = judge_motion(samples, physical, look, ruler, settings)
    cleaner = FittedCleaner(found.model, ruler, smooth, settings)
    return cleaner, _report(log, verdicts.replaced(rows, final), cleaner)


def clean_with(cleaner: FittedCleaner, log: CalibrationLog) -> CleaningReport:
    """Judge the samples of another log by what training data taught; nothing is learned from it.

    Parameters
    ----------
    cleaner : FittedCleaner
        From :func:`fit_cleaner`.
    log : CalibrationLog
        Of the same arm and tracker, in the same tracker frame.

    Returns
    -------
    CleaningReport

    Raises
    ------
    LogError
        The log lacks observed or commanded poses.
    """
    settings = cleaner.settings
    rows, verdicts = _usable(log, settings)
    if len(rows):
        samples = samples_of(log, rows, cleaner.rigid)
        physical = judge_samples(samples, cleaner.ruler, settings)
        look = cleaner.smooth.look(samples) if cleaner.smooth else SecondLook.none(samples.error)
        verdicts = verdicts.replaced(rows, judge_motion(samples, physical, look, cleaner.ruler, settings))
    return _report(log, verdicts, cleaner)


def _usable(log: CalibrationLog, settings: CleaningSettings) -> tuple[IntArray, Verdicts]:
    """Rows that the rules judge, in recorded order, and the verdicts on all others: unusable, or dropped by hand."""
    order = recorded_order(log)
    bad = unusable(log, order)
    verdicts = Verdicts.none(len(log)).rejecting(bad > 0, Reason.INVALID, bad, 0.0)
    by_hand = segment_mask(log, settings.drop) & ~segment_mask(log, settings.keep)
    verdicts = verdicts.rejecting(by_hand, Reason.MANUAL, np.nan, np.nan)
    return order[verdicts.keep[order]], verdicts


def _require_enough(usable: int, came: int) -> None:
    if usable < FEWEST_SAMPLES:
        raise DataError(
            f"cleaning needs at least {FEWEST_SAMPLES} complete samples that are not dropped by hand, got {usable}"
            f" of {came}.",
            hint="Look for missing numbers in tracker_cp and setpoint_cp, times that repeat, and segments to drop.",
        )


def _first_ruler(samples: Samples, scales: FloatArray, settings: CleaningSettings) -> Ruler:
    """Scales and limits before there is a smooth model."""
    return Ruler(
        scales=scales * small_sample_factor(samples),
        workspace=Workspace.around(samples.command, settings.workspace_margin),
        steps=StepRuler.learn(samples, SecondLook.none(samples.error), settings),
    )


def _report(log: CalibrationLog, verdicts: Verdicts, cleaner: FittedCleaner) -> CleaningReport:
    """Drop trajectories that are nearly all rejected, and let the hand overrule every rule that it can."""
    settings = cleaner.settings
    forced = segment_mask(log, settings.keep) & (verdicts.reason != Reason.INVALID.value)
    shares = rejected_shares(log.trajectory, verdicts.keep | forced)
    dropped = {number: share for number, share in shares.items() if share > settings.trajectory_share}
    share = np.array([shares[int(number)] for number in log.trajectory])
    verdicts = verdicts.rejecting(
        share > settings.trajectory_share, Reason.TRAJECTORY, share, settings.trajectory_share
    )
    return CleaningReport(
        time=log.time,
        trajectory=log.trajectory,
        reason=np.where(forced, "", verdicts.reason),
        value=verdicts.value,
        limit=verdicts.limit,
        overruled=np.where(forced, verdicts.reason, ""),
        dropped_trajectories=dropped,
        settings=settings,
        scales=cleaner.ruler.scales,
        rigid=cleaner.rigid,
    )
