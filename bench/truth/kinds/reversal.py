"""Catalogue effects that depend on the direction of motion: play, frictions, hysteresis."""

from __future__ import annotations

import numpy as np

from truth.body import Body
from truth.history import History
from truth.kinds.kind import Array, Kind, Params, Scene, at, column, unit
from truth.loop import Loop
from truth.operators import Relays, dead_zone_drag, preisach

GAIN = (450.0, 360.0, 110000.0)  # typical kp, to turn an error into a torque
DEPTH = 0.15  # least share of the motion that a hysteretic cable loses after a reversal


def _torque(j: int, scene: Scene) -> float:
    return float(GAIN[j] * scene.noise[j])


def _draw_backlash(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"radius": float(1.1 * scene.noise[j])}


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


def _draw_coulomb(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"torque": _torque(j, scene), "side": "motor"}


def _coulomb(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(coulomb=at(loop.coulomb, j, params["torque"])), body


def _draw_viscous(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"damping": _torque(j, scene) / unit(j, 0.15, 0.02), "side": "motor"}


def _viscous(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(viscous=at(loop.viscous, j, params["damping"])), body


def _draw_stribeck(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    level = 0.8 * _torque(j, scene)
    speed = float(unit(j, 1.0, 0.12) * np.exp(rng.uniform(np.log(0.03), np.log(0.12))))
    return {"torque": level, "static_torque": level * float(rng.uniform(2.0, 3.5)), "speed": speed, "side": "motor"}


def _stribeck(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    changed = loop._replace(
        coulomb=at(loop.coulomb, j, params["torque"]),
        static=at(loop.static, j, params["static_torque"]),
        stribeck_speed=at(loop.stribeck_speed, j, params["speed"]),
    )
    return changed, body


def _draw_capstan(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    load = max(float(np.sqrt(np.mean(scene.load(j) ** 2))), unit(j, 0.2, 0.5))
    return {"wrap": _torque(j, scene) / load, "side": "motor"}


def _capstan(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop._replace(capstan=at(loop.capstan, j, min(params["wrap"], 1.5))), body


def _draw_wavy(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    torque = _torque(j, scene)
    return {
        "torque": torque,
        "swing": torque * float(rng.uniform(0.7, 0.98)),
        "waves": float(unit(j, 1.0, 12.0) * rng.uniform(6.0, 14.0)),
        "phase": float(rng.uniform(-np.pi, np.pi)),
        "side": "motor",
    }


def _wavy(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    changed = loop._replace(
        coulomb=at(loop.coulomb, j, params["torque"]),
        waviness=at(loop.waviness, j, params["swing"] / params["torque"]),
        wave_number=at(loop.wave_number, j, params["waves"]),
        wave_phase=at(loop.wave_phase, j, params["phase"]),
    )
    return changed, body


KINDS = {
    "backlash": Kind(_draw_backlash, grow=("radius",), path=_backlash, bare=True),
    "coulomb_friction": Kind(_draw_coulomb, grow=("torque",), loop=_coulomb),
    "viscous_friction": Kind(_draw_viscous, grow=("damping",), loop=_viscous),
    "stribeck_friction": Kind(_draw_stribeck, grow=("torque", "static_torque"), loop=_stribeck),
    "capstan_friction": Kind(_draw_capstan, grow=("wrap",), loop=_capstan),
    "position_dependent_friction": Kind(_draw_wavy, grow=("torque", "swing"), loop=_wavy),
    "hysteresis": Kind(_draw_hysteresis, grow=("width",), path=_hysteresis, bare=True),
}
