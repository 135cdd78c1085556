"""How soft the friction of a robot file is, by MuJoCo's own numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpcorrect.types import FloatArray


def friction_onsets(model: Any) -> FloatArray:
    """Return `onset` and `onset_time` `(2, nv)` of each degree of freedom's friction: 0 where there is none.

    MuJoCo's friction f leaves an acceleration v' by which `v' + R f = -b v`, as long as f is below the friction loss
    (its documentation, Computation, constraint model). R and b are taken where the arm is at its zero.

    Parameters
    ----------
    model : mujoco.MjModel
    """
    import mujoco

    onsets, data = np.zeros((2, model.nv)), mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    b = np.maximum(data.efc_KBIP.reshape(-1, 4)[rows, 1], mujoco.mjMINVAL)
    onsets[:, data.efc_id[rows]] = data.efc_frictionloss[rows] * data.efc_R[rows] / b, 1.0 / b
    return onsets
