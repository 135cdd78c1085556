"""Registration of whole poses by one SVD, and of bare positions (Mahler et al., CASE 2014, Sec. IV-B).

Each also comes with robust weights: registration must stand before cleaning is finished, so gross errors may not steer
it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid.model import RigidModel
from gpcorrect.robust import robust_scale
from gpcorrect.types import FloatArray, IntArray, PoseSignal

WIDTH = 3.0  # standard deviations at which a sample counts half
MAX_SAMPLES = 2000  # a dozen unknowns are no better known from more: neighbours in time repeat each other
MAX_ROUNDS = 40  # of weights, which end by their tolerance before
TOLERANCE = 1e-7  # of a weight: less moves nothing
KNOWN_TOLERANCE = 1e-4  # the same where weights are nearly known, and a model is only compared or weighed anew
WEIGHT_ROUNDS = 12  # of weighing positions and rotations by their scales
WEIGHT_TOLERANCE = 0.02  # of the weight: less turns nothing
FLOOR = 1e-12  # m or rad: exact data leave no scale to divide by
MIN_SAMPLES = 3  # points that determine a rotation
COLLINEAR_RATIO = 1e-3  # spread across the best line over the spread along it
AMBIGUOUS_RATIO = 1e-6  # the same for a cross-covariance, which is a square


def fit_pose(observed: PoseSignal, command: PoseSignal, *, rotation_weight: float = 1.0) -> RigidModel:
    """Rigid motion T of the observed poses X_i with the least sum of `||T X_i - U_i||_F^2` to commands U_i.

    The squared Frobenius norm of a difference of poses is `||R R_i - S_i||^2 + |R p_i + t - u_i|^2`. So the
    best t maps the mean of p onto that of u, and the best R is the rotation nearest to
    `sum (u_i - mean u)(p_i - mean p)^T + rotation_weight sum S_i R_i^T`: one SVD. Where either signal has no
    orientations the points alone are registered and the model's kind is "position".

    Parameters
    ----------
    observed, command : PoseSignal, n samples each, all finite, at least three
    rotation_weight : float
        Square metres that a squared Frobenius distance of one between rotations counts as. The paper's plain
        norm over metres is 1, in which orientations far outweigh positions in a workspace of centimetres.

    Raises
    ------
    DataError
        Signals of unequal length, missing samples.
    DegenerateError
        Fewer than three samples, or points or orientations that do not determine the rotation.
    """
    if observed.quaternion is None or command.quaternion is None:
        return fit_position(observed, command)
    check_pair(observed, command)
    return _pose(_Pairs.of(observed, command), np.full(len(observed), 1.0 / len(observed)), rotation_weight)


def fit_position(observed: PoseSignal, command: PoseSignal) -> RigidModel:
    """Rigid motion of the observed points with the least squared distances to the commands (Kabsch 1976).

    Orientations, where there are any, take no part.

    Parameters
    ----------
    observed : PoseSignal, poses of the marker in the tracker frame
    command : PoseSignal, poses of the tip in the base frame

    Raises
    ------
    DegenerateError
        Fewer than three samples, or points that coincide or lie on one line.
    """
    check_pair(observed, command)
    return _position(_Pairs.of(observed, command), np.full(len(observed), 1.0 / len(observed)))


def check_pair(observed: PoseSignal, command: PoseSignal) -> None:
    """Refuse signals that cannot be registered with each other.

    Parameters
    ----------
    observed : PoseSignal, poses of the marker in the tracker frame
    command : PoseSignal, poses of the tip in the base frame
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
        hint = "Record more of the workspace, or reject less."
        raise DegenerateError(f"registration needs at least {MIN_SAMPLES} samples, got {len(observed)}.", hint=hint)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Points `(n, 3)` and rotations `(n, 3, 3)` observed and commanded; rotations only where both have them."""

    p: FloatArray
    u: FloatArray
    R_obs: FloatArray | None
    R_cmd: FloatArray | None

    @classmethod
    def of(cls, observed: PoseSignal, command: PoseSignal) -> Self:
        if observed.quaternion is None or command.quaternion is None:
            return cls(observed.position, command.position, None, None)
        R_obs, R_cmd = map(se3.matrix_from_quaternion, (observed.quaternion, command.quaternion))
        return cls(observed.position, command.position, R_obs, R_cmd)

    def norms(self, model: RigidModel) -> list[FloatArray]:
        """Lengths `(n,)` of what a model leaves: positions (m), and rotations (rad) where they took part."""
        norms = [np.linalg.norm(self.p @ model.R_position.T + model.t - self.u, axis=1)]
        if model.kind == "pose" and self.R_obs is not None and self.R_cmd is not None:
            norms.append(se3.angle(np.swapaxes(model.R_left @ self.R_obs, -1, -2) @ self.R_cmd))
        return norms


def _pose(pairs: _Pairs, w: FloatArray, rotation_weight: float) -> RigidModel:
    """Rigid motion by points and rotations, under weights `(n,)` that sum to one."""
    if not rotation_weight >= 0.0:
        raise DataError(f"rotation_weight must be at least 0 square metres, got {rotation_weight}.")
    assert pairs.R_obs is not None
    assert pairs.R_cmd is not None
    commanded, observed = (w[:, None, None] * pairs.R_cmd).transpose(1, 0, 2), pairs.R_obs.transpose(1, 0, 2)
    attitude = commanded.reshape(3, -1) @ observed.reshape(3, -1).T
    R = _rotation(_cross_covariance(pairs, w) + rotation_weight * attitude)
    return RigidModel("pose", R_position=R, t=w @ pairs.u - R @ (w @ pairs.p), R_left=R)


def _position(pairs: _Pairs, w: FloatArray) -> RigidModel:
    """Rigid motion by points, under weights `(n,)` that sum to one."""
    _check_spread(pairs.p, w, "observed")
    _check_spread(pairs.u, w, "commanded")
    R = _rotation(_cross_covariance(pairs, w))
    return RigidModel("position", R_position=R, t=w @ pairs.u - R @ (w @ pairs.p), R_left=R)


def component_scale(norms: FloatArray) -> float:
    """Return the standard deviation of a component, from the lengths `(n,)` of 3-vectors (median).

    Parameters
    ----------
    norms : (n,) array, lengths of 3-vectors, m or rad
    """
    return max(float(robust_scale(norms, 3)), FLOOR)


def cauchy_weights(norms: FloatArray, scale: float) -> FloatArray:
    """Weights `(n,)` in (0, 1] of residual lengths: those of the Cauchy loss, a half at WIDTH scales.

    Parameters
    ----------
    norms : (n,) array, residual lengths
    scale : float, standard deviation of a component, same unit
    """
    return 1.0 / (1.0 + (norms / (WIDTH * scale)) ** 2)


def evenly_spaced(n: int, most: int = MAX_SAMPLES) -> IntArray:
    """Rows of at most `most` of n samples, spread evenly over the recording.

    Parameters
    ----------
    n : int
    most : int
    """
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def fit_robustly(observed: PoseSignal, command: PoseSignal, near: RigidModel | None = None) -> RigidModel:
    """Registration of the points of least Cauchy loss, by reweighting :func:`fit_position` from equal weights on.

    Parameters
    ----------
    observed : PoseSignal, poses of the marker in the tracker frame
    command : PoseSignal, poses of the tip in the base frame
    near : RigidModel, optional, solution of nearly the same samples, whose weights come first
    """
    return _reweighted(_robust_pairs(observed, command), None, near)


def fit_balanced(observed: PoseSignal, command: PoseSignal, near: RigidModel | None = None) -> RigidModel:
    """Robust pose in which positions and orientations decide by how well each is known, not by square metres.

    Of two kinds of errors with standard deviations s_p and s_r, maximum likelihood weighs squared chords of rotations,
    which are twice squared angles, by `s_p^2 / (2 s_r^2)` beside squared distances. A sample's Cauchy weight is the
    smaller of those of its position and its rotation, each on its own robust scale.

    Parameters
    ----------
    observed, command : PoseSignal, n samples each with orientations, all finite
    near : RigidModel, optional, solution of nearly the same samples, whose weights come first
    """
    pairs = _robust_pairs(observed, command)
    weight, model = 1.0, _reweighted(pairs, 1.0) if near is None else near
    for _ in range(WEIGHT_ROUNDS):
        s_p, s_r = map(component_scale, pairs.norms(model))
        before, weight = weight, s_p**2 / (2 * s_r**2)
        model = _reweighted(pairs, weight, model)
        if abs(weight - before) < WEIGHT_TOLERANCE * before:
            break
    return model


def _robust_pairs(observed: PoseSignal, command: PoseSignal) -> _Pairs:
    check_pair(observed, command)
    rows = evenly_spaced(len(observed))
    return _Pairs.of(observed[rows], command[rows])


def _reweighted(pairs: _Pairs, rotation_weight: float | None, near: RigidModel | None = None) -> RigidModel:
    weights = np.ones(len(pairs.p)) if near is None else _weights(pairs, near)
    tolerance = TOLERANCE if near is None else KNOWN_TOLERANCE
    for _ in range(1 + MAX_ROUNDS):
        w = weights / weights.sum()
        model = _position(pairs, w) if rotation_weight is None else _pose(pairs, w, rotation_weight)
        previous = weights
        weights = _weights(pairs, model)
        if np.abs(weights - previous).max() < tolerance:
            break
    return model


def _weights(pairs: _Pairs, model: RigidModel) -> FloatArray:
    return np.asarray(np.min([cauchy_weights(r, component_scale(r)) for r in pairs.norms(model)], axis=0))


def _cross_covariance(pairs: _Pairs, w: FloatArray) -> FloatArray:
    return (pairs.u - w @ pairs.u).T @ ((pairs.p - w @ pairs.p) * w[:, None])


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
