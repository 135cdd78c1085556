"""Rotations as numbers for a regression: what is near must have near numbers, also across +-180 degrees.

No three numbers do that for all rotations. Three do (a rotation vector measured from the mean) while the data stay
well within half a turn of their mean; else six are used: two columns of the matrix, smooth everywhere. Euler angles
are kept for comparison with the paper.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from gpcorrect import se3
from gpcorrect.types import FloatArray

__all__ = ["RotationKind", "choose_rotation_kind", "fixed_axes_angles", "rotation_features"]

RotationKind = Literal["none", "rotvec", "columns", "euler"]

WIDEST_ROTVEC = float(np.deg2rad(120.0))  # leaves 60 degrees between the training and the jump at 180


def choose_rotation_kind(rotations: FloatArray, R_mean: FloatArray) -> RotationKind:
    """Return "rotvec" when all rotations `(n, 3, 3)` lie within 120 degrees of `R_mean`, else "columns"."""
    return "rotvec" if se3.angle(rotations @ R_mean.T).max() <= WIDEST_ROTVEC else "columns"


def rotation_features(rotations: FloatArray, kind: RotationKind, R_mean: FloatArray) -> FloatArray:
    """Features `(n, 3)` or `(n, 6)` of rotations `(n, 3, 3)`; NaN for a rotation that is not finite."""
    if kind == "columns":
        return np.concatenate([rotations[:, :, 0], rotations[:, :, 1]], axis=1)
    if kind == "euler":
        return fixed_axes_angles(rotations)
    features = np.full((len(rotations), 3), np.nan)
    finite = np.isfinite(rotations).all(axis=(1, 2))
    features[finite] = se3.rotvec_from_matrix(rotations[finite] @ R_mean.T)
    return features


def fixed_axes_angles(rotations: FloatArray) -> FloatArray:
    """Angles `(..., 3)` about the fixed axes x, y and z in this order, rad: `R = Rz Ry Rx` (the paper's Euler angles).

    They jump by a full turn at +-180 degrees, and x and z are not defined apart where y reaches +-90 degrees.
    """
    x = np.arctan2(rotations[..., 2, 1], rotations[..., 2, 2])
    y = np.arctan2(-rotations[..., 2, 0], np.hypot(rotations[..., 0, 0], rotations[..., 1, 0]))
    z = np.arctan2(rotations[..., 1, 0], rotations[..., 0, 0])
    return np.stack([x, y, z], axis=-1)
