"""Poses: how a corrector of them is learned and measured (Mahler et al. 2014, Sec. IV)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from gpcorrect.calibration.arm_kinematics import ArmKinematics
from gpcorrect.calibration.dataset import Layout, Samples, folds_of, path_starts
from gpcorrect.calibration.domain import Bounds
from gpcorrect.calibration.held_orientation import HeldOrientation, hardly_turns, lever_note, register_held
from gpcorrect.calibration.joint_route import JointRoute
from gpcorrect.calibration.memory import Memory, MemoryMap, choose_memory
from gpcorrect.calibration.metrics import error_table
from gpcorrect.calibration.pose_answers import PoseAnswers
from gpcorrect.calibration.poses import (
    WORTH_IT,
    PosePairs,
    changes,
    changes_text,
    observed_twists,
    pose_pair,
    reference_twists,
    rotations_of,
    stencil_steps,
)
from gpcorrect.calibration.queries import POSE, POSITION
from gpcorrect.calibration.sessions import sessions_apart
from gpcorrect.calibration.settings import JOINTS, LIMITS, MEMORY, FitSettings
from gpcorrect.calibration.task import LearnLaw, Measured, Outcome
from gpcorrect.calibration.training_motion import MotionLimits, TrainingMotion
from gpcorrect.cleaning import POSES, FittedCleaner, Pair
from gpcorrect.correction import Correction
from gpcorrect.errors import DataError, GpCorrectError, LogError
from gpcorrect.gpr import FeatureMap, IntervalCalibration, LeftOut
from gpcorrect.rigid import Registration, RigidModel, pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, PoseSignal

INDUCING = 700
"""Points of the Gaussian process: within a tenth of 1500 points' error on simulated reaches (bench/gpr_choices.py)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CommandCorrector(PoseAnswers):
    """Computes what to command so that the robot reaches a desired pose, with what a log of poses teaches.

    Single poses are answered from pose and velocity. Paths and streams are answered with memory where the settings ask
    for it, and through the arm's joints where the log shows them and left-out trajectories are the better for it.
    """

    KIND: ClassVar[str] = "gpcorrect.command_corrector"
    TASK: ClassVar[str] = "pose"

    @classmethod
    def pair(cls, log: CalibrationLog, settings: FitSettings) -> Pair:
        """See :class:`Corrector`."""
        _features_of(log, settings)
        observed, commanded = pose_pair(log)
        if not (observed.finite & commanded.finite).any():
            raise LogError(
                f"no sample of {len(log)} has both poses complete (tracker_cp: {int(observed.finite.sum())},"
                f" setpoint_cp: {int(commanded.finite.sum())}).",
                hint="Look for poses on rows of their own, clocks apart, quaternions not of norm 1: gpcorrect validate",
                path=log.name,
            )
        return POSES

    @classmethod
    def learn(
        cls, log: CalibrationLog, keep: BoolArray, cleaner: FittedCleaner, settings: FitSettings, learn_law: LearnLaw
    ) -> Outcome:
        """See :class:`Corrector`."""
        kinds, features = _features_of(log, settings)
        velocity_steps = stencil_steps(log)
        pairs = PosePairs.of(log, keep, velocity_steps)
        shown = log.select(pairs.rows)
        # What is asked for is refused before the work.
        kinematics = ArmKinematics.of(shown) if JOINTS in kinds else None
        pairs, registration, turns = _registered(pairs, log, settings)
        rigid = registration.model
        reference = rigid.apply(pairs.observed)
        moved = reference_twists(rigid, rotations_of(pairs.observed), pairs.twist)
        features = features.fit(reference.position, rotations_of(reference), moved)
        samples = _samples_of_poses(pairs, log, rigid, features, None)
        law, left_out = learn_law(samples, _pose_layout(features, None))
        held = None if turns is None else HeldOrientation.of(*turns, samples)
        remarks = [f"registration: {registration.reason}", *_not_corrected(features, held)]
        remarks += lever_note(log, pairs.rows, reference.position, pairs.command.position - reference.position)
        used = [kind for kind in kinds if kind not in (MEMORY, JOINTS)]
        best = alone = _Answers(samples, left_out, law.intervals)
        poses = (reference, pairs.command)
        in_joints = partial(_in_joints, kinematics, shown, poses, cleaner, settings, learn_law, left_out)
        recalling = partial(_recalling, pairs, log, rigid, features, law.bounds, learn_law, samples)
        for kind, says, what, learned, least in (
            (JOINTS, "corrected in the arm's joints", "the log's joints are", in_joints, WORTH_IT),
            (MEMORY, "memory acts on the pose", "memory is", recalling, LIMITS.memory_lessens),
        ):
            asked = kind in kinds
            if not asked and (settings.features or held is not None or best is not alone):
                continue
            try:
                found = learned(asked=asked)
            except GpCorrectError as error:
                if asked:
                    raise
                remarks.append(f"{what} not used: {error}")
                continue
            if found is None:
                continue
            change = changes(found.left_out, left_out)
            helps = change.mean() <= -least
            fate = "" if helps else "; used because it was asked for" if asked else "; not used"
            remarks.append(f"{says}; {changes_text(change)}{fate}")
            if asked or helps:
                best = found
                used.append(kind)
        path = pose_pair(log)[0].position
        corrector = cls(
            law=law,
            cleaner=cleaner,
            trained=TrainingMotion.of(path, log, keep, joints=False),
            rigid=rigid,
            features=features,
            motion=MotionLimits.of(cleaner) if settings.clean else None,
            velocity_steps=velocity_steps,
            check_queries=pairs.check_queries,
            memory=best.by if isinstance(best.by, Memory) else None,
            route=best.by if isinstance(best.by, JointRoute) else None,
            held=held,
        )
        parts = corrector.parts(samples.target.shape[1])
        missed, wide = samples.target[samples.rows], samples.sessions_left_out is not None
        remarks += sessions_apart(log, samples.rows, alone.left_out.errors, missed, parts, wide=wide)
        left_out, intervals = best.left_out, best.intervals
        if turns is not None and held is not None:
            left_out, intervals = held.beside(left_out, intervals, *turns)
        low, high = pairs.observed.position.min(axis=0), pairs.observed.position.max(axis=0)
        report = {
            "frames": {"input": "tracker", "output": "base"},
            "units": {"position": "m", "rotation": "rad", "quaternion": "wxyz"},
            "features": used,
            "orientation": features.has_orientation,
            **({} if held is None else {"held_orientation": held.to_dict()}),
            "training_region": {"position_min": low.tolist(), "position_max": high.tolist()},
        }
        return Outcome(corrector, best.samples, left_out, intervals, report, tuple(remarks), registration)

    def having_seen(self, log: CalibrationLog, keep: BoolArray) -> Self:
        """See :class:`Corrector`; what rotations miss is no less than it was."""
        changed = super().having_seen(log, keep)
        if self.held is None or pose_pair(log)[0].quaternion is None:
            return changed
        pairs = PosePairs.of(log, keep, self.velocity_steps)
        seen = HeldOrientation.of(self.rigid.apply(pairs.observed), pairs.command, self.samples(log, keep))
        return replace(changed, held=self.held.joined(seen))

    def cautions(self, log: CalibrationLog) -> tuple[str, ...]:
        """See :class:`Corrector`."""
        return (*super().cautions(log), *(() if self.held is None else (self.held.sentence,)))

    def query_path(self, log: CalibrationLog) -> FloatArray:
        """See :class:`Corrector`."""
        return pose_pair(log)[0].position

    def samples(self, log: CalibrationLog, keep: BoolArray, *, with_memory: bool = False) -> Samples:
        """Return a log as the law, or that with memory, sees it; raises as :meth:`Corrector.samples`.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        with_memory : bool, whether inputs end in memory features
        """
        if self.has_orientation and pose_pair(log)[0].quaternion is None:
            raise LogError("the model corrects orientations, and the log holds none.", path=log.name)
        pairs = PosePairs.of(log, keep, self.velocity_steps)
        if not self.has_orientation:
            pairs = pairs.positions
        states = self.memory.states if with_memory and self.memory is not None else None
        return _samples_of_poses(pairs, log, self.rigid, self.features, states)

    def measure(self, log: CalibrationLog, keep: BoolArray) -> Measured:
        """See :class:`Corrector`; velocities never cross a rejected sample."""
        observed, commanded = pose_pair(log)
        possible, _ = self.possible(observed, log.time, np.where(keep & observed.finite, log.trajectory, -1))
        twist = observed_twists(log, possible, keep, self.velocity_steps)
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
        return Measured(
            raw=pose_residual(observed, commanded),
            registered=pose_residual(self.rigid.apply(observed), commanded),
            corrected=pose_residual(answer.poses, commanded),
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
        desired = PoseSignal.of(poses)
        if self.memory is not None:
            new = np.arange(len(poses)) == 0
            recalled = self.correct_observed(desired, twist, self.rigid.apply(desired), new)
            found.append(recalled.numbers(recalled.interval95))
        if self.route is not None:
            found.append(self.route.check_answers(self.rigid.apply(desired), self.law.bounds))
        return np.vstack(found)


def _registered(
    pairs: PosePairs, log: CalibrationLog, settings: FitSettings
) -> tuple[PosePairs, Registration, tuple[PoseSignal, PoseSignal] | None]:
    """Return the samples as they are learned from, and their registration.

    And last registered observations and commands with orientations, where these are not learned from.
    """
    registration = pairs.register(log, settings)
    reference = registration.model.apply(pairs.observed)
    if not settings.rigid or not hardly_turns(reference, pairs.command):
        return pairs, registration, None
    rows = log.trajectory[pairs.rows]
    registration = register_held(registration, pairs.observed, pairs.command, rows, settings.marker)
    if JOINTS in settings.features:
        raise LogError(
            "the commanded orientations vary less than the robot misses them, and joints follow from whole poses.",
            hint="Leave joints out of --features, or record commands that turn the tool.",
            path=log.name,
        )
    return pairs.positions, registration, (registration.model.apply(pairs.observed), pairs.command)


@dataclass(frozen=True, eq=False)
class _Answers:
    """A way to answer a log: what it learns from, what it leaves at left-out trajectories, and its intervals."""

    samples: Samples
    left_out: LeftOut
    intervals: IntervalCalibration
    by: JointRoute | Memory | None = None


def _in_joints(
    kinematics: ArmKinematics | None,
    log: CalibrationLog,
    pair: tuple[PoseSignal, PoseSignal],
    cleaner: FittedCleaner,
    settings: FitSettings,
    learn_law: LearnLaw,
    left_out: LeftOut,
    *,
    asked: bool,
) -> _Answers | None:
    """Answer in the arm's joints; not at all where the log has none, nor unasked where they promise nothing."""
    if not asked and (log.static or log.setpoint_jp is None):
        return None
    alone = None if asked else left_out
    route, found = JointRoute.learn(kinematics or ArmKinematics.of(log), log, pair, cleaner, settings, learn_law, alone)
    return _Answers(found.samples, found.left_out, found.intervals, route)


def _recalling(
    pairs: PosePairs,
    log: CalibrationLog,
    rigid: RigidModel,
    features: FeatureMap,
    bounds: Bounds,
    learn_law: LearnLaw,
    alone: Samples,
    *,
    asked: bool,
) -> _Answers | None:
    """Answer with memory of the commands; unasked only where a linear law says that much is a matter of it."""
    if not asked and pairs.new.all():
        return None
    folds, labels = folds_of(log.trajectory[pairs.rows]), np.cumsum(pairs.new, dtype=np.int64)
    states, explained = choose_memory(pairs.command, rigid.apply(pairs.observed), labels, *alone.learnable(), folds)
    if not asked and explained < LIMITS.memory_explains:
        return None
    samples = _samples_of_poses(pairs, log, rigid, features, states)
    law, found = learn_law(samples, _pose_layout(features, states))
    return _Answers(samples, found, law.intervals, Memory(states, replace(law, bounds=bounds)))


def _not_corrected(features: FeatureMap, held: HeldOrientation | None) -> tuple[str, ...]:
    """Return why rotations are not corrected, where they are not."""
    if held is not None:
        return (held.sentence,)
    if features.has_orientation:
        return ()
    return ("the log holds positions only: orientations are turned into the base frame, not corrected",)


def _features_of(log: CalibrationLog, settings: FitSettings) -> tuple[tuple[str, ...], FeatureMap]:
    """Return the kinds of features, memory among them, and the map of the others; unknown ones are refused."""
    kinds = settings.features or (("pose",) if log.static else ("pose", "velocity"))
    if MEMORY in kinds and JOINTS in kinds:
        raise DataError("memory is of the pose, joints have a memory of their own: name one of the two.")
    return kinds, FeatureMap(tuple(kind for kind in kinds if kind not in (MEMORY, JOINTS)))


def _pose_layout(features: FeatureMap, states: MemoryMap | None) -> Layout:
    """Return how the regression's columns are grouped: pose, velocity, memory."""
    groups, width = features.groups, features.n_features
    if states is not None:
        groups = (*groups, tuple(range(width, width + states.radii.size)))
    return Layout(
        targets=(3, 3) if features.has_orientation else (3,),
        inputs=groups,
        smooth=np.arange(sum(map(len, groups))),
        penalties=None,
        slack=features.slack,
        inducing=INDUCING,
        fading=np.array(features.groups[-1] if features.uses_velocity else (), dtype=np.int64),
        place=np.array(features.groups[0]),
    )


def _samples_of_poses(
    pairs: PosePairs, log: CalibrationLog, rigid: RigidModel, features: FeatureMap, states: MemoryMap | None
) -> Samples:
    """Return the log as a law sees it: NaN where a sample is none of the pairs."""
    reference, rows, n = rigid.apply(pairs.observed), pairs.rows, len(log)
    moved = reference_twists(rigid, rotations_of(pairs.observed), pairs.twist)
    known = features.transform(reference.position, rotations_of(reference), moved)
    if states is not None:
        known = np.hstack([known, states.transform(pairs.command, reference, np.cumsum(pairs.new, dtype=np.int64))])
    size = 6 if features.has_orientation else 3
    X, target = np.full((n, known.shape[1]), np.nan), np.full((n, size), np.nan)
    begins, usable = np.zeros((2, n), dtype=bool)
    X[rows], begins[rows], usable[rows] = known, pairs.new, True
    target[rows] = pose_residual(reference, pairs.command)[:, :size]
    return Samples(log.time, log.trajectory, begins, X, target, np.zeros((n, size)), usable, session=log.session)
