"""Catalogue effects of geometry: zeros, ratios, coupling, pulleys, registration, table errors."""

from __future__ import annotations

import numpy as np

from truth import alike
from truth.alike import ROW_TERMS, SIMILARITY, draw_row, draw_similarity, moved, row_changed
from truth.arm import ROWS, forward
from truth.body import Body
from truth.history import History
from truth.kinds.kind import Array, Kind, Params, Scene, column
from truth.loop import Loop


def _homing(params: Params, j: int, history: History, q: Array) -> Array:
    offsets = np.atleast_1d(params["offset"])
    session = history.reference.session if len(offsets) > 1 else np.zeros(len(q), dtype=np.int64)
    return column(len(q), j, offsets[session])


def _draw_ratio(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"error": alike.sign(rng) * scene.noise[j] / alike.rms(scene.path(j))}


def _ratio(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, q[:, j] - q[:, j] / (1.0 + params["error"]))


def _draw_coupling(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    source = int(rng.choice([k for k in range(3) if k != j]))
    rms = float(np.sqrt(np.mean(scene.path(source) ** 2)))
    return {"source": source + 1, "coefficient": alike.sign(rng) * float(scene.noise[j]) / rms}


def _coupling(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, params["coefficient"] * q[:, params["source"] - 1])


def _eccentricity(params: Params, j: int, history: History, q: Array) -> Array:
    """Solve `m = q + a sin(N q + phi)` for q by Newton: the pulley turns with the true joint."""
    a, number, phase = params["amplitude"], params["waves"], params["phase"]
    true = np.array(q[:, j])
    for _ in range(4):
        turn = number * true + phase
        true -= (true + a * np.sin(turn) - q[:, j]) / (1.0 + a * number * np.cos(turn))
    return column(len(q), j, q[:, j] - true)


def _table_loop(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop, body._replace(rows=row_changed(body.rows, j, params))


def _table_tip(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    """Carry the tool by what the changed row does to it."""
    before, after = forward(q), forward(q, row_changed(ROWS, j, params))
    return after @ np.linalg.inv(before) @ T


KINDS = {
    "homing_offset": Kind(alike.draw_homing, grow=("offset",), path=_homing, bare=True),
    "transmission_ratio": Kind(_draw_ratio, grow=("error",), path=_ratio, bare=True),
    "cable_coupling": Kind(_draw_coupling, grow=("coefficient",), path=_coupling, bare=True),
    "pulley_eccentricity": Kind(alike.draw_eccentricity, grow=("amplitude",), path=_eccentricity, bare=True),
    "registration_error": Kind(
        lambda rng, j, scene: draw_similarity(rng),
        where="base",
        grow=SIMILARITY,
        tip=lambda params, j, history, q, T: moved(params, T),
        tracker_only=True,
    ),
    "dh_error": Kind(
        lambda rng, j, scene: draw_row(rng), grow=ROW_TERMS, loop=_table_loop, tip=_table_tip, tracker_only=True
    ),
}
