"""Catalogue effects of geometry: zeros, ratios, coupling, pulleys, registration, table errors."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from truth.arm import ROWS, forward
from truth.body import Body
from truth.history import History
from truth.kinds.kind import Array, Kind, Params, Scene, column, draw_sign
from truth.loop import Loop

__all__ = ["KINDS"]

ROW_TERMS = ("alpha", "a", "d", "theta")  # the order of a row's columns
SIMILARITY = ("x", "y", "z", "rx", "ry", "rz", "scale")


def _draw_homing(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    offsets = [float(draw_sign(rng) * rng.uniform(0.5, 1.5) * scene.noise[j]) for _ in range(scene.sessions)]
    return {"offset": offsets if scene.sessions > 1 else offsets[0]}


def _homing(params: Params, j: int, history: History, q: Array) -> Array:
    offsets = np.atleast_1d(params["offset"])
    session = history.reference.session if len(offsets) > 1 else np.zeros(len(q), dtype=np.int64)
    return column(len(q), j, offsets[session])


def _draw_ratio(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"error": draw_sign(rng) * scene.noise[j] / float(np.sqrt(np.mean(scene.path(j) ** 2)))}


def _ratio(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, q[:, j] - q[:, j] / (1.0 + params["error"]))


def _draw_coupling(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    source = int(rng.choice([k for k in range(3) if k != j]))
    rms = float(np.sqrt(np.mean(scene.path(source) ** 2)))
    return {"source": source + 1, "coefficient": draw_sign(rng) * float(scene.noise[j]) / rms}


def _coupling(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, params["coefficient"] * q[:, params["source"] - 1])


def _draw_eccentricity(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    number = float(rng.uniform(*(5.0, 18.0) if j < 2 else (80.0, 260.0)))
    return {"amplitude": float(1.4 * scene.noise[j]), "waves": number, "phase": float(rng.uniform(-np.pi, np.pi))}


def _eccentricity(params: Params, j: int, history: History, q: Array) -> Array:
    """Solve `m = q + a sin(N q + phi)` for q by Newton: the pulley turns with the true joint."""
    a, number, phase = params["amplitude"], params["waves"], params["phase"]
    true = np.array(q[:, j])
    for _ in range(4):
        turn = number * true + phase
        true -= (true + a * np.sin(turn) - q[:, j]) / (1.0 + a * number * np.cos(turn))
    return column(len(q), j, q[:, j] - true)


def _draw_registration(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    sizes = np.r_[np.full(3, 2e-4), np.full(3, 1e-3), 1e-3]
    return dict(zip(SIMILARITY, (sizes * rng.standard_normal(7)).tolist(), strict=True))


def _registration(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    moved = np.array(T)
    values = np.array([params[name] for name in SIMILARITY])
    R = Rotation.from_rotvec(values[3:6]).as_matrix()
    moved[:, :3, :3] = R @ T[:, :3, :3]
    moved[:, :3, 3] = (1.0 + values[6]) * T[:, :3, 3] @ R.T + values[:3]
    return moved


def _draw_table(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Return an angle or a length of one row, never one that a zero or the registration can take up."""
    params: Params = dict.fromkeys(ROW_TERMS, 0.0)
    if rng.random() < 0.5:
        params["alpha"] = draw_sign(rng) * 2e-3
    else:
        params["a"] = draw_sign(rng) * 3e-4
    return params


def _table_rows(params: Params, j: int) -> Array:
    rows = np.array(ROWS)
    rows[j] += [params[name] for name in ROW_TERMS]
    return rows


def _table_loop(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    rows = np.array(body.rows)
    rows[j] += [params[name] for name in ROW_TERMS]
    return loop, body._replace(rows=rows)


def _table_tip(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    """Carry the tool by what the changed row does to it."""
    before, after = forward(q), forward(q, _table_rows(params, j))
    return after @ np.linalg.inv(before) @ T


KINDS = {
    "homing_offset": Kind(_draw_homing, grow=("offset",), path=_homing, bare=True),
    "transmission_ratio": Kind(_draw_ratio, grow=("error",), path=_ratio, bare=True),
    "cable_coupling": Kind(_draw_coupling, grow=("coefficient",), path=_coupling, bare=True),
    "pulley_eccentricity": Kind(_draw_eccentricity, grow=("amplitude",), path=_eccentricity, bare=True),
    "registration_error": Kind(
        _draw_registration,
        where="base",
        grow=SIMILARITY,
        tip=_registration,
        tracker_only=True,
    ),
    "dh_error": Kind(_draw_table, grow=ROW_TERMS, loop=_table_loop, tip=_table_tip, tracker_only=True),
}
