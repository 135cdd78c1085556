"""Numerical inverse kinematics: bounded damped least squares from several starts.

The iteration is scipy's trust-region reflective method (a damped least-squares step inside the joint limits);
this file only states the pose error and its exact Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

LENGTH = 0.1  # m that weigh as much as one radian: the reach of a surgical tool beyond its pivot
REACHED = 1e-9  # error norm (rad, or m / LENGTH) below which the pose counts as reached
STARTS = 16  # measured on random poses of the known arms: they need one or two, seldom five
STEPS = 150  # measured on the same: a start that will arrive has by then
MARGIN = 1e-3  # rad or m by which the search may pass a limit: it converges slowly onto a bound
NOISE = np.finfo(np.float64).eps

JointMap = Callable[[FloatArray], FloatArray]


def solve_pose(
    forward: JointMap, jacobian: JointMap, limits: FloatArray, T: FloatArray, seed: ArrayLike | None
) -> FloatArray:
    """Joint values `(dof,)` within `limits` (dof, 2) whose `forward` pose is `T`; see ``Chain.inverse``.

    Parameters
    ----------
    forward, jacobian : callables
        Tip pose (4, 4) and its geometric Jacobian (6, dof) of joint values (dof,).
    limits : (dof, 2) array
        Of the joints, rad or m.
    T : (4, 4) array
        Pose to reach.
    seed : (dof,) or (k, dof) array or None
        Where to start first.

    Raises
    ------
    DataError
        `T` is not a pose, a seed has another shape, or no start reaches the pose.
    """
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise DataError(f"the pose to reach must be a finite (4, 4) array, got shape {T.shape}.")
    best, nearest = np.inf, np.full(6, np.nan)
    for start in _starts(limits, seed):
        q = _descend(forward, jacobian, limits, T, start)
        error = _pose_error(forward(q), T)
        if np.linalg.norm(error) < REACHED:
            return q
        if np.linalg.norm(error) < best:
            best, nearest = float(np.linalg.norm(error)), error
    raise DataError(
        f"no joint values within the limits reach the pose; the nearest misses it by "
        f"{np.linalg.norm(nearest[:3]) * LENGTH:.3g} m and {np.linalg.norm(nearest[3:]):.3g} rad.",
        hint="Check units and frame of the pose, or widen the joint limits.",
    )


def _starts(limits: FloatArray, seed: ArrayLike | None) -> Iterator[FloatArray]:
    """Yield the caller's seeds, then points that cover the limits evenly (a Halton sequence, not random)."""
    dof = len(limits)
    if seed is not None:
        seeds = np.atleast_2d(np.asarray(seed, dtype=np.float64))
        if seeds.shape[-1] != dof or seeds.ndim != 2:
            raise DataError(f"a seed must have shape ({dof},) or (k, {dof}), got {np.shape(seed)}.")
        yield from np.clip(seeds, limits[:, 0], limits[:, 1])
    from scipy.stats import qmc  # takes longer to import than a model to load, and few arms come here

    spread = qmc.Halton(dof, scramble=False).random(STARTS + 1)[1:]  # the first point is a corner
    yield from limits[:, 0] + (limits[:, 1] - limits[:, 0]) * spread


def _descend(forward: JointMap, jacobian: JointMap, limits: FloatArray, T: FloatArray, start: FloatArray) -> FloatArray:
    def residual(q: FloatArray) -> FloatArray:
        return _pose_error(forward(q), T)

    def slope(q: FloatArray) -> FloatArray:
        J = jacobian(q)
        to_rate = se3.left_jacobian_inverse(_pose_error(forward(q), T)[3:])
        return np.concatenate([J[:3] / LENGTH, to_rate @ J[3:]])

    bounds = (limits[:, 0] - MARGIN, limits[:, 1] + MARGIN)
    result = least_squares(
        residual, start, jac=slope, bounds=bounds, x_scale="jac", ftol=NOISE, xtol=NOISE, gtol=NOISE, max_nfev=STEPS
    )
    q: FloatArray = np.clip(result.x, limits[:, 0], limits[:, 1])
    return q


def _pose_error(reached: FloatArray, wanted: FloatArray) -> FloatArray:
    """Error `(6,)`: position over LENGTH, then the rotation vector of R_reached R_wanted^T."""
    position = (reached[:3, 3] - wanted[:3, 3]) / LENGTH
    rotation: FloatArray = se3.rotvec_from_matrix(reached[:3, :3] @ wanted[:3, :3].T)
    return np.concatenate([position, rotation])
