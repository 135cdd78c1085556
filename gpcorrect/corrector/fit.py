"""The recipe: clean, register, learn the residual, calibrate the intervals."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from gpcorrect.cleaning import CleaningReport, CleaningSettings, Reason
from gpcorrect.corrector.bounds import Bounds
from gpcorrect.corrector.bridging import MotionLimits
from gpcorrect.corrector.clocks import Clocks, on_one_clock
from gpcorrect.corrector.command import CommandCorrector
from gpcorrect.corrector.joint_map import JointMap
from gpcorrect.corrector.learn_memory import Samples, learn_recall, memory_remark
from gpcorrect.corrector.noise import stencil_step
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.corrector.reference import reference_twists, rotations_of
from gpcorrect.corrector.residual_model import ResidualModel, fit_residual_model, trajectory_folds
from gpcorrect.corrector.scores import normalised, scores_by_trajectory
from gpcorrect.corrector.screening import Screen
from gpcorrect.corrector.usable import Pairs, usable_pairs
from gpcorrect.gpr import FeatureMap
from gpcorrect.rigid import MarkerOption, Registration, RigidModel, pose_residual, register
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, Progress

__all__ = ["FitResult", "FitSettings", "fit_command_corrector", "fit_corrector"]

MEMORY = "memory"
CHECK_QUERIES = 8


@dataclass(frozen=True)
class FitSettings:
    """What `fit_corrector` may be told.

    Parameters
    ----------
    features : tuple of str
        "pose" (or "euler": the paper's angles), "velocity", and "memory": states of play operators of the path so far.
    clean : bool
        Reject faulty samples first.
    cleaning : CleaningSettings
        Limits of the cleaning.
    rigid : bool
        Register frames first; without it the regression learns from the observed pose as it is.
    marker : str
        "none", "solve" or "auto": whether the marker may be away from the tool tip.
    inducing : int
        Inducing points of the sparse regression.
    time_offset : str
        "auto", "none", or seconds by which the tracker's stamps run ahead of the commands'.
    velocity_step : float, None or "auto"
        Step of the stencil on recorded paths, s, through all samples within two steps on either side; None takes five
        neighbouring samples, "auto" a step that keeps the tracker's noise out of the velocities.
    seed : int
        Seed of everything random.

    Raises
    ------
    DataError
        A feature is unknown.
    """

    features: tuple[str, ...] = ("pose", "velocity")
    clean: bool = True
    cleaning: CleaningSettings = field(default_factory=CleaningSettings)
    rigid: bool = True
    marker: MarkerOption = "auto"
    inducing: int = 700
    time_offset: str = "auto"
    velocity_step: float | Literal["auto"] | None = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        FeatureMap([kind for kind in self.features if kind != MEMORY])  # refuses unknown ones


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted corrector and how it came about.

    Parameters
    ----------
    corrector : CommandCorrector
        What was fitted.
    log : CalibrationLog
        What it was fitted to: the training log, on one clock.
    clocks : Clocks
        What was found of the tracker's clock.
    cleaning : CleaningReport
        What was dropped from the training log, and why.
    registration : Registration
        Which rigid model was chosen, and why.
    n_train : int
        Samples that the regression learned from.
    summary : mapping
        The same in figures, JSON-able; also in the model file.
    remarks : tuple of str
        What a person should know, in sentences.
    """

    corrector: CommandCorrector
    log: CalibrationLog
    clocks: Clocks
    cleaning: CleaningReport
    registration: Registration
    n_train: int
    summary: Mapping[str, Any]
    remarks: tuple[str, ...]


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
    progress.step("clean", 0.0)
    if clocks is None:
        log, clocks = on_one_clock(log, settings.time_offset)
    usable_pairs(log, np.ones(len(log), dtype=bool), None)  # what no cleaning can mend is said at once
    screen, cleaning = Screen.fit(log, settings.marker if settings.rigid else "none", settings.cleaning, settings.seed)
    progress.step("clean", 1.0)
    step = stencil_step(log) if settings.velocity_step == "auto" else settings.velocity_step
    pairs = usable_pairs(log, _kept(cleaning, settings), step)
    registration = _register(pairs, settings)
    corrector, said = _learn(log, pairs, registration.model, screen, step, settings, progress)
    summary = dict(corrector.summary) | _summary(
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
        remarks=(*_remarks(log, clocks, registration), *said),
    )


def _kept(cleaning: CleaningReport, settings: FitSettings) -> BoolArray:
    """Return the mask of samples to learn from: those that pass, or without cleaning all but those dropped by hand."""
    return cleaning.keep if settings.clean else cleaning.reason != Reason.MANUAL


def _register(pairs: Pairs, settings: FitSettings) -> Registration:
    if not settings.rigid:
        return Registration(RigidModel(), "the registration was switched off", (), None)
    return register(pairs.observed, pairs.command, pairs.trajectory, settings.marker)


def _learn(
    log: CalibrationLog,
    pairs: Pairs,
    rigid: RigidModel,
    screen: Screen,
    step: float | None,
    settings: FitSettings,
    progress: Progress,
) -> tuple[CommandCorrector, tuple[str, ...]]:
    """Learn the residual, asked for also with memory, and return what there is to say about that."""
    features, samples = _samples(pairs, rigid, settings)
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
        check_queries=_check_queries(pairs),
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


def _samples(pairs: Pairs, rigid: RigidModel, settings: FitSettings) -> tuple[FeatureMap, Samples]:
    reference = rigid.apply(pairs.observed)
    rotations = rotations_of(reference)
    inputs = (reference.position, rotations, reference_twists(rigid, rotations_of(pairs.observed), pairs.twist))
    features = FeatureMap([kind for kind in settings.features if kind != MEMORY]).fit(*inputs)
    residual = pose_residual(reference, pairs.command)
    X = features.transform(*inputs)
    return features, Samples(X, features.groups, residual, reference.position, rotations, pairs.trajectory)


def _check_queries(pairs: Pairs) -> FloatArray:
    """Pick training queries spread over the recording: pose (unturned in a position-only log) and twist."""
    rows = np.unique(np.linspace(0, len(pairs.observed) - 1, CHECK_QUERIES).astype(np.int64))
    observed = pairs.observed[rows]
    unturned = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))
    quaternion = unturned if observed.quaternion is None else observed.quaternion
    return np.hstack([observed.position, quaternion, np.nan_to_num(pairs.twist[rows])])


