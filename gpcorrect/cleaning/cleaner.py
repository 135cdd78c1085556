"""The recipe: rigid model by least median of squares, physical limits, jumps, a second look, whole trajectories, the hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from gpcorrect.cleaning.judge import Ruler, judge_motion, judge_samples
from gpcorrect.cleaning.learning import learn_smooth_model
from gpcorrect.cleaning.limits import Workspace
from gpcorrect.cleaning.prepare import pose_pair, recorded_order, samples_of, unusable
from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.report import CleaningReport
from gpcorrect.cleaning.robust_rigid import fit_rigid_robustly
from gpcorrect.cleaning.samples import fresh_samples, Register, RigidMap, Samples, small_sample_factor
from gpcorrect.cleaning.segments import segment_mask
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.smooth import SecondLook, SmoothModel
from gpcorrect.cleaning.steps import StepRuler
from gpcorrect.cleaning.trajectories import rejected_shares
from gpcorrect.cleaning.verdicts import Verdicts
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, frozen_array

__all__ = ["FittedCleaner", "clean", "clean_with", "fit_cleaner"]

FEWEST_SAMPLES = 4
FEWEST_FOR_FIELD = 12


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
        Factors; segments by hand belong to the training log and are not among them.
    """

    rigid: RigidMap
    ruler: Ruler
    smooth: SmoothModel | None
    settings: CleaningSettings


def clean(log: CalibrationLog, register: Register, settings: CleaningSettings | None = None, *, rng: np.random.Generator) -> CleaningReport:
    """Find the faulty samples of a log: see :func:`fit_cleaner`."""
    return fit_cleaner(log, register, settings, rng=rng)[1]


def fit_cleaner(
    log: CalibrationLog, register: Register, settings: CleaningSettings | None = None, *, rng: np.random.Generator
) -> tuple[FittedCleaner, CleaningReport]:
    """Learn what is normal from a log that holds faults, and find them.
    """
    settings = settings or CleaningSettings()
    order, verdicts = _first_verdicts(log, settings)
    rows = order[verdicts.keep[order]]
    if len(rows) < FEWEST_SAMPLES:
        raise DataError('few')
    observed, command = pose_pair(log)
    found = fit_rigid_robustly(observed[rows], command[rows], register, settings.resolution, rng)
    samples = samples_of(log, rows, found.model)
    look = SecondLook.none(samples.error)
    workspace = Workspace.around(samples.command, settings.workspace_margin)
    ruler = Ruler(found.scales*small_sample_factor(samples), workspace, StepRuler.learn(samples, look, settings))
    physical = judge_samples(samples, ruler, settings)
    smooth = None
    trusted = judge_motion(samples, physical, look, ruler, settings).keep
    if fresh_samples(samples[trusted]) >= FEWEST_FOR_FIELD:
        smooth, look = learn_smooth_model(samples, trusted, settings, rng)
        ruler = replace(ruler, steps=StepRuler.learn(samples, look, settings))
    final = judge_motion(samples, physical, look, ruler, settings)
    cleaner = FittedCleaner(found.model, ruler, smooth, settings)
    return cleaner, _report(log, rows, verdicts, final, cleaner)


def clean_with(cleaner: FittedCleaner, log: CalibrationLog) -> CleaningReport:
    settings = cleaner.settings
    order, verdicts = _first_verdicts(log, settings)
    rows = order[verdicts.keep[order]]
    samples = samples_of(log, rows, cleaner.rigid)
    physical = judge_samples(samples, cleaner.ruler, settings)
    look = SecondLook.none(samples.error) if cleaner.smooth is None else cleaner.smooth.look(samples)
    final = judge_motion(samples, physical, look, cleaner.ruler, settings)
    return _report(log, rows, verdicts, final, cleaner)


def _first_verdicts(log: CalibrationLog, settings: CleaningSettings):
    order = recorded_order(log)
    bad = unusable(log, order)
    verdicts = Verdicts.none(len(log)).rejecting(bad > 0, Reason.INVALID, bad, 0.0)
    by_hand = segment_mask(log, settings.drop) & ~segment_mask(log, settings.keep)
    return order, verdicts.rejecting(by_hand, Reason.MANUAL, np.nan, np.nan)


def _report(log, rows, first, found, cleaner):
    reason, value, limit = (np.array(a) for a in (first.reason.astype('<U16'), first.value, first.limit))
    reason[rows], value[rows], limit[rows] = found.reason, found.value, found.limit
    v = Verdicts(reason, value, limit)
    P = cleaner.settings.trajectory_share
    shares = rejected_shares(log.trajectory, v.keep)
    dropped = {k: s for k, s in shares.items() if s > P}
    whole = np.isin(log.trajectory, list(dropped))
    v = v.rejecting(whole, Reason.TRAJECTORY, np.array([shares[int(k)] for k in log.trajectory]), P)
    forced = segment_mask(log, cleaner.settings.keep) & (v.reason != "invalid")
    over = np.where(forced, v.reason, "")
    reason = np.where(forced, "", v.reason)
    return CleaningReport(log.time, log.trajectory, reason, v.value, v.limit, over, dropped, cleaner.settings, cleaner.ruler.scales, cleaner.rigid)
