"""Tool position: where the tool really is, from the robot's own state, learned from a tracker (Peng et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.dataset import Samples
from gpcorrect.calibration.joint_features import JointFeatures
from gpcorrect.calibration.joint_path import effort_kind, logged_path, refuse_other_columns, usual_steps
from gpcorrect.calibration.joint_view import PathView, ViewCorrector, joint_layout
from gpcorrect.calibration.law import Prediction
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.calibration.stream import ToolStream
from gpcorrect.calibration.task import LearnLaw, Outcome
from gpcorrect.calibration.training_motion import TrainingMotion
from gpcorrect.cleaning import TOOL, FittedCleaner, Pair
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError, LogError
from gpcorrect.rigid import RigidModel, fit_position
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, PoseSignal

INDUCING = 400  # points of the Gaussian process; chosen by hand


@dataclass(frozen=True, eq=False, kw_only=True)
class ToolView(PathView):
    """What of a log the estimator looks at: its features, and the positions that the robot reports."""

    # from the tracker's frame to the base: as the log states it, or the best rigid motion of the training
    registration: RigidModel
    state_names: tuple[str, ...]  # columns of the whole state; empty for a law that does not look at it
    extra: tuple[str, ...]  # extra columns of the log in it
    reported: TrainingMotion | None = None  # where the training's tool was reported; models of before do not know

    def of_log(self, log: CalibrationLog, keep: BoolArray, *, needs_truth: bool = True) -> tuple[FloatArray, Samples]:
        """See :class:`PathView`."""
        path = logged_path(log, _reported_joints(log), self.features.kinds, extra=self.extra)
        refuse_other_columns(path.state_names, self.state_names)
        reported, seen = _positions(log, needs_truth=needs_truth)
        error = np.full(reported.shape, np.nan)
        if seen is not None:
            error = self.registration.apply(PoseSignal(seen)).position - reported
        return reported, self.samples(path, log.trajectory, error, keep)

    def answer(self, given: FloatArray, prediction: Prediction) -> Correction:
        """See :class:`PathView`.

        The law looks at the joints; a position that did not come with such joints in the training, as one in another
        frame or of another tool, is outside the training region by itself.
        """
        position = given + prediction.residual
        answer = Correction(position, None, None, prediction.std, prediction.interval95, prediction.reasons)
        answer = answer.because(Reason.MISSING, np.asarray(~np.isfinite(position).all(axis=1)))
        if self.reported is None:
            return answer
        beyond = np.maximum(self.reported.low - given, given - self.reported.high) > LIMITS.margin * self.reported.size
        return answer.because(Reason.OUTSIDE, np.asarray(beyond.any(axis=1)))


@dataclass(frozen=True, eq=False, kw_only=True)
class PositionEstimator(ViewCorrector):
    """What was learned of one arm's position error; needs no tracker afterwards.

    Parameters
    ----------
    view : ToolView, what of a log goes in
    rigid : RigidModel, the best rigid motion of the training, from the tracker's frame to the base
    """

    KIND: ClassVar[str] = "gpcorrect.position_estimator"
    TASK: ClassVar[str] = "tool_position"
    CHECK_SAMPLES: ClassVar[int] = 8  # chosen by hand

    view: ToolView
    rigid: RigidModel

    def __post_init__(self) -> None:
        if len(self.trained.low) != len(self.view.features.centre):
            raise DataError(
                f"a model of {len(self.view.features.centre)} joints was not trained on {len(self.trained.low)}."
            )
        if self.view.reported is not None and len(self.view.reported.low) != 3:
            raise DataError(f"a tool has three coordinates, not {len(self.view.reported.low)}.")

    @classmethod
    def pair(cls, log: CalibrationLog, settings: FitSettings) -> Pair:
        """See :class:`Corrector`."""
        _positions(log)
        _reported_joints(log)
        return TOOL

    def stream(self) -> ToolStream:
        """Return an estimator of one sample at a time, which remembers where in its slack the arm is."""
        return ToolStream(self)

    def having_seen(self, log: CalibrationLog, keep: BoolArray) -> Self:
        """See :class:`Corrector`."""
        changed = super().having_seen(log, keep)
        if self.view.reported is None:
            return changed
        moved = TrainingMotion.of(_positions(log)[0], log, keep, joints=False)
        return replace(changed, view=replace(self.view, reported=self.view.reported.widened(moved)))

    def query_path(self, log: CalibrationLog) -> FloatArray:
        """See :class:`Corrector`."""
        return _reported_joints(log)

    def _errors(
        self, log: CalibrationLog, given: FloatArray, samples: Samples, prediction: Prediction
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`ViewCorrector`.

        Raw is what the robot reports, with the frames as the log states them (`tracker_base` in its sidecar), or after
        the best rigid motion of the training where it does not; registered is after that motion always.
        """
        seen = _positions(log)[1]
        assert seen is not None
        registered = self.rigid.apply(PoseSignal(seen)).position - given
        return samples.target, registered, given + samples.target - (given + prediction.residual)

    def error_table(self, errors: FloatArray) -> Any:
        """See :class:`Corrector`: RMS and SD (about the mean, axis by axis), in mm."""
        mm = 1e3 * errors
        rms, sd = np.sqrt(np.mean(mm**2, axis=0)), mm.std(axis=0)
        return {
            "rms_mm": float(np.linalg.norm(rms)),
            "sd_mm": float(np.linalg.norm(sd)),
            "rms_axes_mm": rms.tolist(),
            "sd_axes_mm": sd.tolist(),
        }

    @classmethod
    def learn(
        cls, log: CalibrationLog, keep: BoolArray, cleaner: FittedCleaner, settings: FitSettings, learn_law: LearnLaw
    ) -> Outcome:
        """See :class:`Corrector`."""
        reported, seen = _positions(log)
        assert seen is not None
        kinds = settings.features or _default_features(log, settings)
        path = logged_path(log, _reported_joints(log), kinds, extra=settings.extra)
        known = np.isfinite(path.q).all(axis=1) & np.isfinite(seen).all(axis=1) & np.isfinite(reported).all(axis=1)
        rows = np.flatnonzero(keep & known)
        if rows.size < LIMITS.fewest_samples:
            raise DataError(
                f"an estimator needs at least {LIMITS.fewest_samples} complete samples to learn from, got {rows.size}.",
                hint="Look at what is wrong with the recording: gpcorrect validate LOG",
            )
        rigid = fit_position(PoseSignal(seen[rows]), PoseSignal(reported[rows]))
        registration = _stated_frame(log) or rigid
        error = registration.apply(PoseSignal(seen)).position - reported
        features = JointFeatures.learn(kinds, path, error, rows)
        view = ToolView(
            registration=registration,
            features=features,
            state_names=path.state_names,
            extra=settings.extra,
            reported=TrainingMotion.of(reported, log, keep, joints=False),
        )
        samples = replace(view.samples(path, log.trajectory, error, keep), session=log.session)
        law, left_out = learn_law(samples, joint_layout(features, 3, owned=False, inducing=INDUCING))
        report = {"features": list(features.kinds), "state_numbers": features.n_state}
        remarks = features.remarks(range(1, path.q.shape[1] + 1))
        usual, shortest = usual_steps(path)
        corrector = cls(
            law=law,
            cleaner=cleaner,
            trained=TrainingMotion.of(path.q, log, keep, joints=True),
            view=view,
            rigid=rigid,
            usual_step=usual,
            shortest_step=shortest,
        )
        return Outcome(corrector, samples, left_out, law.intervals, report, remarks)


