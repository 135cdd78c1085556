"""The one recipe: put the log on one clock, clean it, learn a law, calibrate its intervals, bound its answers."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.domain import Bounds, Domain, Surroundings
from gpcorrect.calibration.history import step_now
from gpcorrect.calibration.law import Law
from gpcorrect.calibration.learners import learner_named
from gpcorrect.calibration.loads import Loads
from gpcorrect.calibration.sessions import sessions_lost, widening
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.calibration.task import Corrector, recording_entry
from gpcorrect.cleaning import CleaningReport, Pair, Reason, fit_cleaner
from gpcorrect.errors import LogError
from gpcorrect.gpr import IntervalCalibration, LeftOut, novelty_limit
from gpcorrect.logs.copies import marks_of
from gpcorrect.logs.sync import Clocks, match_clocks
from gpcorrect.one_thread import on_one_thread
from gpcorrect.types import CalibrationLog, PoseSignal, Progress

C = TypeVar("C", bound=Corrector)


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted corrector and how it came about.

    Parameters
    ----------
    corrector : Corrector, what was fitted
    log : CalibrationLog, what it was fitted to: the training log, on one clock
    clocks : Clocks, what was found of the outside sensor's clock, and what was done about it
    cleaning : CleaningReport, what was dropped from the training log, and why
    registration : Registration or None, which rigid model was chosen, and why; None for a task without one
    n_train : int, samples that were learned from
    remarks : tuple of str, what a person should know, in sentences
    """

    corrector: Any
    log: CalibrationLog
    clocks: Clocks
    cleaning: CleaningReport
    registration: Any
    n_train: int
    remarks: tuple[str, ...]


def fit_corrector(log: CalibrationLog, settings: FitSettings | None = None) -> CommandCorrector:
    """Learn from a log what to command so that the robot reaches a desired pose (Mahler et al. 2014).

    Parameters
    ----------
    log : CalibrationLog, must hold `tracker_cp` (what was observed) and `setpoint_cp` (what was commanded)
    settings : FitSettings, optional, what differs from the defaults

    Raises
    ------
    LogError
        A signal is missing or too few samples pass the cleaning.
    DegenerateError
        The motion does not determine the registration.
    """
    corrector: CommandCorrector = fit_model(log, settings).corrector
    return corrector


@on_one_thread
def fit_model(
    log: CalibrationLog,
    settings: FitSettings | None = None,
    *,
    task: type[Corrector] = CommandCorrector,
    progress: Progress | None = None,
) -> FitResult:
    """Fit a corrector of any task, and return how it came about too.

    Parameters
    ----------
    log : CalibrationLog, holds the task's signals
    settings : FitSettings, optional, what differs from the defaults
    task : type, A subclass of :class:`Corrector`
    progress : Progress, optional

    Raises
    ------
    LogError, DataError, DegenerateError
        The log does not determine a model.
    """
    settings, progress, start = settings or FitSettings(), progress or Progress(), time.perf_counter()
    learner_named(settings.method)
    pair = task.pair(log, settings)  # refused at once, before any work
    _refuse_still(log, pair)
    marks = marks_of(log)  # as it came: a sensor that is shifted in time reads other numbers
    progress.step("clean", 0.0)
    log, clocks = match_clocks(log, pair.observed, pair.command, settings.time_offset)
    cleaner, cleaning = fit_cleaner(
        log,
        settings.cleaning,
        rng=np.random.default_rng(settings.seed),
        pair=pair,
        marker=settings.marker if settings.rigid else "none",
    )
    progress.step("clean", 1.0)
    lag = clocks.offset if clocks.applied == 0.0 else None  # what is left of it, where the sensor was shifted
    if lag is None:
        lag = match_clocks(log, pair.observed, pair.command, "auto", shifts=False)[1].offset if not log.static else None
    keep = cleaning.keep if settings.clean else cleaning.reason != Reason.MANUAL
    left_out = set(Reason) if settings.clean else {Reason.INVALID, Reason.MANUAL}
    learn_law = partial(_learn_law, settings=settings, progress=progress)
    outcome = task.learn(log, keep, cleaner, settings, learn_law)
    lost = sessions_lost(log, cleaning) if settings.clean else ()
    remarks = [*log.remarks, *outcome.remarks, *lost, *_too_little(outcome.samples), *clocks.notes]
    n_train, registration = len(outcome.samples.rows), outcome.registration
    summary = {
        "robot": log.meta.robot,
        "arm": log.meta.arm,
        **({"joint_names": list(log.meta.joint_names)} if log.meta.joint_names else {}),
        "method": settings.method,
        **outcome.report,
        "data": recording_entry(log, marks),
        "fit": {
            "n_train": n_train,
            "n_trajectories": len(np.unique(outcome.samples.trajectory[outcome.samples.rows])),
            "dropped": {reason: count for reason, count in cleaning.counts.items() if reason in left_out},
            **({} if registration is None else {"registration": registration.to_dict()}),
            "tracker_shift": clocks.applied,
            "tracker_lag": {} if lag is None or not lag.observable else {lag.reference: lag.offset},
            "seed": settings.seed,
            "seconds": time.perf_counter() - start,
        },
        "remarks": remarks,
        "baseline": outcome.baseline.tolist(),
    }
    return FitResult(
        corrector=replace(outcome.corrector, summary=summary, history=(step_now("fit", log),)),
        log=log,
        clocks=clocks,
        cleaning=cleaning,
        registration=registration,
        n_train=n_train,
        remarks=tuple(remarks),
    )


