"""Poses corrected in the joints that take the arm there, for slack and friction are in the joints.

A desired pose has joints, what is to be added to them is the task of :mod:`gpcorrect.calibration.joints`, and the
corrected joints have a pose again. The kinematics is the controller's own, learned from the log: where it is wrong, it
is wrong there and back, and the error that this leaves was in the training too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.aim import Aim
from gpcorrect.calibration.arm_kinematics import ArmKinematics
from gpcorrect.calibration.dataset import Layout, Samples, clocks
from gpcorrect.calibration.domain import Bounds
from gpcorrect.calibration.joint_task import JointTask
from gpcorrect.calibration.joint_view import JointView
from gpcorrect.calibration.joints import JointCorrector
from gpcorrect.calibration.law import Law
from gpcorrect.calibration.learners import PolynomialMap
from gpcorrect.calibration.learners.learner import cross_predicted
from gpcorrect.calibration.one_pose import command
from gpcorrect.calibration.pose_joints import PoseJoints
from gpcorrect.calibration.poses import WORTH_IT, changes, changes_text
from gpcorrect.calibration.sessions import widening
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.calibration.task import LearnLaw, Outcome
from gpcorrect.calibration.training_motion import TrainingMotion
from gpcorrect.cleaning import FittedCleaner
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.gpr import IntervalCalibration, LeftOut
from gpcorrect.rigid import apply_residual, pose_residual
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, PoseSignal

HOPELESS = 0.05
"""Of the error of poses alone that a linear law of joints may have more, the mean of position and rotation; by hand. It
is 8 % more for 60 reaches and 13 % more for 303 of a simulated RAVEN-II, whose joints, fitted all the same, ended at 6
and 12 % more, and 41 and 18 % less for a simulated and the real dVRK, which ended at 41 and 25 % less."""
UNSEARCHED = 0.1
"""The same before the play of joints is searched for, which takes most of the time and 2 to 5 points away: 15 to 17 %
more for four simulated RAVEN-II, 15 to 18 % less for the real dVRK whichever fifth is held out."""
MOST_LOOKED_AT = 6000  # samples, likewise; chosen by hand
REACHED = ("position", "velocity", "memory", "lags")  # what the model that moves commands knows of them
AWAY = 0.1
"""Of the error of left-out commands that may be added by moving them to where the arm would arrive: beyond that the
model of where it arrives is not believed. On a planted play, where four fifths of what is missed go, it is 0.07."""


@dataclass(frozen=True, eq=False)
class JointRoute:
    """What was learned of an arm's kinematics and of its joints: how paths and streams of poses are answered."""

    kinematics: ArmKinematics  # from poses to joints and back
    joints: JointCorrector  # from desired joints to commanded ones
    # of poses: errors of joints go together, so that intervals of joints say too little of those of poses
    intervals: IntervalCalibration
    # what moves the commanded joints on by what they would miss; None in files of before there was one
    aim: Aim | None = None

    def __post_init__(self) -> None:
        dof, types = self.kinematics.chain.dof, self.joints.view.types
        if self.aim is not None and self.aim.reached.view.types != types:
            raise DataError(f"commands of {types} joints are not moved by a model of {self.aim.reached.view.types}.")
        if len(types) != dof or len(self.intervals.factor) != 6 or self.joints.view.direction != "command":
            raise DataError(
                f"poses of {dof} joints cannot be answered by a model of {len(types)} joints in direction"
                f" {self.joints.view.direction} with {len(self.intervals.factor)} intervals."
            )

    @classmethod
    def learn(
        cls,
        kinematics: ArmKinematics,
        log: CalibrationLog,
        pair: tuple[PoseSignal, PoseSignal],
        cleaner: FittedCleaner,
        settings: FitSettings,
        learn_law: LearnLaw,
        alone: LeftOut | None = None,
    ) -> tuple[JointRoute, Outcome]:
        """Return the route, and its outcome with errors and intervals as poses.

        Parameters
        ----------
        kinematics : ArmKinematics, of the log
        log : CalibrationLog, n complete samples
        pair : two PoseSignal, their references and commands, with orientation
        cleaner : FittedCleaner, what rejected the others
        settings : FitSettings
        learn_law : callable, see :meth:`Corrector.learn`
        alone : LeftOut, optional
            Of a law of the poses alone. A linear law of the joints that comes nowhere near it ends the learning: the
            joints are not where this arm misses, and a Gaussian process after it takes most of the fit to say so.

        Raises
        ------
        LogError, DataError, DegenerateError
            The log's joints cannot be learned from, or promise nothing.
        """
        own = replace(settings, direction="command", features=(), input_signal="setpoint_jp", end_to_end=False)
        if alone is not None:
            _look_first(kinematics, log, pair, own, alone)
        kinematics, wanted = kinematics.reaching(pair[0])
        joints = PoseJoints.of(log, pair, kinematics, wanted)

        def promising(samples: Samples, layout: Layout) -> tuple[Law, LeftOut]:
            if alone is not None:
                _require_promise(kinematics, joints, samples, layout, alone, HOPELESS)
            return learn_law(samples, layout)

        anywhere = np.full(kinematics.chain.dof, np.inf)  # poses are looked at where they come in
        motion = TrainingMotion(-anywhere, anywhere, np.ones(kinematics.chain.dof), np.nan)

        def corrector_of(outcome: Outcome) -> JointCorrector:
            assert isinstance(outcome.corrector, JointCorrector)
            return replace(outcome.corrector, trained=motion)

        outcome = JointCorrector.learn(joints.log, joints.known, cleaner, own, promising)
        route = cls(kinematics, corrector_of(outcome), IntervalCalibration(np.ones(6)))
        first = route.commands(joints, outcome.samples, outcome.left_out)
        route, left_out = route.calibrated(joints, outcome.samples, outcome.left_out, first)
        if alone is None or changes(left_out, alone).mean() <= -WORTH_IT:
            own = replace(own, direction="estimate", features=REACHED)
            back = JointCorrector.learn(joints.log, joints.known, cleaner, own, learn_law)
            reached = corrector_of(back)
            aim = Aim.learn(reached, reached.view.wide(back.left_out.errors), joints.log, first)
            aim = replace(aim, arrivals=route.arrivals(joints, reached.view, back.samples, back.left_out))
            aimed = replace(route, aim=aim).calibrated(joints, outcome.samples, outcome.left_out, first)
            if changes(aimed[1], left_out).mean() <= AWAY:
                route, left_out = aimed
        return route, replace(outcome, left_out=left_out, intervals=route.intervals)

    def commands(self, joints: PoseJoints, samples: Samples, left_out: LeftOut) -> FloatArray:
        """Return commands `(n, d)` found for the reached joints of a log: left-out ones where there are any.

        Parameters
        ----------
        joints, samples, left_out
            As for :meth:`calibrated`.
        """
        time = joints.log.time
        answer = self.joints.correct_path(joints.wanted, time, sessions=clocks(time, joints.log.session))
        assert answer.joints is not None
        return _where_left_out(answer.joints, joints.asked, samples, left_out, self.joints.view)

    def calibrated(
        self, joints: PoseJoints, samples: Samples, left_out: LeftOut, first: FloatArray
    ) -> tuple[JointRoute, LeftOut]:
        """Return the route with intervals that hold for left-out samples as poses, and what it leaves of these.

        Parameters
        ----------
        joints : PoseJoints, n samples
        samples : Samples, the same as the law of joints sees them
        left_out : LeftOut, of the law of joints, at those of them that it learns from
        first : (n, d) array, from :meth:`commands`
        """
        found = np.array(first)
        if self.aim is not None:
            found, _ = self.aim.moved(joints.wanted, first, joints.log.time, joints.log.session)
        left_out, intervals = self._left_out(joints, found, samples, left_out, self.joints.view)
        return replace(self, intervals=intervals), left_out

    def arrivals(self, joints: PoseJoints, view: JointView, samples: Samples, left_out: LeftOut) -> IntervalCalibration:
        """Return intervals that hold for the poses that left-out commands reach.

        Parameters
        ----------
        joints : PoseJoints, n samples
        view : JointView, of the law from commands to the joints that they reach
        samples, left_out
            Of that law, as for :meth:`calibrated`.
        """
        found = _where_left_out(joints.asked, joints.wanted, samples, left_out, view)
        return self._left_out(joints.back, found, samples, left_out, view)[1]

    def _left_out(
        self, joints: PoseJoints, found: FloatArray, samples: Samples, left_out: LeftOut, view: JointView
    ) -> tuple[LeftOut, IntervalCalibration]:
        """Return a view's left-out answers in joints `(n, d)` as poses, and intervals that hold for them."""
        rows, std = samples.rows, view.wide(left_out.std)
        answers: FloatArray = np.where(np.isfinite(left_out.errors).all(axis=1, keepdims=True), found[rows], np.nan)
        in_joints = Correction(None, None, answers, std, np.full(std.shape, np.nan), np.zeros(len(rows), np.int64))
        answer = self._as_poses(joints.reference[rows], joints.wanted[rows], in_joints, self.intervals)
        errors = pose_residual(answer.poses, joints.command[rows])
        known = np.isfinite(errors).all(axis=1)
        trajectory = samples.trajectory[rows][known]
        intervals = IntervalCalibration.fit(errors[known], answer.std[known], trajectory, samples.folds[known])
        wider = intervals.widened(widening(samples, errors, (3, 3)))
        return LeftOut(errors, answer.std, left_out.novelty), wider

    def check_answers(self, reference: PoseSignal, bounds: Bounds) -> FloatArray:
        """Return answers `(2 n, 13)` to poses, each by itself and then as a path: position, wxyz, half intervals.

        Parameters
        ----------
        reference : PoseSignal, n poses in the command's frame
        bounds : Bounds, largest believed correction of a pose
        """
        time: FloatArray = np.arange(len(reference), dtype=np.float64) * self.joints.usual_step
        found = []
        for session in (np.arange(len(reference)), np.zeros(len(reference), dtype=np.int64)):
            answer = self.correct(reference, time, session, bounds, from_middle=True)
            found.append(answer.numbers(answer.interval95))
        return np.nan_to_num(np.vstack(found))

    def correct(
        self, reference: PoseSignal, time: FloatArray, session: IntArray, bounds: Bounds, *, from_middle: bool = False
    ) -> Correction:
        """Return what to command along a path of reference poses; NaN where the arm comes not near.

        Parameters
        ----------
        reference : PoseSignal, n poses in the command's frame
        time : (n,) array, s
        session : (n,) int array, homing or day
        bounds : Bounds, largest believed correction of a pose
        from_middle : bool, whether joints are known to begin in the middle of their slack
        """
        q = self.kinematics.inverse(reference)
        in_joints = self.joints.correct_path(q, time, sessions=clocks(time, session), from_middle=from_middle)
        if self.aim is not None:
            assert in_joints.joints is not None
            moved, beyond = self.aim.moved(q, in_joints.joints, time, session)
            in_joints = replace(in_joints, joints=moved).because(Reason.OUTSIDE, beyond)
        return self._as_poses(reference, q, in_joints, self.intervals, bounds)

    def reached(self, command: PoseSignal, time: FloatArray, session: IntArray) -> Correction | None:
        """Return the poses that a path of commands reaches, NaN where the arm comes not near; None where unknown.

        Parameters
        ----------
        command : PoseSignal, n poses in the command's frame
        time : (n,) array, s
        session : (n,) int array, homing or day
        """
        if self.aim is None or self.aim.arrivals is None:
            return None
        q = self.kinematics.inverse(command)
        in_joints = self.aim.reached.correct_path(q, time, sessions=clocks(time, session))
        return self._as_poses(command, q, in_joints, self.aim.arrivals)

    def stream(self) -> _RouteStream:
        """Return a stream of the joints of poses."""
        return _RouteStream(self)

    def as_pose(
        self, position: FloatArray, rotation: FloatArray, q: FloatArray, in_joints: Correction, largest: FloatArray
    ) -> Correction:
        """Return one answer in joints as a pose within bounds: the hot path of streams.

        Parameters
        ----------
        position, rotation : (3,) and (3, 3) arrays, reference pose
        q : (d,) array, its joints
        in_joints : Correction, the answer in joints
        largest : (2,) array, largest believed correction of a pose, m and rad
        """
        assert in_joints.joints is not None
        chain = self.kinematics.chain
        before, after = chain.forward(np.array([q, in_joints.joints]))
        turned = se3.rotvec_from_matrix(after[:3, :3] @ before[:3, :3].T)
        residual = np.concatenate([after[:3, 3] - before[:3, 3], turned])
        moved, quaternion, limited = command(position, rotation, residual, largest)
        std = np.sqrt(chain.jacobian(in_joints.joints) ** 2 @ np.nan_to_num(in_joints.std) ** 2)
        reasons = Reason(int(in_joints.reasons) | (int(Reason.LIMITED) if limited else 0))
        return Correction(moved, quaternion, None, std, self.intervals.interval95(std), reasons)

    def _as_poses(
        self,
        reference: PoseSignal,
        q: FloatArray,
        in_joints: Correction,
        calibration: IntervalCalibration,
        bounds: Bounds | None = None,
    ) -> Correction:
        """Return answers in joints as poses, within bounds; NaN where joints are."""
        assert in_joints.joints is not None
        known = np.asarray(np.isfinite(in_joints.joints).all(axis=1) & np.isfinite(q).all(axis=1))
        position, quaternion = np.full((len(q), 3), np.nan), np.full((len(q), 4), np.nan)
        std = np.full((len(q), 6), np.nan)
        cut = np.zeros(len(q), dtype=bool)
        if known.any():
            moved = self.kinematics.carried(reference[known], q[known], in_joints.joints[known])
            if bounds is not None:
                residual, cut[known] = bounds.limit(pose_residual(reference[known], moved))
                moved = apply_residual(reference[known], residual) if cut.any() else moved
            position[known], quaternion[known] = moved.position, moved.quaternion
            spread = self.kinematics.chain.jacobian(in_joints.joints[known]) ** 2
            std[known] = np.sqrt((spread @ np.nan_to_num(in_joints.std[known])[..., None] ** 2)[..., 0])
        intervals = calibration.interval95(std)
        return Correction(position, quaternion, None, std, intervals, in_joints.reasons).because(Reason.LIMITED, cut)


