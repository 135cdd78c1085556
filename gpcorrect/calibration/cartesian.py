"""Poses: desired pose in, command and its uncertainty out (Mahler et al. 2014, Sec. IV)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.calibration import queries
from gpcorrect.calibration.bridging import MotionLimits
from gpcorrect.calibration.dataset import Samples, path_starts
from gpcorrect.calibration.joint_route import JointRoute
from gpcorrect.calibration.learn_poses import learn_poses
from gpcorrect.calibration.memory import History
from gpcorrect.calibration.metrics import error_table
from gpcorrect.calibration.one_pose import Frame, command, frame, inputs
from gpcorrect.calibration.pose_samples import Memory, PosePairs, features_of, samples_of_poses
from gpcorrect.calibration.poses import observed_twists, pose_pair, reference_twists, rotations_of
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.calibration.stream import PoseStream
from gpcorrect.calibration.task import Corrector, LearnLaw, Measured, Outcome
from gpcorrect.cleaning import POSES, FittedCleaner, Pair
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError, LogError
from gpcorrect.gpr import FeatureMap
from gpcorrect.rigid import RigidModel, apply_residual, pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, frozen_array
from gpcorrect.velocity import twists

POSITION, POSE, TWIST = 3, 7, 6  # numbers of a pose without orientation and with it, and of a velocity
NO_MEMORY = np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True)
class CommandCorrector(Corrector):
    """Computes what to command so that the robot reaches a desired pose: `F(x) = H(G(x))`.

    `G` is the rigid registration from the observer's frame to the command's, `H` adds the residual that was learned
    from pose and velocity.

    Parameters
    ----------
    rigid : RigidModel
        G.
    features : FeatureMap
        From a reference pose and its twist to the inputs of the law.
    motion : MotionLimits or None
        What no arm does from one pose of a path to the next; None believes every path, as a fit without cleaning does.
    velocity_step : float or None
        Step of the stencil on recorded paths, s; None takes five neighbouring samples.
    check_queries : (k, 13) array
        Training queries (pose, twist) that a model file asks again at load.
    memory : Memory or None
        What was learned with memory features; None without.
    route : JointRoute or None
        What was learned of the arm's joints, by which paths and streams are answered; None without.
    """

    KIND: ClassVar[str] = "gpcorrect.command_corrector"
    TASK: ClassVar[str] = "pose"

    rigid: RigidModel
    features: FeatureMap
    motion: MotionLimits | None
    velocity_step: float | None
    check_queries: FloatArray
    memory: Memory | None = None
    route: JointRoute | None = None
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
        if self.memory is not None:
            laws.append((self.memory.law, d + self.memory.states.size))
        fits = self.features.spread.shape == (d,) and self.law.domain.low.shape == (d,)
        fits = fits and self.trained.low.shape == self.trained.high.shape == (POSITION,)
        for law, width in laws:
            fits = fits and tuple(law.bounds.sizes) == sizes
            single, rows = law.unguarded_one(np.zeros(width)), law.predict_rows(np.zeros((1, width)))
            found = [np.shape(part) for part in (*single[:2], rows.residual[0], rows.interval95[0])]
            fits = fits and found == 4 * [(sum(sizes),)]
        if not fits or self.check_queries.shape[1:] != (POSE + TWIST,):
            raise DataError(f"a model of poses with {d} features does not fit together.")

    @classmethod
    def pair(cls, log: CalibrationLog, settings: FitSettings) -> Pair:
        """See :class:`Corrector`."""
        features_of(log, settings)
        observed, commanded = pose_pair(log)
        if not (observed.finite & commanded.finite).any():
            raise LogError(
                f"no sample of {len(log)} has both poses complete (tracker_cp: {int(observed.finite.sum())},"
                f" setpoint_cp: {int(commanded.finite.sum())}).",
                hint="Look for missing numbers, quaternions not of norm 1, clocks apart: gpcorrect validate",
                path=log.name,
            )
        return POSES

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

    def one(self, query: FloatArray, twist: FloatArray, reasons: int, memory: FloatArray | None = None) -> Correction:
        """Answer a checked pose in machine code.

        Parameters
        ----------
        query : (7,) or (3,) array
            Pose, m and wxyz.
        twist : (6,) array
            m/s and rad/s.
        reasons : int
            What was not used, :class:`Reason` codes.
        memory : (h,) array, optional
            Memory features.

        Raises
        ------
        DataError
            A number is not finite, or the quaternion is not a unit one.
        """
        f, region, law = self.frame, self.region, self.law
        if memory is not None and self.memory is not None:
            f, law = frame(self.rigid, self.features, len(memory)), self.memory.law
        good, position, rotation, x, near = inputs(query, twist, NO_MEMORY if memory is None else memory, f, region)
        if not good:
            raise queries.bad_query(query, twist)
        mean, std, novelty = law.unguarded_one(x)
        position, quaternion, limited = command(position, rotation, mean, law.bounds.largest)
        in_domain = near and novelty <= law.domain.novelty
        if not in_domain:
            self.trained.refuse_far(query[:POSITION])
            std, reasons = law.domain.widen(std, in_domain), reasons | int(Reason.OUTSIDE)
        if limited:
            reasons |= int(Reason.LIMITED)
        return Correction(
            position=position,
            quaternion=None if len(query) == POSITION else quaternion,
            joints=None,
            std=_six(std),
            interval95=_six(law.intervals.interval95(std)),
            reasons=Reason(reasons),
        )

    def stream(self) -> PoseStream:
        """Return a stream, which answers poses one after the other and takes velocity and memory from those before."""
        return PoseStream(self)

    def correct_path(self, poses: ArrayLike, times: ArrayLike) -> Correction:
        """Return what to command instead of a timed path; its velocities come from the five-point stencil on the path.

        Lone jumps that no arm can follow are bridged, and their samples are marked (status LIMITED).

        Parameters
        ----------
        poses : (n, 7) or (n, 3) array
            Desired poses, as for :meth:`correct`.
        times : (n,) array
            Seconds, strictly increasing. A path of one pose is at rest.

        Returns
        -------
        Correction
            Of n rows.

        Raises
        ------
        DataError
            As for :meth:`correct`, or the times do not increase, or cannot be seconds.
        """
        rows = queries.checked_poses(poses, orientation=self.has_orientation)
        seconds = queries.checked_times(times, len(rows))
        self.trained.refuse_far(rows[:, :POSITION])
        self.trained.refuse_slow(rows[:, :POSITION], seconds)
        desired = PoseSignal(rows[:, :3], rows[:, 3:] if rows.shape[1] > 3 else None)
        labels = np.zeros(len(rows), dtype=np.int64)
        desired, replaced = self.possible(desired, seconds, labels)
        twist = np.nan_to_num(twists(seconds, desired.position, rotations_of(desired), labels))
        if self.memory is None:
            answer = self.correct_observed(desired, twist)
            if self.route is not None:
                in_joints = self.route.correct(self.rigid.apply(desired), seconds, labels, self.law.bounds)
                answer = self.joined(in_joints, answer)
            return answer.because(Reason.BRIDGED, replaced)
        stream = self.stream()  # memory is of the commands, which are known one after the other
        steps = zip(seconds, queries.pose_rows(desired), twist, strict=True)
        return Correction.stack([stream.correct(*row) for row in steps]).because(Reason.BRIDGED, replaced)

    def possible(self, desired: PoseSignal, time: FloatArray, labels: IntArray) -> tuple[PoseSignal, BoolArray]:
        """Return desired paths with the lone jumps of each run bridged, and which poses (n,) were replaced.

        Parameters
        ----------
        desired : PoseSignal
            n poses.
        time : (n,) array
            s.
        labels : (n,) int array
            Unbroken run of each pose, -1 for none.
        """
        if self.motion is None:
            return desired, np.zeros(len(desired), dtype=bool)
        return self.motion.bridge(desired, self.rigid.apply(desired), time, labels)

    def correct_observed(
        self, desired: PoseSignal, twist: FloatArray, commands: PoseSignal | None = None, new: BoolArray | None = None
    ) -> Correction:
        """Return what to command instead of desired poses with known twists.

        Parameters
        ----------
        desired : PoseSignal
            n poses.
        twist : (n, 6) array
            m/s and rad/s.
        commands : PoseSignal, optional
            What was commanded at each row: the history of memory features. Without it memory is not used.
        new : (n,) mask, optional
            Rows at which a path begins.

        Returns
        -------
        Correction
            Of n rows.
        """
        reference = self.rigid.apply(desired)
        moved = reference_twists(self.rigid, rotations_of(desired), twist)
        X = self.features.transform(reference.position, rotations_of(reference), moved)
        law = self.law
        if self.memory is not None and commands is not None and new is not None:
            history = History.of(commands, reference, np.cumsum(new, dtype=np.int64), orientation=self.has_orientation)
            X, law = np.hstack([X, self.memory.states.transform(history)]), self.memory.law
        prediction = law.predict_rows(X)
        answer = apply_residual(reference, np.nan_to_num(_six(prediction.residual)))
        return Correction(
            position=answer.position,
            quaternion=answer.quaternion,
            joints=None,
            std=_six(prediction.std),
            interval95=_six(prediction.interval95),
            reasons=prediction.reasons,
        )

    def without_joints(self, alone: Correction) -> Correction:
        """Return answers of pose and velocity to poses that the arm comes not near: nothing is known there.

        Parameters
        ----------
        alone : Correction
            One answer or n.
        """
        std = self.law.domain.widen(alone.std, np.zeros(alone.std.shape[:-1], dtype=bool))
        return replace(alone, std=std, interval95=self.law.intervals.interval95(std)).because(Reason.OUTSIDE)

    def joined(self, answer: Correction, alone: Correction) -> Correction:
        """Return n answers found in joints; where they are NaN, those without.

        Parameters
        ----------
        answer, alone : Correction
            n answers.
        """
        known = np.asarray(np.isfinite(answer.std).all(axis=1))
        return answer if known.all() else answer.at(known, self.without_joints(alone))

    def query_path(self, log: CalibrationLog) -> FloatArray:
        """See :class:`Corrector`."""
        return pose_pair(log)[0].position

    def samples(self, log: CalibrationLog, keep: BoolArray, *, with_memory: bool = False) -> Samples:
        """Return a log as the law, or that with memory, sees it.

        Parameters
        ----------
        log : CalibrationLog
            n samples.
        keep : (n,) mask
            Samples that are not rejected.
        with_memory : bool
            Whether inputs end in memory features.

        Raises
        ------
        LogError
            The log lacks a signal, or orientations that the model needs, or any good sample.
        """
        if self.has_orientation and pose_pair(log)[0].quaternion is None:
            raise LogError("the model corrects orientations, and the log holds none.", path=log.name)
        pairs = PosePairs.of(log, keep, self.velocity_step)
        if not self.has_orientation:
            pairs = replace(
                pairs, observed=PoseSignal(pairs.observed.position), command=PoseSignal(pairs.command.position)
            )
        states = self.memory.states if with_memory and self.memory is not None else None
        return samples_of_poses(pairs, log, self.rigid, self.features, states)

    def measure(self, log: CalibrationLog, keep: BoolArray) -> Measured:
        """See :class:`Corrector`; velocities never cross a rejected sample."""
        observed, commanded = pose_pair(log)
        possible, _ = self.possible(observed, log.time, np.where(keep & observed.finite, log.trajectory, -1))
        twist = observed_twists(log, possible, keep, self.velocity_step)
        rows = np.flatnonzero(keep & observed.finite & commanded.finite & np.isfinite(twist[:, :3]).all(axis=1))
        if rows.size == 0:
            raise LogError(
                "no sample that passes has both poses and a velocity.",
                hint="See: gpcorrect validate LOG",
                path=log.name,
            )
        observed, commanded, twist = observed[rows], commanded[rows], twist[rows]
        new = path_starts(log.time[rows], log.session[rows], np.ones(len(rows), dtype=bool))
        answer = self.correct_observed(possible[rows], twist, commanded, new)
        if self.route is not None:  # the motion before what is measured is known too, as it is to a stream
            path = possible.finite & ~np.isin(log.trajectory, log.trajectory[rows])
            path[rows] = True
            known = self.rigid.apply(possible[path])
            in_joints = self.route.correct(known, log.time[path], log.session[path], self.law.bounds)
            answer = self.joined(in_joints[np.isin(np.flatnonzero(path), rows)], answer)
        assert answer.position is not None
        return Measured(
            raw=pose_residual(observed, commanded),
            registered=pose_residual(self.rigid.apply(observed), commanded),
            corrected=pose_residual(PoseSignal(answer.position, answer.quaternion), commanded),
            interval95=answer.interval95,
            in_domain=answer.in_domain,
            speed=np.linalg.norm(twist[:, :3], axis=1),
            rows=rows,
            time=log.time[rows],
            trajectory=log.trajectory[rows],
        )

    def error_table(self, errors: FloatArray) -> Any:
        """See :class:`Corrector`."""
        return error_table(errors)

    def check_answers(self) -> FloatArray:
        """See :class:`Corrector`: to each recorded query by itself, then with memory or through the arm's joints."""
        size = POSE if self.has_orientation else POSITION
        poses, twist = self.check_queries[:, :size], self.check_queries[:, POSE:]
        alone = Correction.stack([self.correct(*query) for query in zip(poses, twist, strict=True)])
        found = [alone.numbers(alone.std)]
        desired = PoseSignal(poses[:, :3], poses[:, 3:] if size > POSITION else None)
        if self.memory is not None:
            new = np.arange(len(poses)) == 0
            recalled = self.correct_observed(desired, twist, self.rigid.apply(desired), new)
            found.append(recalled.numbers(recalled.interval95))
        if self.route is not None:
            found.append(self.route.check_answers(self.rigid.apply(desired), self.law.bounds))
        return np.vstack(found)

    @classmethod
    def learn(
        cls, log: CalibrationLog, keep: BoolArray, cleaner: FittedCleaner, settings: FitSettings, learn_law: LearnLaw
    ) -> Outcome:
        """See :class:`Corrector`."""
        return learn_poses(cls, log, keep, cleaner, settings, learn_law)


def _six(values: FloatArray) -> FloatArray:
    """Pad the three components `(..., 3)` of a position-only model with NaN."""
    return values if values.shape[-1] == 6 else np.concatenate([values, np.full_like(values, np.nan)], axis=-1)
