"""How a corrector of poses is learned: register, learn pose and velocity, then what memory or the arm's joints add."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from gpcorrect.calibration.arm_kinematics import ArmKinematics
from gpcorrect.calibration.bridging import MotionLimits
from gpcorrect.calibration.joint_route import JointRoute
from gpcorrect.calibration.pose_samples import (
    WORTH_IT,
    Memory,
    PosePairs,
    best_memory,
    changes,
    changes_text,
    features_of,
    memory_remark,
    pose_layout,
    samples_of_poses,
)
from gpcorrect.calibration.poses import pose_pair, reference_twists, rotations_of, stencil_step
from gpcorrect.calibration.settings import JOINTS, MEMORY, FitSettings
from gpcorrect.calibration.task import LearnLaw, Outcome
from gpcorrect.calibration.training_motion import TrainingMotion
from gpcorrect.cleaning import FittedCleaner
from gpcorrect.errors import GpCorrectError
from gpcorrect.types import BoolArray, CalibrationLog

if TYPE_CHECKING:
    from gpcorrect.calibration.cartesian import CommandCorrector


def learn_poses(
    task: type[CommandCorrector],
    log: CalibrationLog,
    keep: BoolArray,
    cleaner: FittedCleaner,
    settings: FitSettings,
    learn_law: LearnLaw,
) -> Outcome:
    """Return what a log teaches a corrector of poses; see :meth:`Corrector.learn`.

    Single poses are always answered from pose and velocity. Paths and streams are answered with memory where the
    settings ask for it, and through the arm's joints where the log shows them and left-out trajectories are the better
    for it.

    Parameters
    ----------
    task : type
        Which is built.
    log, keep, cleaner, settings, learn_law
        As for :meth:`Corrector.learn`.

    Raises
    ------
    LogError, DataError, DegenerateError
        The log does not determine a model.
    """
    kinds, features = features_of(log, settings)
    step = stencil_step(log) if settings.velocity_step == "auto" else settings.velocity_step
    pairs = PosePairs.of(log, keep, step)
    shown = log.select(pairs.rows)
    kinematics = ArmKinematics.of(shown) if JOINTS in kinds else None  # what is asked for is refused before the work
    registration = pairs.register(log, settings)
    reference = registration.model.apply(pairs.observed)
    moved = reference_twists(registration.model, rotations_of(pairs.observed), pairs.twist)
    features = features.fit(reference.position, rotations_of(reference), moved)
    samples = samples_of_poses(pairs, log, registration.model, features, None)
    law, left_out = learn_law(samples, pose_layout(features, None))
    interval95, used = law.intervals.interval95(left_out.std), [kind for kind in kinds if kind not in (MEMORY, JOINTS)]
    corrector = task(
        law=law,
        cleaner=cleaner,
        trained=TrainingMotion.of(
            pose_pair(log)[0].position, log.time, log.trajectory, keep, joints=False, static=log.static
        ),
        rigid=registration.model,
        features=features,
        motion=MotionLimits.of(cleaner) if settings.clean else None,
        velocity_step=step,
        check_queries=pairs.check_queries,
    )
    remarks = [f"registration: {registration.reason}"]
    if not features.has_orientation:
        remarks.append("the log holds positions only: orientations are turned into the base frame, not corrected")
    if MEMORY in kinds:
        states = best_memory(pairs, log, registration.model, features, left_out)
        samples = samples_of_poses(pairs, log, registration.model, features, states)
        recalling, recalled = learn_law(samples, pose_layout(features, states))
        corrector = replace(corrector, memory=Memory(states, replace(recalling, bounds=law.bounds)))
        remarks.append(memory_remark(left_out, recalled))
        left_out, interval95 = recalled, recalling.intervals.interval95(recalled.std)
        used.append(MEMORY)
    if JOINTS in kinds or (not settings.features and not log.static and log.setpoint_jp is not None):
        try:
            kinematics = kinematics or ArmKinematics.of(shown)
            alone = None if JOINTS in kinds else left_out
            pair = (reference, pairs.command)
            route, found = JointRoute.learn(kinematics, shown, pair, cleaner, settings, learn_law, alone)
        except GpCorrectError as error:
            if JOINTS in kinds:
                raise
            remarks.append(f"the log's joints are not used: {error}")
        else:
            change = changes(found.left_out, left_out)
            helps = JOINTS in kinds or change.mean() <= -WORTH_IT
            remarks.append(f"corrected in the arm's joints: {changes_text(change)}{'' if helps else '; not used'}")
            if helps:
                corrector, samples = replace(corrector, route=route), found.samples
                left_out, interval95 = found.left_out, found.interval95
                used.append(JOINTS)
    low, high = pairs.observed.position.min(axis=0), pairs.observed.position.max(axis=0)
    report = {
        "frames": {"input": "tracker", "output": "base"},
        "units": {"position": "m", "rotation": "rad", "quaternion": "wxyz"},
        "features": used,
        "orientation": features.has_orientation,
        "training_region": {"position_min": low.tolist(), "position_max": high.tolist()},
    }
    return Outcome(corrector, samples, left_out, interval95, report, tuple(remarks), registration)
