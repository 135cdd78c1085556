"""What a task must define, and what every fitted corrector can do.

A task defines which signals it compares, which samples and inputs it makes of a log, and how a residual becomes an
answer. Cleaning, clocks, splits, learners, regions, bounds, intervals, streams and files are written elsewhere, once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples, pieces
from gpcorrect.calibration.history import Step
from gpcorrect.calibration.law import Law
from gpcorrect.calibration.metrics import Z95, coverage
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.calibration.training_motion import UNITS, TrainingMotion
from gpcorrect.calibration.unlike_training import beside_training
from gpcorrect.cleaning import CleaningReport, FittedCleaner, Pair, clean_with, fit_cleaner
from gpcorrect.errors import DataError, LogError
from gpcorrect.gpr import IntervalCalibration, LeftOut
from gpcorrect.logs.copies import LEAST, Marks, marks_of, recalled, remembered
from gpcorrect.logs.join import in_joint_order, order_words
from gpcorrect.logs.sync import Clocks, match_clocks
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

LearnLaw = Callable[[Samples, Layout], tuple[Law, LeftOut]]


class Part(NamedTuple):
    """Error components that are quoted together: name, unit, columns, and what one m or rad is in that unit."""

    name: str
    unit: str
    columns: tuple[int, ...]
    scale: float

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]"

    def sizes(self, errors: FloatArray) -> FloatArray:
        """Return the lengths `(n,)` of this part of errors, in its unit.

        Parameters
        ----------
        errors : (n, m) array, m or rad
        """
        return np.asarray(self.scale * np.linalg.norm(errors[:, self.columns], axis=1))


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a task learned of a log."""

    corrector: Corrector  # without a summary yet
    samples: Samples  # what was learned from
    left_out: LeftOut  # errors at the usable samples, each predicted without its own fold
    intervals: IntervalCalibration  # of the answers
    report: Mapping[str, Any]  # the task's report on its fit, JSON-able
    remarks: tuple[str, ...] = ()  # what a person should know
    registration: Any = None  # which rigid model was chosen and why, of tasks that register frames

    @property
    def baseline(self) -> FloatArray:
        """Scores of left-out pieces of the training, with which later scores are compared."""
        rows, left_out = self.samples.rows, self.left_out
        labels = pieces(self.samples.time[rows], self.samples.trajectory[rows])
        return _scores_by_piece(_ratios(left_out.errors, self.intervals.interval95(left_out.std)), labels)


@dataclass(frozen=True, eq=False)
class Measured:
    """How far off each method is on n samples of a log: before, after the simplest remedy, and corrected.

    Parameters
    ----------
    raw, registered, corrected : (n, m) arrays, errors, m or rad; NaN where not measured
    interval95 : (n, m) array, half widths of the corrected method's 95 % intervals
    in_domain : (n,) mask, whether the sample lies near training data
    speed : (n,) array, linear speed, m/s, of tasks whose errors are shown over it; NaN otherwise
    rows : (n,) int array, rows of the log that were measured
    time, trajectory : (n,) arrays, of those rows
    """

    raw: FloatArray
    registered: FloatArray
    corrected: FloatArray
    interval95: FloatArray
    in_domain: BoolArray
    speed: FloatArray
    rows: IntArray
    time: FloatArray
    trajectory: IntArray

    def of(self, method: str) -> FloatArray:
        """Return the errors `(n, m)` of a method by its name.

        Parameters
        ----------
        method : str, one of :attr:`Corrector.METHODS`
        """
        return {"raw": self.raw, "corrected": self.corrected}.get(method, self.registered)

    @property
    def coverage95(self) -> FloatArray:
        """(m,) fraction of errors inside their 95 % intervals, a component each; NaN where not measured."""
        return coverage(self.corrected, self.interval95)

    @property
    def scores(self) -> FloatArray:
        """Scores of pieces, about 1 while the model holds; samples outside the training region are not counted."""
        ratio = _ratios(self.corrected, self.interval95)
        known = np.isfinite(ratio).any(axis=0)
        ratio = np.where(self.in_domain[:, None], ratio, np.nan)[:, known]
        return _scores_by_piece(ratio, pieces(self.time, self.trajectory))

    @property
    def share_held(self) -> float:
        """Fraction of errors inside their 95 % intervals, over all components; NaN where none was measured."""
        fractions = self.coverage95
        return float(np.nanmean(fractions)) if np.isfinite(fractions).any() else float("nan")

    def at(self, rows: BoolArray | IntArray) -> Self:
        """Return what was measured on some of these samples."""
        return type(self)(**{part.name: getattr(self, part.name)[rows] for part in fields(self)})