def _default_features(log: CalibrationLog, settings: FitSettings) -> tuple[str, ...]:
    """Return the whole state for the network, joints, slack and efforts otherwise."""
    if settings.method == "network":
        return ("state",)
    memory = () if log.static else ("memory",)
    return ("position", *effort_kind(log, _reported_joints(log).shape[1]), *memory)


def _reported_joints(log: CalibrationLog) -> FloatArray:
    if log.measured_jp is None:
        raise LogError(f"the estimator needs measured_jp; the log has {', '.join(log.signals)}.", path=log.name)
    return log.measured_jp


def _positions(log: CalibrationLog, *, needs_truth: bool = True) -> tuple[FloatArray, FloatArray | None]:
    """Return reported positions and those that the tracker saw `(n, 3)`; coasting rows of `vision track` are unseen."""
    if log.measured_cp is None:
        raise LogError(f"the estimator needs measured_cp; the log has {', '.join(log.signals)}.", path=log.name)
    if log.tracker_cp is None:
        if needs_truth:
            raise LogError(
                "the estimator learns from tracker_cp, which the log lacks.",
                hint="Track the tool: gpcorrect vision track",
                path=log.name,
            )
        return log.measured_cp.position, None
    seen, status = log.tracker_cp.position, log.extra.get("tracking_status")
    return log.measured_cp.position, seen if status is None else np.where(status[:, None] == 0, seen, np.nan)


def _stated_frame(log: CalibrationLog) -> RigidModel | None:
    """Return the motion from the tracker's frame to the base that the log states (`tracker_base`), if it does."""
    stated = log.meta.tracker_base
    if stated is None:
        return None
    T_base_tracker = se3.invert(se3.pose(se3.matrix_from_rotvec(np.array(stated[3:])), np.array(stated[:3])))
    R = T_base_tracker[:3, :3]
    return RigidModel("position", R_position=R, t=T_base_tracker[:3, 3], R_left=R)
