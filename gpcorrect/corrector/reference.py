"""From an observed pose to the reference G(x) that the learned residual is added to, with its velocity."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.rigid import RigidModel
from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal
from gpcorrect.velocity import segment_labels, twists

__all__ = ["observed_twists", "reference_twists", "rotations_of"]


def rotations_of(signal: PoseSignal) -> FloatArray | None:
    """Rotation matrices `(n, 3, 3)` of a signal, NaN where a sample is missing; None when it holds positions only."""
    if signal.quaternion is None:
        return None
    rotations = np.full((len(signal), 3, 3), np.nan)
    finite = np.isfinite(signal.quaternion).all(axis=1)
    rotations[finite] = se3.matrix_from_quaternion(signal.quaternion[finite])
    return rotations


def observed_twists(
    time: FloatArray, trajectory: IntArray, signal: PoseSignal, keep: BoolArray, step: float | None
) -> FloatArray:
    """Twists `(n, 6)` of an observed path, never across a rejected sample or a gap; NaN where there is none."""
    labels = segment_labels(time, trajectory, keep & signal.finite)
    return twists(time, signal.position, rotations_of(signal), labels, step)


def reference_twists(rigid: RigidModel, rotations: FloatArray | None, twist: FloatArray) -> FloatArray:
    """Twists `(n, 6)` of the references, from those of the observed poses with rotations `(n, 3, 3)`.

    The lever arm turns with the body: `v = R_position (v_obs + w_obs x R_obs offset)`, `w = R_left w_obs`.
    """
    linear, angular = twist[..., :3], twist[..., 3:]
    if rotations is not None and rigid.needs_orientation:
        linear = linear + _cross(angular, rotations @ rigid.offset)
    return np.concatenate([linear @ rigid.R_position.T, angular @ rigid.R_left.T], axis=-1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows: np.cross without its checks, which take a quarter of a query."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
