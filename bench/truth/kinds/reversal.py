"""Catalogue effects that depend on the direction of motion: play, frictions, hysteresis."""

from __future__ import annotations

import numpy as np

from truth import alike
from truth.body import Body
from truth.history import History
from truth.kinds.kind import Array, Kind, Params, Scene, at, column
from truth.loop import Loop
from truth.operators import Relays, dead_zone_drag, preisach

DEPTH = 0.15  # least share of the motion that a hysteretic cable loses after a reversal


def _backlash(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, q[:, j] - dead_zone_drag(q[:, j], params["radius"], history.step))


def _draw_hysteresis(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Return a loop between a steep one, near a play, and a shallow one of many times its height."""
    path, depth = scene.path(j), float(np.exp(rng.uniform(np.log(DEPTH), 0.0)))
    return {
        "depth": depth,
        "width": float(3.0 * scene.noise[j] / depth),
        "narrow": float(rng.uniform(1.0, 3.0)),
        "wide": float(rng.uniform(1.0, 3.0)),
        "crowd": float(rng.uniform(0.3, 1.0)),
        "middle": float(np.quantile(path, rng.uniform(0.2, 0.8))),
        "spread": float(np.ptp(path) * rng.uniform(0.2, 0.5)),
    }


def _hysteresis(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, preisach(np.ascontiguousarray(q[:, j]), Relays(**params)))


def _coulomb(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(coulomb=at(loop.coulomb, j, params["torque"])), body


def _viscous(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(viscous=at(loop.viscous, j, params["damping"])), body


def _stribeck(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    changed = loop._replace(
        coulomb=at(loop.coulomb, j, params["torque"]),
        static=at(loop.static, j, params["static_torque"]),
        stribeck_speed=at(loop.stribeck_speed, j, params["speed"]),
    )
    return changed, body


def _capstan(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(capstan=at(loop.capstan, j, min(params["wrap"], 1.5))), body


def _wavy(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    changed = loop._replace(
        coulomb=at(loop.coulomb, j, params["torque"]),
        waviness=at(loop.waviness, j, params["swing"] / params["torque"]),
        wave_number=at(loop.wave_number, j, params["waves"]),
        wave_phase=at(loop.wave_phase, j, params["phase"]),
    )
    return changed, body


KINDS = {
    "backlash": Kind(alike.draw_backlash, grow=("radius",), path=_backlash, bare=True),
    "coulomb_friction": Kind(alike.draw_coulomb, grow=("torque",), loop=_coulomb),
    "viscous_friction": Kind(alike.draw_viscous, grow=("damping",), loop=_viscous),
    "stribeck_friction": Kind(alike.draw_stribeck, grow=("torque", "static_torque"), loop=_stribeck),
    "capstan_friction": Kind(alike.draw_capstan, grow=("wrap",), loop=_capstan),
    "position_dependent_friction": Kind(alike.draw_wavy, grow=("torque", "swing"), loop=_wavy),
    "hysteresis": Kind(_draw_hysteresis, grow=("width",), path=_hysteresis, bare=True),
}
