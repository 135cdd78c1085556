"""Catalogue effects that give way under load: cables, links, payload, shaft, remote centre."""

from __future__ import annotations

import numpy as np

from truth.arm import RANGES
from truth.body import Body
from truth.history import History
from truth.kinds.kind import Array, Kind, Params, Scene, at, column, unit
from truth.loop import TICK_HZ, Loop

CABLE_DAMPING = 0.12  # of critical, on the link's inertia; steel rope on pulleys
LINK_INERTIA = (0.10, 0.09, 0.40)  # kg m^2, kg m^2, kg; only sets the damping
MIDDLE_INSERTION = float(RANGES[2].mean())  # m


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _typical_stiffness(j: int, scene: Scene) -> float:
    return max(_rms(scene.load(j)), unit(j, 0.2, 0.5)) / float(scene.noise[j])


def _with_cable(loop: Loop, j: int, typical: float, **others: Array) -> Loop:
    damping = 2 * CABLE_DAMPING * np.sqrt(typical * LINK_INERTIA[j])
    return loop._replace(cable_damping=at(loop.cable_damping, j, damping), **others)


def _draw_stretch(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"stiffness": _typical_stiffness(j, scene) * float(rng.uniform(0.8, 1.2))}


def _stretch(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    k = params["stiffness"]
    return _with_cable(loop, j, k, stiffness=at(loop.stiffness, j, k)), body


def _draw_nonlinear(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    k = 0.4 * _typical_stiffness(j, scene)
    return {"stiffness": k, "cubic": float(rng.uniform(1.5, 5.0)) * k / float(scene.noise[j]) ** 2}


def _nonlinear(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    k, cubic = params["stiffness"], params["cubic"]
    return _with_cable(loop, j, k, stiffness=at(loop.stiffness, j, k), cubic=at(loop.cubic, j, cubic)), body


def _draw_length(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Return a cable of 0.05 to 0.42 m: where the insertion reads zero is a convention of its table."""
    length = float(rng.uniform(-0.28, 0.0))
    return {"source": 3, "rigidity": (MIDDLE_INSERTION + length) * _typical_stiffness(j, scene), "length": length}


def _length(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    rigidity, length = params["rigidity"], params["length"]
    changed = {"length": at(loop.length, j, rigidity), "length_offset": at(loop.length_offset, j, length)}
    return _with_cable(loop, j, rigidity / (MIDDLE_INSERTION + length), **changed), body


def _draw_sag(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    weight = scene.history.motion.weight[scene.history.reference.logged, j]
    return {"stiffness": max(_rms(weight), unit(j, 0.1, 0.3)) / float(scene.noise[j])}


def _sag(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, history.motion.weight[:, j] / params["stiffness"])


def _draw_payload(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"mass": float(rng.uniform(0.1, 0.3))}


def _payload(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop, body._replace(mass=at(body.mass, 3, body.mass[3] + params["mass"]))


def lateral_force(history: History, T: Array) -> Array:
    """Part `(n, 3)` of the tip load's pull, N, across the shaft; the shaft lies along z of frame 3."""
    place = T[:, :3, 3]
    acceleration = np.gradient(np.gradient(place, axis=0), axis=0) * TICK_HZ**2
    force = history.reference.payload[:, None] * (history.gravity - acceleration)
    shaft = _shaft(T)
    return force - shaft * (force * shaft).sum(axis=1, keepdims=True)


def _shaft(T: Array) -> Array:
    """Return unit vectors `(n, 3)` from the remote centre to the wrist, which the held wrist places by the tip."""
    return T[:, :3, 3] / np.linalg.norm(T[:, :3, 3], axis=1, keepdims=True)


def _draw_bending(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"rigidity": float(rng.uniform(2.0, 6.0))}


def _bending(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    """Bend a cantilever from the remote centre to the tip, in eight slices: curvature F (L - s) / EI summed twice."""
    force, length = lateral_force(history, T), np.linalg.norm(T[:, :3, 3], axis=1, keepdims=True)
    slices = 8
    slope, sag = np.zeros_like(force), np.zeros_like(force)
    for i in range(slices):
        part = length / slices
        turn = force * (length - (i + 0.5) * part) / params["rigidity"] * part
        sag += (slope + 0.5 * turn) * part
        slope += turn
    return _turned(T, np.cross(_shaft(T), slope), sag)


def _turned(T: Array, turn: Array, shift: Array) -> Array:
    """Poses turned by small rotation vectors and shifted."""
    moved = np.array(T)
    for i in range(3):
        moved[:, :3, i] = T[:, :3, i] + np.cross(turn, T[:, :3, i])
    moved[:, :3, 3] = T[:, :3, 3] + shift
    return moved


def _draw_rcm(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"stiffness": float(rng.uniform(5e3, 2e4))}


def _rcm(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    return _turned(T, np.zeros((len(q), 3)), lateral_force(history, T) / params["stiffness"])


KINDS = {
    "cable_stretch": Kind(_draw_stretch, shrink=("stiffness",), loop=_stretch),
    "nonlinear_stretch": Kind(_draw_nonlinear, shrink=("stiffness", "cubic"), power={"cubic": 3.0}, loop=_nonlinear),
    "length_dependent_stiffness": Kind(_draw_length, shrink=("rigidity",), loop=_length),
    "gravity_sag": Kind(_draw_sag, shrink=("stiffness",), path=_sag),
    "payload": Kind(_draw_payload, where="all", grow=("mass",), loop=_payload),
    "shaft_bending": Kind(_draw_bending, where="tool", shrink=("rigidity",), tip=_bending, tracker_only=True),
    "rcm_shift": Kind(_draw_rcm, where="base", shrink=("stiffness",), tip=_rcm, tracker_only=True),
}
