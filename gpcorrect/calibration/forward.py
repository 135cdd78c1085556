"""Where a command takes the robot: the model asked the other way round, for simulators and planners.

A model says which command `c = F(x)` reaches a pose `x`. The pose that a command reaches solves this for `x`. What `F`
adds to the registration is small and smooth, so that taking it off the command again and again converges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.calibration import queries
from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.poses import inverse_reference_twists, rotations_of
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError
from gpcorrect.rigid import RigidModel, apply_residual, pose_residual
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect.velocity import segment_labels, twists

SOLVED = 1e-7  # m and rad between a command and that of the pose found: far below any tracker
STEPS = 30
"""An addition whose slope is below 0.6 is solved in them; where it is steeper, two poses may have one command: of a
model of four reaches the poses that took 32 to 47 steps lay 49 to 113 mm off those that the commands were made for."""
FOLLOW_STEPS, FOLLOW_SHRINKS, FOLLOW_SETTLED = 6, 0.8, 0.01
"""Half steps of velocities at most; those that go on shrink by a fifth, and are above a hundredth of the fastest
command. `bench/reached.py`: behind servos of 60 and 120 ms, and of a noisy debridement, none 3.6 15.2 2.96 mm, one 2.3
10.3 2.49, these 1.5 7.5 2.49. Five always lost a quarter of the debridement from the domain."""


def reached(corrector: CommandCorrector, commands: ArrayLike, twist: ArrayLike | None = None) -> Correction:
    """Return the poses that commands reach, and how sure that is, each for itself: memory and joints are not used.

    Velocities are those of the commands, which are known; a pose that follows through slack may stand still.

    Parameters
    ----------
    corrector : CommandCorrector, of the arm
    commands : (n, 7) or (n, 3) array, commanded positions (m) and unit quaternions wxyz, base frame
    twist : (n, 6) array, optional
        Velocities of the commands, m/s and rad/s, base frame. Without them the arm is taken as at rest, and answers are
        marked.

    Returns
    -------
    Correction
        n poses in the observer's frame, with standard deviations and intervals along its axes. Where no pose is found
        that has this command, or perhaps not the only one, the answer is marked as outside the training region.

    Raises
    ------
    DataError
        A command or twist is not finite or has the wrong shape, or is so far off the training that it cannot be in m.
    """
    rows = queries.checked_poses(commands, orientation=corrector.has_orientation)
    moving = np.zeros((len(rows), 6)) if twist is None else np.array(twist, dtype=np.float64)
    if moving.shape != (len(rows), 6) or not np.isfinite(moving).all():
        raise DataError(
            f"twists must be finite and of shape ({len(rows)}, 6), got shape {moving.shape}"
            f" and {np.count_nonzero(~np.isfinite(moving))} numbers that are not finite.",
            hint="vx vy vz in m/s and wx wy wz in rad/s of every command.",
        )
    target = PoseSignal.of(rows)
    rigid, poses = corrector.rigid, corrector.rigid.inverse(target)
    try:
        corrector.trained.refuse_far(poses.position)
    except DataError as error:
        cause = f"as the registration takes this command to the observer's frame, {error.message}"
        raise DataError(cause, hint="Give commands in metres, in the base frame.") from error
    for _ in range(STEPS):
        answer = corrector.correct_observed(poses, inverse_reference_twists(rigid, poses, moving))
        missed = pose_residual(answer.poses, target)
        left = np.nanmax(np.abs(missed), axis=1)
        if (left < SOLVED).all():
            break
        poses = rigid.inverse(apply_residual(rigid.apply(poses), missed))
    unsolved = left >= SOLVED
    std = corrector.law.domain.widen(answer.std[:, : len(corrector.law.zero)], answer.in_domain & ~unsolved)
    both = corrector.six(std, corrector.law.intervals.interval95(std), rotations_of(target))
    std, width = (_observed_std(rigid, poses, v) for v in both)
    found = Correction(poses.position, poses.quaternion, None, std, width, answer.reasons)
    found = found.because(Reason.OUTSIDE, unsolved)
    if corrector.memory is not None or corrector.route is not None:
        found = found.because(Reason.NO_HISTORY)
    return found.because(Reason.AT_REST) if twist is None and corrector.features.uses_velocity else found


def reached_path(corrector: CommandCorrector, commands: ArrayLike, times: ArrayLike) -> Correction:
    """Return the poses that a timed path of commands reaches, n rows.

    Velocities come from the five-point stencil on it. A model that looks at the arm's joints answers by these, with
    their memory along the path; others answer each pose for itself, as :func:`reached`, at the velocity that the poses
    found have themselves.

    Parameters
    ----------
    corrector : CommandCorrector, of the arm
    commands : (n, 7) or (n, 3) array, commanded positions (m) and unit quaternions wxyz, base frame
    times : (n,) array, seconds, strictly increasing

    Raises
    ------
    DataError
        As for :func:`reached`, or the times do not increase, or cannot be seconds.
    """
    rows = queries.checked_poses(commands, orientation=corrector.has_orientation)
    seconds, one = queries.checked_times(times, len(rows)), np.zeros(len(rows), dtype=np.int64)
    target = PoseSignal.of(rows)
    corrector.trained.refuse_slow(corrector.rigid.inverse(target).position, seconds)
    moving = np.nan_to_num(twists(seconds, target.position, rotations_of(target), one))
    alone = _followed(corrector, rows, seconds, moving)
    found = None if corrector.route is None else corrector.route.reached(target, seconds, one)
    if found is None:
        return alone
    rigid, known = corrector.rigid, np.asarray(np.isfinite(found.std).all(axis=1))
    poses = rigid.inverse(found.poses)
    std, width = (_observed_std(rigid, poses, values) for values in (found.std, found.interval95))
    answer = Correction(poses.position, poses.quaternion, None, std, width, found.reasons)
    return answer if known.all() else answer.at(known, alone.because(Reason.OUTSIDE))


def _followed(corrector: CommandCorrector, commands: FloatArray, seconds: FloatArray, moving: FloatArray) -> Correction:
    """Poses of commands `(n, 7)` at the velocities that these poses have themselves; at first those of the commands.

    A model knows the velocities of poses, and an arm that follows late has other ones than its commands. The fixed
    point is found by half steps (Krasnoselskii 1955): whole ones grow from frequencies of 1 / lag on, half ones from
    the square root of three times that. Where even these no longer shrink, it is the tracker's noise that is left.
    """
    answer, left = reached(corrector, commands, moving), np.inf
    for _ in range(FOLLOW_STEPS if corrector.features.uses_velocity else 0):
        known = np.flatnonzero(answer.in_domain)
        poses = corrector.rigid.apply(answer.poses)[known]
        runs = segment_labels(seconds, np.zeros(len(seconds), dtype=np.int64), answer.in_domain)[known]
        change = np.nan_to_num(twists(seconds[known], poses.position, rotations_of(poses), runs) - moving[known])
        size = float(np.sqrt(np.mean(change[:, :3] ** 2))) if known.size else 0.0
        if not FOLLOW_SETTLED * float(np.abs(moving[:, :3]).max()) < size < FOLLOW_SHRINKS * left:
            break
        left, moving = size, moving.copy()
        moving[known] += change / 2.0
        answer = reached(corrector, commands, moving)
    return answer


def _observed_std(rigid: RigidModel, poses: PoseSignal, std: FloatArray) -> FloatArray:
    """Return deviations of commands `(n, 6)`, base frame, as those of poses `(n, 6)`, observer's frame."""
    variance = std**2
    position = variance[:, :3] @ (rigid.R_position**2)
    if poses.quaternion is not None and rigid.needs_orientation:
        lever = se3.hat(se3.matrix_from_quaternion(poses.quaternion) @ rigid.offset) @ rigid.R_left.T
        position = position + np.einsum("nij,nj->ni", lever**2, variance[:, 3:])
    return np.asarray(np.sqrt(np.hstack([position, variance[:, 3:] @ (rigid.R_left**2)])))
