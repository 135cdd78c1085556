"""Errors of tables that both truths draw alike: where the tracker stands, and the rows of the arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truth.hidden import Params

Array = NDArray[np.float64]

ROW_TERMS = ("alpha", "a", "d", "theta")  # the order of a row's columns
SIMILARITY = ("x", "y", "z", "rx", "ry", "rz", "scale")


def draw_similarity(rng: np.random.Generator) -> Params:
    """Return a registration that is off by parts of a millimetre, a milliradian and a thousandth."""
    sizes = np.r_[np.full(3, 2e-4), np.full(3, 1e-3), 1e-3]
    return dict(zip(SIMILARITY, (sizes * rng.standard_normal(7)).tolist(), strict=True))


def moved(params: Params, T: Array) -> Array:
    """Poses `(n, 4, 4)` as a registration that is off shows them."""
    seen = np.array(T)
    values = np.array([params[name] for name in SIMILARITY])
    R = Rotation.from_rotvec(values[3:6]).as_matrix()
    seen[:, :3, :3] = R @ T[:, :3, :3]
    seen[:, :3, 3] = (1.0 + values[6]) * T[:, :3, 3] @ R.T + values[:3]
    return seen


def draw_row(rng: np.random.Generator) -> Params:
    """Return an angle or a length between two moving joints, which neither a zero nor the registration can take up."""
    params: Params = dict.fromkeys(ROW_TERMS, 0.0)
    if rng.random() < 0.5:
        params["alpha"] = float(rng.choice([-1.0, 1.0])) * 2e-3
    else:
        params["a"] = float(rng.choice([-1.0, 1.0])) * 3e-4
    return params


def row_changed(rows: Array, j: int, params: Params) -> Array:
    """Copy of rows `(k, 4)` with one of them off."""
    changed = np.array(rows)
    changed[j] += [params[name] for name in ROW_TERMS]
    return changed
