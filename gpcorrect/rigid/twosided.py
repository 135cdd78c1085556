"""Rotations on both sides: R_left R_i R_right = S_i, from all samples at once."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from gpcorrect import se3
from gpcorrect.types import FloatArray

__all__ = ["left_rotation", "two_sided_rotations"]

ITERATIONS = 30  # a start: the alternation creeps where rotations are small, and Gauss-Newton finishes it


def _cube_rotations() -> FloatArray:
    """Return the 24 rotations of a cube: no rotation is further than 63 degrees from one of them."""
    signed = [np.eye(3)[list(p)] * s for p in permutations(range(3)) for s in product((1.0, -1.0), repeat=3)]
    return np.array([m for m in signed if np.linalg.det(m) > 0.0])


CUBE = _cube_rotations()


def left_rotation(R_obs: FloatArray, R_cmd: FloatArray, R_right: FloatArray, w: FloatArray) -> FloatArray:
    """Rotation R_left of least `sum w ||R_left R_obs R_right - R_cmd||_F^2` over `(n, 3, 3)` stacks."""
    return se3.nearest_rotation(np.einsum("n,nab,ncb->ac", w, R_cmd, R_obs @ R_right))


def two_sided_rotations(R_obs: FloatArray, R_cmd: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (R_left, R_right) of least `sum w ||R_left R_obs R_right - R_cmd||_F^2`.

    For a given R_right the best R_left is one SVD, and the other way round; both need the data only as the
    sum of the products of their entries. The two alternate from the 24 rotations of a cube; the best end
    wins.

    Parameters
    ----------
    R_obs, R_cmd : (n, 3, 3) arrays
        Rotations that belong together.
    w : (n,) array
        Non-negative weights.
    """
    n = len(w)
    moments = ((R_cmd.reshape(n, 9) * w[:, None]).T @ R_obs.reshape(n, 9)).reshape(3, 3, 3, 3)
    R_right = CUBE
    for _ in range(ITERATIONS):
        R_left = se3.nearest_rotation(np.einsum("abcd,sdb->sac", moments, R_right))
        R_right = se3.nearest_rotation(np.einsum("abcd,sac->sdb", moments, R_left))
    agreement = np.einsum("abcd,sac,sdb->s", moments, R_left, R_right)
    best = int(np.argmax(agreement))
    return R_left[best], R_right[best]
