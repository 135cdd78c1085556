"""The fitted corrector: desired pose in, command and honest uncertainty out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.cleaning import CleaningReport
from gpcorrect.corrector.answer import NO_MEMORY, Answerer, PathCorrection
from gpcorrect.corrector.bounds import Bounds
from gpcorrect.corrector.bridging import MotionLimits
from gpcorrect.corrector.memory import History
from gpcorrect.corrector.one_pose import frame
from gpcorrect.corrector.queries import checked_poses, checked_times, pose_numbers, pose_rows, twist_numbers
from gpcorrect.corrector.recall import Recall, statistics_arrays, statistics_from
from gpcorrect.corrector.reference import reference_twists, rotations_of
from gpcorrect.corrector.screening import Screen
from gpcorrect.corrector.stream import CorrectionStream
from gpcorrect.gpr import FeatureMap, IntervalCalibration, Predictor, Statistics
from gpcorrect.rigid import RigidModel
from gpcorrect.types import BoolArray, CalibrationLog, Correction, FloatArray, IntArray, PoseSignal, frozen_array
from gpcorrect.velocity import twists

__all__ = ["CommandCorrector", "PathCorrection"]

PREDICTOR = "predictor."
RECALL = "recall."
AT_REST = "no twist was given: taken as at rest"
NO_HISTORY = "no history was given: memory features were not used"


@dataclass(frozen=True, eq=False)
class CommandCorrector:
    """Tells what to command so that the robot reaches a desired pose: `F(x) = H(G(x))` (Mahler 2014, Sec. IV).

    `G` is the rigid registration from the observer's frame to the command's, `H` adds the residual that a Gaussian
    process learned from pose and velocity.

    Parameters
    ----------
    rigid : RigidModel
        G.
    features : FeatureMap
        From a reference pose and its twist to the inputs of the Gaussian process.
    predictor : Predictor
        Mean and standard deviation of the residual.
    intervals : IntervalCalibration
        What turns standard deviations into 95 % intervals that hold on unseen trajectories.
    bounds : Bounds
        Largest residual that is believed, and the novelty beyond which a query is extrapolation.
    screen : Screen
        The training's ruler for judging other logs.
    motion : MotionLimits or None
        What no arm does from one pose of a path to the next; None believes every path, as a fit without cleaning does.
    velocity_step : float or None
        Step of the stencil on recorded paths, s; None takes five neighbouring samples.
    summary : mapping
        Frames, units, features, fit report: what the model file says of itself.
    check_queries : (k, 13) array
        Training queries (pose, twist) that a model file records and asks again at load.
    recall : Recall or None
        What was learned with memory features, for paths and streams; None without.
    statistics : tuple of Statistics
        What the predictor rests on, so that more data can be added; empty in files of before there was any.

    Attributes
    ----------
    answerer : Answerer
        Answers single queries: everything above but the memory, as the hot path reads it.
    """

    rigid: RigidModel
    features: FeatureMap
    predictor: Predictor
    intervals: IntervalCalibration
    bounds: Bounds
    screen: Screen
    motion: MotionLimits | None
    velocity_step: float | None
    summary: Mapping[str, Any]
    check_queries: FloatArray
    recall: Recall | None = None
    statistics: tuple[Statistics, ...] = ()
    answerer: Answerer = field(init=False, repr=False)

    def __post_init__(self) -> None:
        answerer = Answerer(frame(self.rigid, self.features), self.predictor, self.intervals, self.bounds)
        object.__setattr__(self, "answerer", answerer)
        self.correct([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # what is compiled at first use is compiled now

    @property
    def has_orientation(self) -> bool:
        """Whether orientations are corrected too."""
        return self.features.has_orientation

    def correct(self, pose: ArrayLike, twist: ArrayLike | None = None) -> Correction:
        """Return what to command so that the robot reaches `pose`.

        Parameters
        ----------
        pose : (7,) or (3,) array
            Desired position (m) and unit quaternion wxyz in the frame of the training's observed poses; a
            position-only model takes three numbers, and with seven only turns the orientation into the base frame.
        twist : (6,) array, optional
            Desired velocity, m/s and rad/s, same frame. Without it the pose is taken as at rest, and the answer says
            so.

        Raises
        ------
        DataError
            The pose or the twist is not finite, has the wrong length, or its quaternion is not a unit quaternion.
        """
        query, velocity = pose_numbers(pose, orientation=self.has_orientation), twist_numbers(twist)
        remark = AT_REST if twist is None and self.features.uses_velocity else ""
        if self.recall is not None:
            remark = f"{remark}; {NO_HISTORY}" if remark else NO_HISTORY
        return self.answerer.one(query, velocity, NO_MEMORY, remark)

    def stream(self, window: float = 0.1) -> CorrectionStream:
        """Return a stream, which answers poses one after the other and takes velocity and memory from those before."""
        recalling = None if self.recall is None else (self._recalling(self.recall), self.recall.memory)
        return CorrectionStream(self.answerer, recalling, orientation=self.has_orientation, window=window)

    def correct_path(self, poses: ArrayLike, times: ArrayLike) -> PathCorrection:
        """Return what to command instead of a timed path; its velocities come from the five-point stencil on the path.

        Lone jumps that no arm can follow are bridged, and their samples say so (status LIMITED).

        Parameters
        ----------
        poses : (n, 7) or (n, 3) array
            Desired poses, as for :meth:`correct`.
        times : (n,) array
            Seconds, strictly increasing. A path of one pose is at rest.

        Raises
        ------
        DataError
            As for :meth:`correct`, or the times do not increase.
        """
        queries = checked_poses(poses, orientation=self.has_orientation)
        seconds = checked_times(times, len(queries))
        desired = PoseSignal(queries[:, :3], queries[:, 3:] if queries.shape[1] > 3 else None)
        labels = np.zeros(len(queries), dtype=np.int64)
        desired, replaced = self.possible(desired, seconds, labels)
        twist = np.nan_to_num(twists(seconds, desired.position, rotations_of(desired), labels))
        if self.recall is None:
            return self.correct_observed(desired, twist).bridged(replaced)
        stream = self.stream()  # memory is of the commands, which are known one after the other
        rows = zip(seconds, pose_rows(desired), twist, strict=True)
        return PathCorrection.of([stream.correct(*row) for row in rows]).bridged(replaced)

    def possible(self, desired: PoseSignal, time: FloatArray, labels: IntArray) -> tuple[PoseSignal, BoolArray]:
        """Return desired paths with the lone jumps of each run bridged, and the mask (n,) of replaced poses."""
        if self.motion is None:
            return desired, np.zeros(len(desired), dtype=bool)
        return self.motion.bridge(desired, self.rigid.apply(desired), time, labels)

    def correct_observed(
        self, desired: PoseSignal, twist: FloatArray, commands: PoseSignal | None = None, labels: IntArray | None = None
    ) -> PathCorrection:
        """Return what to command instead of desired poses (n rows) with known twists `(n, 6)`.

        With `commands`, what was commanded at each row, rows of one label `(n,)` are one path, in order, whose commands
        before a row are its history; without, no row has a history, and memory is not used.
        """
        reference, rotations = self.rigid.apply(desired), rotations_of(desired)
        turned = rotations_of(reference)
        X = self.features.transform(reference.position, turned, reference_twists(self.rigid, rotations, twist))
        if self.recall is None or commands is None or labels is None:
            return self.answerer.many(reference, X)
        history = History.of(commands, reference, labels, orientation=self.has_orientation)
        memory = self.recall.memory.transform(history)
        return self._recalling(self.recall).many(reference, np.hstack([X, memory]))

    def _recalling(self, recall: Recall) -> Answerer:
        wide = frame(self.rigid, self.features, recall.memory.size)
        return Answerer(wide, recall.predictor, recall.intervals, recall.bounds)

    def clean(self, log: CalibrationLog) -> CleaningReport:
        """Judge the samples of another log by the ruler that the training data set."""
        return self.screen.judge(log)

    def clean_afresh(self, log: CalibrationLog) -> CleaningReport:
        """Judge the samples of another log by its own ruler: the arm may have changed since the training."""
        return self.screen.judge_afresh(log)

    def info(self) -> dict[str, Any]:
        """Return what the model says of itself: frames, units, features, training region, fit report. JSON-able."""
        return dict(self.summary)

    def to_parts(self) -> tuple[dict[str, Any], dict[str, FloatArray]]:
        """Return the corrector as a JSON-able header and named arrays, for a model file."""
        screen, screen_arrays = self.screen.to_parts()
        predictor = {PREDICTOR + name: array for name, array in self.predictor.to_arrays().items()}
        header = {
            "rigid": self.rigid.to_dict(),
            "features": self.features.to_dict(),
            "intervals": self.intervals.to_dict(),
            "bounds": self.bounds.to_dict(),
            "screen": screen,
            "motion": None if self.motion is None else self.motion.to_dict(),
            "velocity_step": self.velocity_step,
            "summary": dict(self.summary),
        }
        recall, recall_arrays = (None, {}) if self.recall is None else self.recall.to_parts()
        named = {RECALL + name: array for name, array in recall_arrays.items()}
        named |= statistics_arrays(self.statistics)
        arrays = {**predictor, **screen_arrays, **named, "check_queries": self.check_queries}
        return {**header, "recall": recall}, arrays

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild a corrector from :meth:`to_parts`.

        Raises
        ------
        KeyError, TypeError, ValueError
            A part is missing or is not what it should be.
        """
        return cls(
            rigid=RigidModel.from_dict(header["rigid"]),
            features=FeatureMap.from_dict(header["features"]),
            predictor=Predictor.from_arrays(
                {name.removeprefix(PREDICTOR): a for name, a in arrays.items() if name.startswith(PREDICTOR)}
            ),
            intervals=IntervalCalibration.from_dict(header["intervals"]),
            bounds=Bounds.from_dict(header["bounds"]),
            screen=Screen.from_parts(header["screen"], arrays),
            motion=None if header["motion"] is None else MotionLimits.from_dict(header["motion"]),
            velocity_step=header["velocity_step"],
            summary=header["summary"],
            check_queries=frozen_array(arrays["check_queries"]),
            recall=_recall(header, arrays),
            statistics=statistics_from(arrays),
        )


def _recall(header: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> Recall | None:
    """Rebuild what was learned with memory, if anything was."""
    if header["recall"] is None:
        return None
    own = {name.removeprefix(RECALL): array for name, array in arrays.items() if name.startswith(RECALL)}
    return Recall.from_parts(header["recall"], own)