def _summary(
    log: CalibrationLog,
    pairs: Pairs,
    registration: Registration,
    clocks: Clocks,
    cleaning: CleaningReport,
    settings: FitSettings,
    seconds: float,
) -> dict[str, Any]:
    """Collect what the model file says of itself."""
    low, high = pairs.observed.position.min(axis=0), pairs.observed.position.max(axis=0)
    return {
        "robot": log.meta.robot,
        "arm": log.meta.arm,
        "frames": {"input": "tracker", "output": "base"},
        "units": {"position": "m", "rotation": "rad", "quaternion": "wxyz"},
        "features": list(settings.features),
        "orientation": pairs.observed.quaternion is not None,
        "training_region": {"position_min": low.tolist(), "position_max": high.tolist()},
        "data": {"source": log.name, "sha256": log.digest},
        "fit": {
            "n_train": len(pairs.observed),
            "n_trajectories": len(np.unique(pairs.trajectory)),
            "dropped": dict(cleaning.counts),
            "registration": registration.to_dict(),
            "tracker_shift": clocks.applied,
            "seed": settings.seed,
            "seconds": seconds,
        },
    }


def _remarks(log: CalibrationLog, clocks: Clocks, registration: Registration) -> tuple[str, ...]:
    said = [*log.remarks, f"registration: {registration.reason}"]
    if clocks.applied:
        said.append(clocks.remark)
    observed, _ = pose_pair(log)
    if observed.quaternion is None:
        said.append("the log holds positions only: orientations are turned into the base frame and left uncorrected")
    return tuple(said)
