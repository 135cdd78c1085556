"""Position and orientation that belong to different points of the tool, each registered for itself."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.rigid.handeye import fit_two_sided
from gpcorrect.rigid.model import RigidModel
from gpcorrect.rigid.observability import rotation_observability
from gpcorrect.rigid.registration import check_pair, fit_position
from gpcorrect.rigid.robust import cauchy_weights, evenly_spaced, fit_robustly, robust_scale
from gpcorrect.rigid.twosided import left_rotation
from gpcorrect.types import FloatArray, PoseSignal

__all__ = ["fit_separate"]

MEAN_ROUNDS = 20


def fit_separate(observed: PoseSignal, command: PoseSignal) -> RigidModel:
    """Points registered by points, orientations by `R_left R_obs R_right = R_cmd`, both robustly.

    Trackers that solve wrist and tip from different fiducials report such poses: no one rigid body explains
    both. Rotation about two axes determines R_left and R_right; rotation about one leaves a turn about it
    open, and the smallest R_right is taken; without rotation only the product is known, and R_right is the
    identity.

    Parameters
    ----------
    observed, command : PoseSignal
        n samples each with orientations, all finite.

    Raises
    ------
    DataError
        Orientations missing, signals of unequal length, missing samples.
    DegenerateError
        Fewer than three samples, or points that coincide or lie on one line.
    """
    check_pair(observed, command)
    points = fit_robustly(fit_position, observed, command)
    R_left, R_right = _fit_orientations(observed, command)
    return RigidModel("separate", R_position=points.R_position, t=points.t, R_left=R_left, R_right=R_right)


def _fit_orientations(observed: PoseSignal, command: PoseSignal) -> tuple[FloatArray, FloatArray]:
    observability = rotation_observability(observed, command)
    if observability is None or observed.quaternion is None or command.quaternion is None:
        raise DataError("separate registration needs observed and commanded orientations, got positions only.")
    rows = evenly_spaced(len(observed))
    R_obs = se3.matrix_from_quaternion(observed.quaternion[rows])
    R_cmd = se3.matrix_from_quaternion(command.quaternion[rows])
    if observability.n_axes == 0:
        return _robust_left(R_obs, R_cmd, np.eye(3)), np.eye(3)
    R_left, R_right = fit_two_sided(R_obs, R_cmd)
    if observability.n_axes == 1:
        R_right = _smallest_turn(R_right, observability.axes[0])
        R_left = _robust_left(R_obs, R_cmd, R_right)
    return R_left, R_right


def _smallest_turn(R: FloatArray, axis: FloatArray) -> FloatArray:
    """Rotation of smallest angle among `exp(phi axis) R`: phi maximises its trace."""
    hat = np.cross(np.eye(3), axis)
    sine = np.trace(hat @ R)
    cosine = np.trace(R) - axis @ R @ axis
    return se3.matrix_from_rotvec(np.arctan2(sine, cosine) * axis) @ R


def _robust_left(R_obs: FloatArray, R_cmd: FloatArray, R_right: FloatArray) -> FloatArray:
    w = np.ones(len(R_obs))
    for _ in range(MEAN_ROUNDS):
        R_left = left_rotation(R_obs, R_cmd, R_right, w)
        away = se3.angle(R_left @ R_obs @ R_right @ np.swapaxes(R_cmd, -1, -2))
        w = cauchy_weights(away, robust_scale(away))
    return R_left