@dataclass(frozen=True, eq=False, kw_only=True)
class Corrector(ABC):
    """A fitted model of any task; it changes nothing, so threads may use it together.

    Methods that take a log raise LogError where it lacks a signal or no sample can be used, and DataError where its
    stamps, beside the training's, cannot be seconds, or it is not what the model was trained with.

    Parameters
    ----------
    law : Law, what was learned, with its safeguards
    cleaner : FittedCleaner, the training's thresholds for classifying samples of other logs
    trained : TrainingMotion, where and how fast the training moved, in the quantity that queries are given in
    summary : mapping, description of the model: frames, units, features, fit report
    history : tuple of Step, how it was made, oldest first; empty in older files
    """

    KIND: ClassVar[str]
    """Of the model file."""
    TASK: ClassVar[str]
    """"pose", "joints" or "tool_position"."""
    METHODS: ClassVar[tuple[str, str, str]] = ("raw", "rigid", "corrected")
    """Names, in reports, of the three methods that are measured."""

    law: Law
    cleaner: FittedCleaner
    trained: TrainingMotion
    summary: Mapping[str, Any] = field(default_factory=dict)
    history: tuple[Step, ...] = ()

    @classmethod
    @abstractmethod
    def pair(cls, log: CalibrationLog, settings: FitSettings) -> Pair:
        """Return the outside sensor's signal and the robot's that are compared; refuse what cannot be learned from.

        Parameters
        ----------
        log : CalibrationLog, to be learned from
        settings : FitSettings
        """

    @classmethod
    @abstractmethod
    def learn(
        cls, log: CalibrationLog, keep: BoolArray, cleaner: FittedCleaner, settings: FitSettings, learn_law: LearnLaw
    ) -> Outcome:
        """Learn from a clean log on one clock; raises DegenerateError where it does not determine a model.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        cleaner : FittedCleaner, what rejected the others
        settings : FitSettings
        learn_law : callable, from samples and their layout to a law and its predictions of left-out samples
        """

    @abstractmethod
    def query_path(self, log: CalibrationLog) -> FloatArray:
        """Return what queries along a log `(n, k)` say of where the arm is: desired positions, or joints; m or rad.

        Parameters
        ----------
        log : CalibrationLog, n samples
        """

    @abstractmethod
    def samples(self, log: CalibrationLog, keep: BoolArray) -> Samples:
        """Return a log as the law sees it.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        """

    @abstractmethod
    def measure(self, log: CalibrationLog, keep: BoolArray) -> Measured:
        """Return errors on some samples of a log.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        """

    @abstractmethod
    def error_table(self, errors: FloatArray) -> Any:
        """Return errors in the statistics and units of reports, JSON-able.

        Parameters
        ----------
        errors : (n, m) array, m or rad
        """

    @abstractmethod
    def check_answers(self) -> FloatArray:
        """Return answers to recorded or made queries, by which a file is verified at load."""

    def parts(self, m: int) -> tuple[Part, ...]:
        """Return which of m error components are quoted together, in which unit.

        Parameters
        ----------
        m : int, 3 for positions, 6 for poses
        """
        position = Part("position", "mm", (0, 1, 2), 1e3)
        return (position,) if m == 3 else (position, Part("rotation", "deg", (3, 4, 5), float(np.rad2deg(1.0))))

    def measured_parts(self, measured: Measured) -> list[Part]:
        """Return the parts of errors that were measured.

        Parameters
        ----------
        measured : Measured
        """
        parts = self.parts(measured.raw.shape[1])
        return [part for part in parts if np.isfinite(measured.raw[:, part.columns]).any()]

    def refuse_misread(self, log: CalibrationLog) -> None:
        """Refuse a log whose stamps cannot be seconds, or that in its middle is where no arm of the training can be.

        Parameters
        ----------
        log : CalibrationLog
        """
        path = self.query_path(log)
        if path.shape[1] != len(self.trained.low):
            raise DataError(f"the model knows {len(self.trained.low)} joints, the log has {path.shape[1]}.")
        known = path[np.isfinite(path).all(axis=1)]
        if len(known):
            self.trained.refuse_far(np.median(known, axis=0), UNITS)
        if not log.static:
            self.trained.refuse_slow(path, log.time, log.trajectory)

    def in_joint_order(self, log: CalibrationLog) -> CalibrationLog:
        """Return a log with its joints in the training's order, where both name them; LogError where they are others.

        Parameters
        ----------
        log : CalibrationLog
        """
        return in_joint_order(log, self.summary.get("joint_names", ()))

    def having_seen(self, log: CalibrationLog, keep: BoolArray) -> Self:
        """Return the same corrector, of a training that moved as this log does too.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that were not rejected
        """
        moved = TrainingMotion.of(self.query_path(log), log, keep, joints=False)
        return replace(self, trained=self.trained.widened(moved))

    def on_one_clock(self, log: CalibrationLog, mode: str) -> tuple[CalibrationLog, Clocks]:
        """Return the log with the outside sensor on the robot's clock, where the seconds between them are stated.

        What the motion suggests is said and not done: a model is measured on truth as it was stamped. A lag that the
        training had too is no news, nor is one whose shift takes no errors away.

        Parameters
        ----------
        log : CalibrationLog
        mode : str, as for :func:`gpcorrect.logs.sync.match_clocks`
        """
        log = self.in_joint_order(log)
        log, clocks = match_clocks(log, self.cleaner.pair.observed, self.cleaner.pair.command, mode, shifts=False)
        return log, beside_training(self, log, clocks)

    def clean(self, log: CalibrationLog) -> CleaningReport:
        """Classify the samples of another log by the training's thresholds.

        Parameters
        ----------
        log : CalibrationLog, on one clock
        """
        self.refuse_misread(log)
        return clean_with(self.cleaner, log)

    def clean_afresh(self, log: CalibrationLog) -> CleaningReport:
        """Classify the samples of another log by thresholds of its own: the arm may have changed since the training.

        Parameters
        ----------
        log : CalibrationLog, on one clock
        """
        self.refuse_misread(log)
        return fit_cleaner(
            log, self.cleaner.settings, rng=np.random.default_rng(0), pair=self.cleaner.pair, rigid=self.cleaner.rigid
        )[1]

    def refuse_other_arm(self, log: CalibrationLog) -> None:
        """Refuse, with a LogError, to learn from a log that names another arm than the model's.

        Parameters
        ----------
        log : CalibrationLog
        """
        said = self._caution_arm(log)
        if said:
            raise LogError(f"{said}.", path=log.name, hint="Each arm has a model of its own: gpcorrect fit")

    def _caution_arm(self, log: CalibrationLog) -> str:
        own, other = self.summary.get("arm"), log.meta.arm
        if not own or other in ("", own):
            return ""
        return f"the model was learned on {own}, and this recording is of {other}"

    def cautions(self, log: CalibrationLog) -> tuple[str, ...]:
        """Return what makes errors on a log other than those of new motion of the model's arm, and joints put in order.

        Parameters
        ----------
        log : CalibrationLog
        """
        return tuple(said for said in (order_words(log), self.learned_from(log), self._caution_arm(log)) if said)

    def learned_from(self, log: CalibrationLog) -> str:
        """Say where a log holds some of what was learned from: a whole recording, a part, or both in another file.

        Parameters
        ----------
        log : CalibrationLog
        """
        learned = [self.summary.get("data", {}), *self.summary.get("updates", [])]
        known = {digest for entry in learned for part in ("recordings", "contents") for digest in entry.get(part, [])}
        # A file by its bytes, as models of before know it, or by what it holds.
        again = max(sum(digest in known for digest in part) for part in (log.recordings, log.contents))
        what, those = "this recording", "it"
        if again and len(log.recordings) > 1:
            what = f"{again} of these {len(log.recordings)} recordings"
        elif not again:
            own = marks_of(log)
            if sum(len(np.intersect1d(own, recalled(entry.get("marks", "")))) for entry in learned) < LEAST:
                return ""
            what, those = "samples that are in this recording", "them"
        return (
            f"the model was made from {what}: errors on {those} are those of a model that knows the answers, and say "
            "nothing of new motion"
        )

    def info(self) -> dict[str, Any]:
        """Return the model's description; JSON-able."""
        return dict(self.summary)


def recording_entry(log: CalibrationLog, marks: Marks) -> dict[str, Any]:
    """Return what a model remembers of a recording that it learned from, and by which it is known again; JSON-able."""
    files = {"recordings": list(log.recordings), "contents": list(log.contents)}
    return {"source": log.name, "sha256": log.digest, **files, "marks": remembered(marks)}


def _ratios(errors: FloatArray, interval95: FloatArray) -> FloatArray:
    """Return errors `(n, m)` over standard deviations; NaN where an interval has no width, as of data without error."""
    return np.asarray(np.divide(errors * Z95, interval95, out=np.full(errors.shape, np.nan), where=interval95 > 0))


def _scores_by_piece(ratio: FloatArray, labels: IntArray) -> FloatArray:
    """Return root mean squares of ratios `(n, m)` of error over standard deviation, a piece each, in order."""
    squares = np.sum(ratio**2, axis=1) / max(ratio.shape[1], 1)
    known = np.isfinite(squares) & (ratio.shape[1] > 0)
    scores = [np.sqrt(squares[known & (labels == label)].mean()) for label in np.unique(labels[known])]
    return np.array(scores)
