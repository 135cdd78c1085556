"""Joint errors as people quote them: a row a joint, in degrees or millimetres."""

from __future__ import annotations

import numpy as np

from gpcorrect.metrics import spread
from gpcorrect.types import FloatArray

__all__ = ["JointErrors", "joint_errors", "joint_units"]

JointErrors = list[dict[str, object]]


def joint_units(types: str) -> tuple[list[str], FloatArray]:
    """Return each joint's unit for people, and what one rad or m is in it."""
    names = ["mm" if kind == "P" else "deg" for kind in types]
    return names, np.array([1e3 if kind == "P" else np.rad2deg(1.0) for kind in types])


def joint_errors(errors: FloatArray, types: str) -> JointErrors:
    """Return RMSE, and mean, SD, 95th percentile and maximum of the absolute errors `(n, d)`, of every joint."""
    names, scale = joint_units(types)
    return [{"joint": j + 1, "unit": names[j], **spread(errors[:, j] * scale[j])} for j in range(errors.shape[1])]
