"""One experiment of any task: split, fit on the first part, measure on the last, clean and dirty."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.dataset import HoldOut, held_out
from gpcorrect.calibration.fit import FitResult, fit_model
from gpcorrect.calibration.history import HeldOut, PartErrors
from gpcorrect.calibration.joints import JointCorrector
from gpcorrect.calibration.metrics import spread
from gpcorrect.calibration.sessions import sessions_apart
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.calibration.task import Corrector, Measured
from gpcorrect.calibration.unlike_training import CAUTION, OTHER_FRAME, clean_changed
from gpcorrect.cleaning import CleaningReport, Reason, require_segments
from gpcorrect.logs.copies import LEAST, marks_of
from gpcorrect.one_thread import on_one_thread
from gpcorrect.types import BoolArray, CalibrationLog, Progress

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
LEAST_HELD = 0.9  # of the errors by a 95 % interval: below, it misses more than twice as many as it promises


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A model measured on one log twice: on the samples that pass cleaning, and on all of them as they came.

    The clean set has velocities that never cross a rejected sample; the dirty set has those that the path as it came
    shows. `first` is what a reader must know of the data before all else.
    """

    corrector: Corrector
    clean: Measured
    dirty: Measured
    cleaning: CleaningReport
    first: tuple[str, ...] = ()

    @property
    def clean_errors(self) -> dict[str, Any]:
        """Table of errors of each method on samples that pass cleaning, as the task quotes them."""
        return self._errors(self.clean)

    @property
    def dirty_errors(self) -> dict[str, Any]:
        """The same on all samples."""
        return self._errors(self.dirty)

    def _errors(self, measured: Measured) -> dict[str, Any]:
        return {name: self.corrector.error_table(measured.of(name)) for name in self.corrector.METHODS}

    @property
    def cautions(self) -> tuple[str, ...]:
        """What a reader must know before using the model, a sentence each."""
        return (*self.first, *self._few_passed(), *self._too_narrow(), *self._in_vain())

    def _few_passed(self) -> Iterator[str]:
        """Say where the errors are those of a minority that resembles the training."""
        passed, measured = len(self.clean.rows), len(self.dirty.rows)
        if 2 * passed < measured:  # cleaning holds where no more than half of the samples are wrong
            yield (
                f"only {passed} of {measured} samples pass cleaning by the training's thresholds: their errors say "
                "little of the others. Another homing, tool or frame, or faster motion, looks like this"
            )

    def _too_narrow(self) -> Iterator[str]:
        """Say where the intervals hold fewer errors than the scatter of the trajectories explains."""
        clean, parts = self.clean, [("these errors", tuple(range(self.clean.raw.shape[1])))]
        if isinstance(self.corrector, JointCorrector):  # of all joints together, one that is missed does not show
            parts = [(f"the errors of {p.name}", p.columns) for p in self.corrector.measured_parts(clean)]
        each = np.array([clean.at(clean.trajectory == label).coverage95 for label in np.unique(clean.trajectory)])
        found = []
        for errors, columns in parts:
            held = each[:, columns]
            held = np.nanmean(held[np.isfinite(held).any(axis=1)], axis=1)
            if len(held) < 2:
                continue
            most = held.mean() + stdtrit(len(held) - 1, 0.975) * held.std(ddof=1) / math.sqrt(len(held))
            if most < LEAST_HELD:
                found.append(f"{100 * np.nanmean(clean.coverage95[list(columns)]):.0f} % of {errors}")
        if found:
            yield (
                f"95 % intervals cover only {' and '.join(found)}: the arm misses otherwise than in the training, as "
                "after another homing, with another load or tool, in another frame or by another clock"
            )

    def _in_vain(self) -> Iterator[str]:
        """Name the parts where learning hardly beat the simplest remedy."""
        clean, learned = self.clean, len(self.corrector.law.zero)
        causes = (
            ". More motion is needed, or the parts of the recording do not go together: the tracker, base or tool "
            "moved between sessions, rows were exchanged, clocks are apart. See: gpcorrect validate LOG"
        )
        # a joint may have little to learn beyond its zero
        least = 0.0 if isinstance(self.corrector, JointCorrector) else LIMITS.least_lessened
        causes = "" if CAUTION in self.first else causes  # which names the cause
        for part in self.corrector.parts(clean.raw.shape[1]):
            if max(part.columns) >= learned:  # rotations, where positions alone are corrected
                continue
            before, after = (spread(part.sizes(errors))["rmse"] for errors in (clean.registered, clean.corrected))
            if before > 0 and after >= (1.0 - least) * before:
                remedy = "registration" if self.corrector.METHODS[1] == "rigid" else "a fixed offset"
                lessens = "does not lessen" if after >= before else f"takes away only {1 - after / before:.0%} of"
                yield (
                    f"on held-out trajectories the learned part {lessens} the {part.name} error (RMSE "
                    f"{before:#.4g} {part.unit} after {remedy}, {after:#.4g} {part.unit} corrected){causes}"
                )

    @property
    def coverage95(self) -> float:
        """Fraction of the errors of clean samples inside their 95 % intervals; NaN where none was."""
        return self.clean.share_held

    def held_out(self) -> HeldOut:
        """Return what the model file remembers of this measurement."""
        clean = self.clean
        count, inside = len(np.unique(clean.trajectory)), float(clean.in_domain.mean())
        return HeldOut(len(clean.rows), count, part_errors(self.corrector, clean), self.coverage95, inside)

    def to_dict(self) -> dict[str, Any]:
        """Return errors, coverage of the 95 % intervals and share in domain: of samples that pass cleaning, and all."""
        fractions = self.clean.coverage95
        names = (
            [f"J{j + 1}" for j in range(len(fractions))] if isinstance(self.corrector, JointCorrector) else COMPONENTS
        )
        return {
            "errors": self.clean_errors,
            "errors_dirty": self.dirty_errors,
            "coverage95": self.coverage95,
            "coverage95_axes": dict(zip(names, fractions.tolist(), strict=False)),
            "coverage95_dirty": self.dirty.share_held,
            "in_domain": float(self.clean.in_domain.mean()),
            "in_domain_dirty": float(self.dirty.in_domain.mean()),
            "cautions": list(self.cautions),
        }


