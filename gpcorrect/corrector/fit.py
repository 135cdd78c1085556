"""The recipe: clean, register, learn the residual, calibrate the intervals."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from gpcorrect.cleaning import CleaningReport, Reason
from gpcorrect.corrector.bounds import Bounds
from gpcorrect.corrector.bridging import MotionLimits
from gpcorrect.corrector.clocks import Clocks, on_one_clock
from gpcorrect.corrector.command import CommandCorrector
from gpcorrect.corrector.fit_result import FitResult, fit_remarks, fit_summary
from gpcorrect.corrector.joint_map import JointMap
from gpcorrect.corrector.learn_memory import learn_recall, memory_remark
from gpcorrect.corrector.noise import stencil_step
from gpcorrect.corrector.residual_model import ResidualModel, fit_residual_model, trajectory_folds
from gpcorrect.corrector.scores import normalised, scores_by_trajectory
from gpcorrect.corrector.screening import Screen
from gpcorrect.corrector.settings import MEMORY, FitSettings
from gpcorrect.corrector.training_pairs import TrainingPairs, complete_pair
from gpcorrect.rigid import Registration, RigidModel, register
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, Progress

__all__ = ["fit_command_corrector", "fit_corrector"]


def fit_corrector(
    log: CalibrationLog, settings: FitSettings | None = None, *, progress: Progress | None = None
) -> CommandCorrector:
    """Learn from a log what to command so that the robot reaches a desired pose (Mahler et al. 2014).

    Parameters
    ----------
    log : CalibrationLog
        Must hold `tracker_cp` (what was observed) and `setpoint_cp` (what was commanded).
    settings : FitSettings, optional
        What differs from the defaults.
    progress : Progress, optional
        Told how far the fit is.

    Raises
    ------
    LogError
        A signal is missing or too few samples pass the cleaning.
    DegenerateError
        The motion does not determine the registration.
    """
    return fit_command_corrector(log, settings, progress=progress).corrector


def fit_command_corrector(
    log: CalibrationLog,
    settings: FitSettings | None = None,
    *,
    clocks: Clocks | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Fit as :func:`fit_corrector` does, and return how it came about too.

    `clocks` says that the log is on one clock already, and how it got there; `settings.time_offset` is not asked then.
    """
    # Many small factorisations: two BLAS pools on few cores fight each other and take ten times as long as one thread.
    with threadpool_limits(limits=1):
        return _fit(log, settings or FitSettings(), clocks, progress or Progress())


def _fit(log: CalibrationLog, settings: FitSettings, clocks: Clocks | None, progress: Progress) -> FitResult:
    start = time.perf_counter()
    complete_pair(log)  # refused at once, before any work
    progress.step("clean", 0.0)
    if clocks is None:
        log, clocks = on_one_clock(log, settings.time_offset)
    screen, cleaning = Screen.fit(log, settings.marker if settings.rigid else "none", settings.cleaning, settings.seed)
    progress.step("clean", 1.0)
    step = stencil_step(log) if settings.velocity_step == "auto" else settings.velocity_step
    pairs = TrainingPairs.of(log, _kept(cleaning, settings), step)
    registration = _register(pairs, settings)
    corrector, said = _learn(log, pairs, registration.model, screen, step, settings, progress)
    summary = dict(corrector.summary) | fit_summary(
        log, pairs, registration, clocks, cleaning, settings, time.perf_counter() - start
    )
    return FitResult(
        corrector=replace(corrector, summary=summary),
        log=log,
        clocks=clocks,
        cleaning=cleaning,
        registration=registration,
        n_train=len(pairs.observed),
        summary=summary,
        remarks=(*fit_remarks(log, clocks, registration), *said),
    )


def _kept(cleaning: CleaningReport, settings: FitSettings) -> BoolArray:
    """Return the mask of samples to learn from: those that pass, or without cleaning all but those dropped by hand."""
    return cleaning.keep if settings.clean else cleaning.reason != Reason.MANUAL


def _register(pairs: TrainingPairs, settings: FitSettings) -> Registration:
    if not settings.rigid:
        return Registration(RigidModel(), "the registration was switched off", (), None)
    return register(pairs.observed, pairs.command, pairs.trajectory, settings.marker)


def _learn(
    log: CalibrationLog,
    pairs: TrainingPairs,
    rigid: RigidModel,
    screen: Screen,
    step: float | None,
    settings: FitSettings,
    progress: Progress,
) -> tuple[CommandCorrector, tuple[str, ...]]:
    """Learn the residual, asked for also with memory, and return what there is to say about that."""
    features, samples = pairs.samples(rigid, tuple(kind for kind in settings.features if kind != MEMORY))
    outputs = samples.residual if features.has_orientation else samples.residual[:, :3]

    def learn(X: FloatArray, groups: Sequence[Sequence[int]]) -> ResidualModel:
        times = pairs.trajectory, pairs.time
        return fit_residual_model(
            X, outputs, *times, groups, inducing=settings.inducing, seed=settings.seed, progress=progress
        )

    learned = learn(samples.X, samples.groups)
    corrector = CommandCorrector(
        rigid=rigid,
        features=features,
        predictor=learned.predictor,
        intervals=learned.intervals,
        bounds=Bounds.of(samples.residual, learned.novelty, samples.X, features.slack),
        screen=screen,
        motion=MotionLimits.of(screen.cleaner) if settings.clean else None,
        velocity_step=step,
        summary={},
        check_queries=pairs.check_queries,
        statistics=learned.statistics,
    )
    said: tuple[str, ...] = ()
    if MEMORY in settings.features:
        joints = JointMap.fit(log, settings.seed, orientation=features.has_orientation)
        recall, recalled = learn_recall(samples, joints, learned, corrector.bounds, learn)
        said = (memory_remark(recall.memory, learned, recalled),)
        corrector, learned = replace(corrector, recall=recall), recalled
    return replace(corrector, summary={"baseline": _baseline(learned, pairs.trajectory)}), said


def _baseline(learned: ResidualModel, trajectory: IntArray) -> list[float]:
    """Return the scores of left-out training trajectories, or of left-out blocks of the only one."""
    ratio = normalised(learned.errors, learned.intervals.interval95(learned.std))
    several = len(np.unique(trajectory)) > 1
    scores: list[float] = scores_by_trajectory(ratio, trajectory if several else trajectory_folds(trajectory)).tolist()
    return scores