def _refuse_still(log: CalibrationLog, pair: Pair) -> None:
    """Refuse poses that never change, commanded or seen; joints are looked at one by one where they are learned."""
    for name in () if pair.joints else (pair.command, pair.observed):
        signal: PoseSignal = getattr(log, name)
        table = signal[signal.finite].table
        if len(table) > 1 and (table == table[0]).all():
            raise LogError(
                f"{name} never changes, and of a robot that stands still nothing can be learned.",
                hint="Record motion through where the robot will work. See: gpcorrect validate LOG",
                path=log.name,
            )


def _learn_law(samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> tuple[Law, LeftOut]:
    """Learn a law and calibrate its intervals on predictions of samples whose fold it was not fitted to."""
    fitted = learner_named(settings.method)(samples, layout, settings, progress)
    X, target = samples.learnable()
    rows = samples.rows
    left_out = fitted.judged()
    known = np.isfinite(left_out.errors).all(axis=1)
    errors, std = left_out.errors[known], left_out.std[known]
    correction = target - samples.origin[rows]
    trajectory, std = samples.trajectory[rows][known], np.maximum(std, np.finfo(float).tiny)
    parts = samples.folds[known]
    intervals = IntervalCalibration.fit(errors, std, trajectory, parts)
    bounded, novelty = X[:, : len(layout.slack)], novelty_limit(left_out.novelty)
    domain = Domain.of(bounded, layout.slack, novelty, correction, layout.fading)
    # Outside the region an interval is no narrower than one of no correction would be: its deviation, in what those of
    # this learner are worth.
    raw = np.broadcast_to(np.maximum(domain.spread, np.finfo(float).tiny), errors.shape)
    uncorrected = IntervalCalibration.fit(correction[known], raw, trajectory, parts).factor
    worth = np.where(intervals.factor > 0.0, uncorrected / np.maximum(intervals.factor, np.finfo(float).tiny), 1.0)
    near = Surroundings.of(bounded, samples.trajectory[rows], layout.place)
    loads = Loads.of(bounded, samples.trajectory[rows], layout)
    domain = replace(domain, spread=domain.spread * worth, near=near, loads=loads)
    law = Law(
        learned=fitted.learned,
        intervals=intervals.widened(widening(samples, fitted.left_out.errors, layout.targets)),
        domain=domain,
        bounds=Bounds.of(correction, layout.targets),
        zero=np.zeros(target.shape[1]) if fitted.zero is None else fitted.zero,
    )
    return law, left_out


def _too_little(samples: Samples) -> list[str]:
    """Return a warning where few motions were learned from."""
    motions = samples.motions
    if motions >= LIMITS.enough_motions:
        return []
    what = "one motion" if motions == 1 else f"{motions} motions"
    return [
        f"learned from {what} only, which say little of how errors differ from one to the next: intervals were widened "
        f"{samples.widening:.1f} times; record {LIMITS.enough_motions} or more"
    ]
