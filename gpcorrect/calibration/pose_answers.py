"""What a corrector of poses answers: single poses, paths and streams of them (Mahler et al. 2014, Sec. IV)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.calibration import queries
from gpcorrect.calibration.held_orientation import HeldOrientation
from gpcorrect.calibration.joint_route import JointRoute
from gpcorrect.calibration.memory import Memory, advance, steps
from gpcorrect.calibration.one_pose import Frame, command, frame, inputs
from gpcorrect.calibration.poses import Steps, reference_twists, rotations_of
from gpcorrect.calibration.queries import POSE, POSITION, TWIST
from gpcorrect.calibration.task import Corrector
from gpcorrect.calibration.training_motion import MotionLimits, StreamGuard
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError
from gpcorrect.gpr import FeatureMap
from gpcorrect.rigid import RigidModel, apply_residual
from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal, frozen_array
from gpcorrect.velocity import CausalTwist, twists

NO_MEMORY = np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseAnswers(Corrector):
    """Computes what to command so that the robot reaches a desired pose: `F(x) = H(G(x))`.

    Parameters
    ----------
    rigid : RigidModel
        G, the registration from the observer's frame to the command's; H adds the residual that was learned.
    features : FeatureMap, from a reference pose and its twist to the inputs of the law
    motion : MotionLimits or None
        What no arm does from one pose of a path to the next; None believes every path, as a fit without cleaning does.
    velocity_steps : pair of float
        Steps, s, of the stencils on recorded paths, of positions and of turns; 0 takes five neighbouring samples.
    check_queries : (k, 13) array, training queries (pose, twist) that a model file asks again at load
    memory : Memory or None, what was learned with memory features, for paths and streams
    route : JointRoute or None, what was learned of the arm's joints, by which paths and streams are answered
    held : HeldOrientation or None
        What is known of rotations that the training hardly commanded; None of a model that corrects them, or that never
        saw any.
    """

    rigid: RigidModel
    features: FeatureMap
    motion: MotionLimits | None
    velocity_steps: Steps
    check_queries: FloatArray
    memory: Memory | None = None
    route: JointRoute | None = None
    held: HeldOrientation | None = None
    frame: Frame = field(init=False, repr=False)
    region: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "check_queries", frozen_array(self.check_queries))
        object.__setattr__(self, "frame", frame(self.rigid, self.features))
        object.__setattr__(self, "region", np.array([self.law.domain.low, self.law.domain.high]))
        self._check_fits()
        middle = (self.trained.low + self.trained.high) / 2
        self.correct([*middle, 1.0, 0.0, 0.0, 0.0])  # what is compiled at first use is compiled now

    def _check_fits(self) -> None:
        """Refuse parts that do not fit together before compiled code, which does not look, reads them."""
        sizes, d = (3, 3) if self.has_orientation else (3,), self.features.n_features
        laws = [(self.law, d)]
        if self.held is not None and self.has_orientation:
            raise DataError("a model that corrects orientations does not hold one.")
        if self.memory is not None:
            laws.append((self.memory.law, d + self.memory.states.radii.size))
        fits = self.features.spread.shape == (d,) and self.law.domain.low.shape == (d,)
        fits = fits and self.trained.low.shape == self.trained.high.shape == (POSITION,)
        for law, width in laws:
            fits = fits and tuple(law.bounds.sizes) == sizes
            single, rows = law.unguarded_one(np.zeros(width)), law.predict_rows(np.zeros((1, width)))
            found = [np.shape(part) for part in (*single[:2], rows.residual[0], rows.interval95[0])]
            fits = fits and found == 4 * [(sum(sizes),)]
        if not fits or self.check_queries.shape[1:] != (POSE + TWIST,):
            raise DataError(f"a model of poses with {d} features does not fit together.")

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
            position-only model takes three numbers, and with seven only turns the orientation into the base frame. So
            does one whose training held the orientation, which says too by how much it is then missed.
        twist : (6,) array, optional
            Desired velocity, m/s and rad/s, same frame. Without it the pose is taken as at rest, and the answer is
            marked.

        Raises
        ------
        DataError
            The pose or the twist is not finite, has the wrong length, its quaternion is not a unit quaternion, or the
            pose is so far off the training that it cannot be in metres.
        """
        query, velocity = queries.pose_numbers(pose, orientation=self.has_orientation), queries.twist_numbers(twist)
        reasons = int(Reason.AT_REST) if twist is None and self.features.uses_velocity else 0
        if self.memory is not None or self.route is not None:
            reasons |= int(Reason.NO_HISTORY)
        return self.one(query, velocity, reasons)

    def one(self, query: FloatArray, twist: FloatArray, reasons: int, memory: FloatArray = NO_MEMORY) -> Correction:
        """Answer a pose of the right length in machine code; raises as :meth:`correct`.

        Parameters
        ----------
        query, twist : (7,) or (3,), and (6,) arrays, m and wxyz; m/s and rad/s
        reasons : int, what was not used, :class:`Reason` codes
        memory : (h,) array, optional, memory features
        """
        f, law = self.frame, self.law
        if memory.size and self.memory is not None:
            f, law = frame(self.rigid, self.features, memory.size), self.memory.law
        good, position, rotation, x, near = inputs(query, twist, memory, f, self.region)
        if not good:
            raise queries.bad_query(query, twist)
        mean, std, novelty = law.unguarded_one(x)
        position, quaternion, limited = command(position, rotation, mean, law.bounds.largest)
        oriented = len(query) > POSITION
        in_domain = near and novelty <= law.domain.novelty and bool(law.domain.surrounded(x[None])[0])
        if self.held is not None and oriented:
            in_domain = in_domain and not self.held.beyond(rotation[None])[0]
        if not in_domain:
            self.trained.refuse_far(query[:POSITION])
            std, reasons = law.domain.widen(std, in_domain), reasons | int(Reason.OUTSIDE)
        if limited:
            reasons |= int(Reason.LIMITED)
        std, interval95 = self.six(std, law.intervals.interval95(std), rotation if oriented else None)
        return Correction(position, quaternion if oriented else None, None, std, interval95, Reason(reasons))

    def six(
        self, std: FloatArray, interval95: FloatArray, rotations: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return deviations and half widths of whole poses `(..., 6)`; NaN where nothing is known of rotations.

        Parameters
        ----------
        std, interval95 : (..., 3) or (..., 6) arrays, of the law
        rotations : (..., 3, 3) array or None, registered orientations, where the poses have any
        """
        if self.held is None or rotations is None:
            return _six(std), _six(interval95)
        return self.held.whole(std, interval95, rotations)

    def stream(self) -> PoseStream:
        """Return a stream, which answers poses one after the other and takes velocity and memory from those before."""
        return PoseStream(self)

    def correct_path(self, poses: ArrayLike, times: ArrayLike) -> Correction:
        """Return what to command instead of a timed path, n rows; velocities come from the five-point stencil on it.

        Lone jumps that no arm can follow are bridged, and their samples are marked (status LIMITED).

        Parameters
        ----------
        poses : (n, 7) or (n, 3) array, desired poses, as for :meth:`correct`
        times : (n,) array, seconds, strictly increasing; A path of one pose is at rest

        Raises
        ------
        DataError
            As for :meth:`correct`, or the times do not increase, or cannot be seconds.
        """
        rows = queries.checked_poses(poses, orientation=self.has_orientation)
        seconds = queries.checked_times(times, len(rows))
        self.trained.refuse_far(rows[:, :POSITION])
        self.trained.refuse_slow(rows[:, :POSITION], seconds)
        labels = np.zeros(len(rows), dtype=np.int64)
        desired, replaced = self.possible(PoseSignal.of(rows), seconds, labels)
        twist = np.nan_to_num(twists(seconds, desired.position, rotations_of(desired), labels))
        if self.memory is None:
            answer = self.correct_observed(desired, twist)
            if self.route is not None:
                in_joints = self.route.correct(self.rigid.apply(desired), seconds, labels, self.law.bounds)
                answer = self.joined(in_joints, answer)
            return answer.because(Reason.BRIDGED, replaced)
        stream = self.stream()  # memory is of the commands, which are known one after the other
        rows_of_path = zip(seconds, desired.table, twist, strict=True)
        return Correction.stack([stream.correct(*row) for row in rows_of_path]).because(Reason.BRIDGED, replaced)

    def possible(self, desired: PoseSignal, time: FloatArray, labels: IntArray) -> tuple[PoseSignal, BoolArray]:
        """Return desired paths with the lone jumps of each run bridged, and which poses (n,) were replaced.

        Parameters
        ----------
        desired : PoseSignal, n poses
        time : (n,) array, s
        labels : (n,) int array, unbroken run of each pose, -1 for none
        """
        if self.motion is None:
            return desired, np.zeros(len(desired), dtype=bool)
        return self.motion.bridge(desired, self.rigid.apply(desired), time, labels)

    def correct_observed(
        self, desired: PoseSignal, twist: FloatArray, commands: PoseSignal | None = None, new: BoolArray | None = None
    ) -> Correction:
        """Return what to command instead of n desired poses with known twists.

        Parameters
        ----------
        desired : PoseSignal, n poses
        twist : (n, 6) array, m/s and rad/s
        commands : PoseSignal, optional
            What was commanded at each row: the history of memory features. Without it memory is not used.
        new : (n,) mask, optional, rows at which a path begins
        """
        reference = self.rigid.apply(desired)
        moved = reference_twists(self.rigid, rotations_of(desired), twist)
        X = self.features.transform(reference.position, rotations_of(reference), moved)
        law = self.law
        if self.memory is not None and commands is not None and new is not None:
            past = [p if self.has_orientation else PoseSignal(p.position) for p in (commands, reference)]
            states = self.memory.states.transform(past[0], past[1], np.cumsum(new, dtype=np.int64))
            X, law = np.hstack([X, states]), self.memory.law
        prediction, rotations = law.predict_rows(X), rotations_of(reference)
        if self.held is not None and rotations is not None:
            prediction = law.outside(prediction, self.held.beyond(rotations))
        answer = apply_residual(reference, np.nan_to_num(_six(prediction.residual)))
        std, interval95 = self.six(prediction.std, prediction.interval95, rotations)
        return Correction(answer.position, answer.quaternion, None, std, interval95, prediction.reasons)

    def without_joints(self, alone: Correction) -> Correction:
        """Return answers of pose and velocity to poses that the arm comes not near: nothing is known there.

        Parameters
        ----------
        alone : Correction, one answer or n
        """
        std = self.law.domain.widen(alone.std, np.zeros(alone.std.shape[:-1], dtype=bool))
        return replace(alone, std=std, interval95=self.law.intervals.interval95(std)).because(Reason.OUTSIDE)

    def joined(self, answer: Correction, alone: Correction) -> Correction:
        """Return n answers found in joints; where they are NaN, those without.

        Parameters
        ----------
        answer, alone : Correction, n answers
        """
        known = np.asarray(np.isfinite(answer.std).all(axis=1))
        return answer if known.all() else answer.at(known, self.without_joints(alone))


def _six(values: FloatArray) -> FloatArray:
    """Pad the three components `(..., 3)` of a position-only model with NaN."""
    return values if values.shape[-1] == 6 else np.concatenate([values, np.full_like(values, np.nan)], axis=-1)


class PoseStream:
    """Answers desired poses one after the other; one stream a planner and thread.

    Memory is of its own answers: they are taken as commanded. Call :meth:`reset` where they were not.

    Parameters
    ----------
    corrector : PoseAnswers, what answers
    """

    def __init__(self, corrector: PoseAnswers) -> None:
        self._corrector = corrector
        self._twist = CausalTwist()
        self._guard = StreamGuard(corrector.trained)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after the arm was moved by hand."""
        self._twist.reset()
        self._guard.reset()
        self._last: tuple[PoseSignal, PoseSignal] | None = None  # reference and command of the pose before, a row each
        route, memory = self._corrector.route, self._corrector.memory
        self._joints = None if route is None else route.stream()
        self._q: FloatArray | None = None
        self._state = NO_MEMORY if memory is None else np.zeros(memory.states.radii.shape)

    def correct(self, time: float, pose: ArrayLike, twist: ArrayLike | None = None) -> Correction:
        """Return what to command so that the robot reaches `pose` at `time`.

        Parameters
        ----------
        time : float, seconds, later than that of the pose before
        pose : (7,) or (3,) array, as for `CommandCorrector.correct`
        twist : (6,) array, optional, desired velocity; estimated from the poses so far when not given

        Raises
        ------
        DataError
            As for `CommandCorrector.correct`, or time does not advance; the past stays.
        """
        corrector = self._corrector
        query = queries.pose_numbers(pose, orientation=corrector.has_orientation)
        given = queries.twist_numbers(twist)
        good, position, rotation, *_ = inputs(query, given, NO_MEMORY, corrector.frame, corrector.region)
        if not good:
            raise queries.bad_query(query, given)
        self._guard.admit(time, query[:3])
        route, in_joints = corrector.route, None
        if self._joints is not None and route is not None:
            q = route.kinematics.inverse_one(position, rotation, self._q)
            in_joints, self._q = self._joints.correct(time, q), q if np.isfinite(q).all() else None
        turned = se3.matrix_from_quaternion(query[None, 3:])[0] if len(query) > 3 else None
        estimated = self._twist.update(time, query[:3], turned)
        velocity = np.nan_to_num(estimated) if twist is None else given
        reasons = int(Reason.JUST_BEGUN) if twist is None and not np.isfinite(estimated[:3]).all() else 0
        if route is not None and in_joints is not None:
            if self._q is None:
                return corrector.without_joints(corrector.one(query, velocity, reasons))
            answer = route.as_pose(position, rotation, self._q, in_joints, corrector.law.bounds.largest)
            return answer.because(Reason(reasons))
        if corrector.memory is None:
            return corrector.one(query, velocity, reasons)
        quaternion = se3.quaternion_from_matrix(rotation[None]) if corrector.has_orientation else None
        return self._remembering(corrector.memory, PoseSignal(position[None], quaternion), query, velocity, reasons)

    def _remembering(
        self, memory: Memory, reference: PoseSignal, query: FloatArray, velocity: FloatArray, reasons: int
    ) -> Correction:
        """Answer with the slacks where the last command left them, then move them on by what is commanded."""
        state, radii = self._state, memory.states.radii
        if self._last is not None:
            state = advance(state, _step(self._last[0], reference), radii)
        answer = self._corrector.one(query, velocity, reasons, memory.states.features(state))
        assert answer.position is not None
        quaternion = None if reference.quaternion is None or answer.quaternion is None else answer.quaternion[None]
        commanded = PoseSignal(answer.position[None], quaternion)
        if self._last is not None:
            self._state = advance(self._state, _step(self._last[1], commanded), radii)
        self._last = reference, commanded
        return answer


def _step(first: PoseSignal, second: PoseSignal) -> FloatArray:
    """Return the step `(k,)` between two poses of one row each, see :func:`gpcorrect.calibration.memory.steps`."""
    return np.asarray(steps(PoseSignal.of(np.vstack([first.table, second.table])))[1])