@dataclass(frozen=True, eq=False)
class Experiment:
    """A fit and its measurement on held-out units."""

    fit: FitResult
    test: CalibrationLog | None
    evaluation: Evaluation | None
    seconds: float

    @property
    def corrector(self) -> Any:
        """The fitted corrector."""
        return self.fit.corrector

    @property
    def n_test(self) -> int:
        """Samples that were measured on."""
        return len(self.evaluation.clean.rows) if self.evaluation else 0

    def to_dict(self) -> dict[str, Any]:
        """Return counts, what was dropped, seconds, errors and coverage, JSON-able."""
        dropped = Counter(self.corrector.summary["fit"]["dropped"])
        if self.evaluation is not None:
            dropped.update(self.evaluation.cleaning.counts)
        measured = (
            self.evaluation.to_dict() if self.evaluation else {"errors": {}, "errors_dirty": {}, "coverage95": None}
        )
        return {
            "n_train": self.fit.n_train,
            "n_test": self.n_test,
            "dropped": dict(dropped),
            "seconds": self.seconds,
            **measured,
            "model": dict(self.corrector.summary),
        }


def run_experiment(
    log: CalibrationLog,
    settings: FitSettings | None = None,
    *,
    task: type[Corrector] = CommandCorrector,
    holdout: float = 0.2,
    by: HoldOut = HoldOut.AUTO,
    shuffle: bool = False,
    progress: Progress | None = None,
) -> Experiment:
    """Fit on a part of a log and measure the error on the rest.

    Parameters
    ----------
    log : CalibrationLog, holds the task's signals
    settings : FitSettings, optional, what differs from the defaults
    task : type, A subclass of :class:`Corrector`
    holdout : float, fraction of the units to measure on; 0 for none
    by : HoldOut, what is held out whole
    shuffle : bool, hold out random units, not the last ones
    progress : Progress, optional

    Raises
    ------
    LogError
        Signals are missing, or nothing can be held out.
    DataError
        The data do not determine a model, or a segment to keep or drop is not in the log.
    """
    settings = settings or FitSettings()
    start = time.perf_counter()
    require_segments(log, (*settings.cleaning.keep, *settings.cleaning.drop))
    rng = np.random.default_rng(settings.seed) if shuffle else None
    held = held_out(log, holdout, by, rng=rng)
    result = fit_model(log.select(~held) if held.any() else log, settings, task=task, progress=progress)
    if not held.any():
        return Experiment(result, None, None, time.perf_counter() - start)
    measured = _measured(result, log, held)
    both = np.intersect1d(marks_of(log.select(held)), marks_of(log.select(~held)), assume_unique=True)
    if len(both) >= LEAST:
        caution = (
            "held-out trajectories hold samples that were learned from too: errors on them are those of a model that "
            "knows the answers"
        )
        measured = replace(measured, first=(*measured.first, caution))
    step = replace(result.corrector.history[-1], held_out=measured.held_out())
    result = replace(result, corrector=replace(result.corrector, history=(step,)))
    return Experiment(result, log.select(held), measured, time.perf_counter() - start)