def _look_first(
    kinematics: ArmKinematics,
    log: CalibrationLog,
    pair: tuple[PoseSignal, PoseSignal],
    settings: FitSettings,
    alone: LeftOut,
) -> None:
    """Refuse joints that promise nothing to a linear law of some samples and of a usual play, not searched for."""
    few = np.arange(0, len(log), -(-len(log) // MOST_LOOKED_AT))
    shown = (pair[0][few], pair[1][few])
    kinematics, wanted = kinematics.reaching(shown[0])
    joints = PoseJoints.of(log.select(few), shown, kinematics, wanted)
    task = JointTask.of(joints.log, joints.known, settings, searched=False)
    _require_promise(kinematics, joints, task.samples, task.layout, alone, UNSEARCHED)


def _require_promise(
    kinematics: ArmKinematics, joints: PoseJoints, samples: Samples, layout: Layout, alone: LeftOut, most: float
) -> None:
    """Refuse joints whose linear law leaves clearly more at left-out trajectories than poses alone."""
    rows = samples.rows
    if samples.target.shape[1] != joints.asked.shape[1]:
        return
    first = cross_predicted(lambda s: PolynomialMap.fit(*s.learnable(), 1, layout.penalties), samples, LIMITS.folds)
    commanded = joints.asked[rows] - first.errors
    moved = kinematics.carried(joints.reference[rows], joints.wanted[rows], commanded)
    change = changes(replace(first, errors=pose_residual(moved, joints.command[rows])), alone)
    if change.mean() > most:
        raise DegenerateError(f"a linear law of them promises too little, {changes_text(change)}.")


def _where_left_out(
    found: FloatArray, truth: FloatArray, samples: Samples, left_out: LeftOut, view: JointView
) -> FloatArray:
    """Return joints `(n, d)` with what was found without their own trajectories, where that is known."""
    known, found = np.isfinite(left_out.errors).all(axis=1), np.array(found)
    cells = np.ix_(samples.rows[known], view.moving)
    found[cells] = truth[cells] - left_out.errors[known]
    return found


class _RouteStream:
    """Answers desired joints one after the other, as :meth:`JointRoute.correct` does along a path."""

    def __init__(self, route: JointRoute) -> None:
        self._first, self._aim = route.joints.stream(), None if route.aim is None else route.aim.stream()

    def correct(self, time: float, q: FloatArray) -> Correction:
        """Return what to command `(d,)`; with a missing number NaN, and the path begins anew."""
        answer = self._first.correct(time, q)
        if self._aim is None:
            return answer
        assert answer.joints is not None
        moved, beyond = self._aim.moved(time, q, answer.joints)
        return replace(answer, joints=moved).because(Reason.OUTSIDE, beyond)
