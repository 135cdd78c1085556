"""Registration of whole poses by one SVD, and of bare positions (Mahler et al. 2014, Sec. IV-B).

Each also comes with robust weights: registration must stand before cleaning is finished, so gross errors may not steer
it.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid.model import RigidModel, pose_residual
from gpcorrect.robust import robust_scale
from gpcorrect.types import FloatArray, IntArray, PoseSignal

__all__ = [
    "cauchy_loss",
    "cauchy_weights",
    "check_pair",
    "component_scale",
    "evenly_spaced",
    "fit_pose",
    "fit_position",
    "fit_robustly",
]

WIDTH = 3.0  # standard deviations at which a sample counts half
MAX_SAMPLES = 2000  # a dozen unknowns are no better known from more: neighbours in time repeat each other
MAX_ROUNDS = 40  # of weights, which end by their tolerance before
TOLERANCE = 1e-7  # of a weight: less moves nothing
FLOOR = 1e-12  # m or rad: exact data leave no scale to divide by
MIN_SAMPLES = 3  # points that determine a rotation
COLLINEAR_RATIO = 1e-3  # spread across the best line over the spread along it
AMBIGUOUS_RATIO = 1e-6  # the same for a cross-covariance, which is a square


def fit_pose(
    observed: PoseSignal,
    command: PoseSignal,
    *,
    weights: FloatArray | None = None,
    rotation_weight: float = 1.0,
) -> RigidModel:
    """Rigid motion T of the observed poses X_i with the least sum of `||T X_i - U_i||_F^2` to commands U_i.

    The squared Frobenius norm of a difference of poses is `||R R_i - S_i||^2 + |R p_i + t - u_i|^2`. So the
    best t maps the mean of p onto that of u, and the best R is the rotation nearest to
    `sum (u_i - mean u)(p_i - mean p)^T + rotation_weight sum S_i R_i^T`: one SVD. Where either signal has no
    orientations the points alone are registered and the model's kind is "position".

    Parameters
    ----------
    observed, command : PoseSignal
        n samples each, all finite, at least three.
    weights : (n,) array, optional
        Non-negative weight of each sample; equal when not given.
    rotation_weight : float
        Square metres that a squared Frobenius distance of one between rotations counts as. The paper's plain
        norm over metres is 1, in which orientations far outweigh positions in a workspace of centimetres.

    Raises
    ------
    DataError
        Signals of unequal length, missing samples, bad weights.
    DegenerateError
        Fewer than three samples, or points or orientations that do not determine the rotation.

    References
    ----------
    Mahler et al., "Learning accurate kinematic control of cable-driven surgical robots using data cleaning
    and Gaussian process regression", CASE 2014, Sec. IV-B.
    """
    if observed.quaternion is None or command.quaternion is None:
        return fit_position(observed, command, weights=weights)
    if not rotation_weight >= 0.0:
        raise DataError(f"rotation_weight must be at least 0 square metres, got {rotation_weight}.")
    check_pair(observed, command)
    w = _normalised(weights, len(observed))
    R_obs, R_cmd = (
        se3.matrix_from_quaternion(observed.quaternion),
        se3.matrix_from_quaternion(command.quaternion),
    )
    attitude = np.einsum("n,nab,ncb->ac", w, R_cmd, R_obs)
    R = _rotation(_cross_covariance(observed, command, w) + rotation_weight * attitude)
    return RigidModel("pose", R_position=R, t=_translation(R, observed, command, w), R_left=R)


def fit_position(observed: PoseSignal, command: PoseSignal, *, weights: FloatArray | None = None) -> RigidModel:
    """Rigid motion of the observed points with the least squared distances to the commands (Kabsch 1976).

    Parameters and errors are those of :func:`fit_pose`; orientations, where there are any, take no part.

    Parameters
    ----------
    observed : PoseSignal
        Poses of the marker in the tracker frame.
    command : PoseSignal
        Poses of the tip in the base frame.
    weights : (n,) array, optional
        Non-negative weight of each sample; equal when not given.

    Raises
    ------
    DegenerateError
        Fewer than three samples, or points that coincide or lie on one line.
    """
    check_pair(observed, command)
    w = _normalised(weights, len(observed))
    _check_spread(observed.position, w, "observed")
    _check_spread(command.position, w, "commanded")
    R = _rotation(_cross_covariance(observed, command, w))
    return RigidModel("position", R_position=R, t=_translation(R, observed, command, w), R_left=R)


def check_pair(observed: PoseSignal, command: PoseSignal) -> None:
    """Refuse signals that cannot be registered with each other.

    Parameters
    ----------
    observed : PoseSignal
        Poses of the marker in the tracker frame.
    command : PoseSignal
        Poses of the tip in the base frame.

    Raises
    ------
    DataError
        Signals of unequal length or with missing samples.
    DegenerateError
        Fewer than three samples.
    """
    if len(observed) != len(command):
        raise DataError(
            f"each observation needs its command, got {len(observed)} observed and {len(command)} commanded."
        )
    missing = int(np.count_nonzero(~(observed.finite & command.finite)))
    if missing:
        raise DataError(
            f"registration needs complete samples, {missing} of {len(observed)} have missing numbers.",
            hint="Drop them first: signal[observed.finite & command.finite].",
        )
    if len(observed) < MIN_SAMPLES:
        raise DegenerateError(
            f"registration needs at least {MIN_SAMPLES} samples, got {len(observed)}.",
            hint="Record more of the workspace, or reject less.",
        )


def _normalised(weights: FloatArray | None, n: int) -> FloatArray:
    """Return weights `(n,)` that sum to one.

    Raises
    ------
    DataError
        A wrong shape, a negative or infinite weight, or nothing but zeros.
    """
    w: FloatArray = np.ones(n) if weights is None else np.asarray(weights, dtype=np.float64)
    if w.shape != (n,) or not np.isfinite(w).all() or (w < 0.0).any() or not w.any():
        raise DataError(f"weights must be {n} finite numbers, none negative and not all zero, got shape {w.shape}.")
    normalised: FloatArray = w / w.sum()
    return normalised


class RigidFit(Protocol):
    """A least-squares registration that takes weights, such as :func:`~gpcorrect.rigid.fit_pose`."""

    def __call__(self, observed: PoseSignal, command: PoseSignal, *, weights: FloatArray | None = None) -> RigidModel:
        """Return the model of least weighted squared error."""
        ...


def component_scale(norms: FloatArray) -> float:
    """Return the standard deviation of a component, from the lengths `(n,)` of 3-vectors (median).

    Parameters
    ----------
    norms : (n,) array
        Lengths of 3-vectors, m or rad.
    """
    return max(float(robust_scale(norms, 3)), FLOOR)


def cauchy_weights(norms: FloatArray, scale: float) -> FloatArray:
    """Weights `(n,)` in (0, 1] of residual lengths: those of the Cauchy loss, a half at WIDTH scales.

    Parameters
    ----------
    norms : (n,) array
        Residual lengths.
    scale : float
        Standard deviation of a component, same unit.
    """
    weights: FloatArray = 1.0 / (1.0 + (norms / (WIDTH * scale)) ** 2)
    return weights


def cauchy_loss(norms: FloatArray, scale: float) -> float:
    """Sum of the loss whose weights :func:`cauchy_weights` are: `WIDTH^2 log(1 + (r / (WIDTH scale))^2)`.

    Parameters
    ----------
    norms : (n,) array
        Residual lengths.
    scale : float
        Standard deviation of a component, same unit.
    """
    return float(WIDTH**2 * np.log1p((norms / (WIDTH * scale)) ** 2).sum())


def evenly_spaced(n: int, most: int = MAX_SAMPLES) -> IntArray:
    """Rows of at most `most` of n samples, spread evenly over the recording.

    Parameters
    ----------
    n : int
        Samples there are.
    most : int
        Rows wanted.
    """
    rows: IntArray = np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))
    return rows


def fit_robustly(fit: RigidFit, observed: PoseSignal, command: PoseSignal) -> RigidModel:
    """Registration of least Cauchy loss by reweighting `fit`, started from equal weights.

    A sample's weight is the smaller of those of its position and its rotation, each on its own robust scale.

    Parameters
    ----------
    fit : callable
        Weighted least squares, such as :func:`fit_pose`.
    observed : PoseSignal
        Poses of the marker in the tracker frame.
    command : PoseSignal
        Poses of the tip in the base frame.
    """
    rows = evenly_spaced(len(observed))
    observed, command = observed[rows], command[rows]
    model = fit(observed, command)
    weights = np.ones(len(observed))
    for _ in range(MAX_ROUNDS):
        previous, weights = weights, _sample_weights(model, observed, command)
        model = fit(observed, command, weights=weights)
        if np.abs(weights - previous).max() < TOLERANCE:
            break
    return model


def _sample_weights(model: RigidModel, observed: PoseSignal, command: PoseSignal) -> FloatArray:
    residual = pose_residual(model.apply(observed), command)
    parts = (residual[:, :3],) if model.kind == "position" else (residual[:, :3], residual[:, 3:])
    norms = [np.linalg.norm(part, axis=1) for part in parts]
    weights: FloatArray = np.min([cauchy_weights(r, component_scale(r)) for r in norms], axis=0)
    return weights


def _cross_covariance(observed: PoseSignal, command: PoseSignal, w: FloatArray) -> FloatArray:
    p, u = observed.position, command.position
    covariance: FloatArray = (u - w @ u).T @ ((p - w @ p) * w[:, None])
    return covariance


def _translation(R: FloatArray, observed: PoseSignal, command: PoseSignal, w: FloatArray) -> FloatArray:
    t: FloatArray = w @ command.position - R @ (w @ observed.position)
    return t


def _rotation(cross: FloatArray) -> FloatArray:
    """Rotation nearest to `cross`; refused when another rotation is as near."""
    s = np.linalg.svd(cross, compute_uv=False)
    gap = s[1] + np.copysign(s[2], np.linalg.det(cross))
    if not gap > AMBIGUOUS_RATIO * s[0]:
        raise DegenerateError(
            f"the samples do not determine a rotation: singular values {s[0]:.3g}, {s[1]:.3g}, {s[2]:.3g}.",
            hint="Check that observations and commands belong to each other and fill more than a line.",
        )
    return se3.nearest_rotation(cross)


def _check_spread(position: FloatArray, w: FloatArray, whose: str) -> None:
    centred = (position - w @ position) * np.sqrt(w)[:, None]
    along, across = np.linalg.svd(centred, compute_uv=False)[:2]
    resolution = np.finfo(np.float64).eps * np.abs(position).max() * len(position)
    if along <= resolution:
        raise DegenerateError(
            f"all {len(position)} {whose} points coincide, so no rotation can be registered.",
            hint="Record motion in at least two directions, or give orientations.",
        )
    if across <= COLLINEAR_RATIO * along:
        raise DegenerateError(
            f"the {whose} points lie on one line (spread {1e3 * along:.3g} mm along it, "
            f"{1e3 * across:.3g} mm across), so the rotation about that line cannot be registered.",
            hint="Record motion in at least two directions, or give orientations.",
        )