def _measured(result: FitResult, log: CalibrationLog, held: BoolArray) -> Evaluation:
    """Measure on held-out truth: as it came, unless the user stated by how much its clock is off."""
    clocks = result.clocks
    if not clocks.applied:
        return evaluate_model(result.corrector, log, held=held)
    moved, _ = result.corrector.on_one_clock(log, str(clocks.applied))
    if clocks.offset is None:
        return evaluate_model(result.corrector, moved, held=held)
    cleaning = result.corrector.clean(moved.select(held))  # the clock is not what cleaning looks for
    caution = (
        f"the training's outside sensor was shifted by {clocks.applied:.4g} s, as its motion suggests; the held-out "
        "part was not, and its errors hold that time. If the clocks do differ, state it: "
        f"--time-offset {clocks.applied:.4g}; if the robot is that late: --time-offset none"
    )
    return replace(evaluate_model(result.corrector, log, cleaning, held=held), first=(caution,))


@on_one_thread
def evaluate_model(
    corrector: Corrector, log: CalibrationLog, cleaning: CleaningReport | None = None, *, held: BoolArray | None = None
) -> Evaluation:
    """Measure what a corrector would have answered on a log.

    Parameters
    ----------
    corrector : Corrector, of any task
    log : CalibrationLog, n samples of the task's signals, on one clock
    cleaning : CleaningReport, optional
        Which of the measured samples count as clean; classified by the training's thresholds without it, or by the
        log's own where those reject all samples of an arm that changed.
    held : (n,) mask, optional
        Samples to measure on; all without it. The motion before them is known, as it is to a stream: the side of its
        slack that a joint lies on, how long it rested. Where the robot ended up there is not looked at.

    Raises
    ------
    LogError
        The log lacks a signal, no sample can be measured, or it is of another frame.
    DataError
        Its stamps cannot be seconds.
    """
    log = corrector.in_joint_order(log)
    first = corrector.cautions(log) if held is None else ()
    held = np.ones(len(log), dtype=bool) if held is None else held
    part = log if held.all() else log.select(held)
    cleaning = cleaning or corrector.clean(part)
    if not cleaning.keep.any():
        cleaning = clean_changed(corrector, part, cleaning, *_refused(held, log))
        first = (*first, CAUTION)
    passed = np.zeros(len(log), dtype=bool)
    passed[held] = cleaning.keep
    place = np.cumsum(held) - 1
    clean, dirty = (corrector.measure(log, keep) for keep in (passed, held))
    clean, dirty = (replace(measured, rows=place[measured.rows]) for measured in (clean, dirty))
    # Of a held-out part the fit's own note says it; of joints, `cautions` do, session by session.
    if held.all() and corrector.TASK == CommandCorrector.TASK:
        parts = corrector.parts(len(corrector.law.zero))
        first = (*first, *sessions_apart(log, clean.rows, clean.corrected, clean.registered, parts))
    return Evaluation(corrector, clean, dirty, cleaning, first)


def _refused(held: BoolArray, log: CalibrationLog) -> tuple[tuple[Reason, ...], str]:
    """Return for which reasons a log is not measured, and what can be done then: a part of the training for any."""
    if held.all():
        return OTHER_FRAME, "See: gpcorrect validate LOG. Where tracker, base or tool were moved: gpcorrect fit"
    if len(np.unique(log.session)) > 1:  # a model of some of them, measured on nothing, would be no remedy
        return tuple(Reason), "Fit each session (file) apart: tracker, base or tool may have moved in between"
    apart = "Where tracker, base or tool moved in between, fit the parts before and after apart"
    return tuple(Reason), f"{apart}; else give more logs, or measure nothing: --holdout 0"


def part_errors(corrector: Corrector, measured: Measured) -> tuple[PartErrors, ...]:
    """Return the errors of each method on each part that was measured, the corrected method's last.

    Parameters
    ----------
    corrector : Corrector, that was measured
    measured : Measured, its errors
    """
    return tuple(
        PartErrors(method, part.name, part.unit, **spread(part.sizes(measured.of(method))))
        for method in corrector.METHODS
        for part in corrector.measured_parts(measured)
    )


def position_reductions(evaluation: Evaluation | None) -> dict[str, Any]:
    """Return errors of tool positions by name, and by how much of the reported error they are less, in per cent.

    Parameters
    ----------
    evaluation : Evaluation or None, of a position estimator; nothing is returned without any
    """
    if evaluation is None:
        return {}
    raw, rigid, estimated = (evaluation.clean_errors[name] for name in evaluation.corrector.METHODS)
    return {
        "raw": raw,
        "rigid": rigid,
        "estimated": estimated,
        "rms_reduction": 100.0 * (1.0 - estimated["rms_mm"] / raw["rms_mm"]),
        "sd_reduction": 100.0 * (1.0 - estimated["sd_mm"] / raw["sd_mm"]),
        "rms_reduction_beyond_rigid": 100.0 * (1.0 - estimated["rms_mm"] / rigid["rms_mm"]),
    }
