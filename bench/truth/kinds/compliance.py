"""Catalogue effects that give way under load: cables, links, payload, shaft, remote centre."""

from __future__ import annotations

import numpy as np

from truth import alike
from truth.arm import RANGES
from truth.body import Body
from truth.history import History
from truth.kinds.kind import Array, Kind, Params, Scene, at, column
from truth.loop import Loop

CABLE_DAMPING = 0.12  # of critical, on the link's inertia; steel rope on pulleys
LINK_INERTIA = (0.10, 0.09, 0.40)  # kg m^2, kg m^2, kg; only sets the damping
MIDDLE_INSERTION = float(RANGES[2].mean())  # m


def _with_cable(loop: Loop, j: int, typical: float, **others: Array) -> Loop:
    damping = 2 * CABLE_DAMPING * np.sqrt(typical * LINK_INERTIA[j])
    return loop._replace(cable_damping=at(loop.cable_damping, j, damping), **others)


def _stretch(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    k = params["stiffness"]
    return _with_cable(loop, j, k, stiffness=at(loop.stiffness, j, k)), body


def _nonlinear(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    k, cubic = params["stiffness"], params["cubic"]
    return _with_cable(loop, j, k, stiffness=at(loop.stiffness, j, k), cubic=at(loop.cubic, j, cubic)), body


def _draw_length(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    """Return a cable of 0.05 to 0.42 m: where the insertion reads zero is a convention of its table."""
    length = float(rng.uniform(-0.28, 0.0))
    return {"source": 3, "rigidity": (MIDDLE_INSERTION + length) * alike.typical_stiffness(j, scene), "length": length}


def _length(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    rigidity, length = params["rigidity"], params["length"]
    changed = {"length": at(loop.length, j, rigidity), "length_offset": at(loop.length_offset, j, length)}
    return _with_cable(loop, j, rigidity / (MIDDLE_INSERTION + length), **changed), body


def _sag(params: Params, j: int, history: History, q: Array) -> Array:
    return column(len(q), j, history.motion.weight[:, j] / params["stiffness"])


def _draw_payload(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    return {"mass": float(rng.uniform(0.1, 0.3))}


def _payload(params: Params, j: int, loop: Loop, body: Body) -> tuple[Loop, Body]:
    return loop, body._replace(mass=at(body.mass, 3, body.mass[3] + params["mass"]))


def _shaft(T: Array) -> Array:
    """Return unit vectors `(n, 3)` from the remote centre to the wrist, which the held wrist places by the tip."""
    return T[:, :3, 3] / np.linalg.norm(T[:, :3, 3], axis=1, keepdims=True)


def _bending(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    """Bend a cantilever from the remote centre to the tip, in eight slices: curvature F (L - s) / EI summed twice."""
    force, length = (
        alike.lateral_force(history.reference.payload, history.gravity, T),
        np.linalg.norm(T[:, :3, 3], axis=1, keepdims=True),
    )
    slices = 8
    slope, sag = np.zeros_like(force), np.zeros_like(force)
    for i in range(slices):
        part = length / slices
        turn = force * (length - (i + 0.5) * part) / params["rigidity"] * part
        sag += (slope + 0.5 * turn) * part
        slope += turn
    return alike.turned(T, np.cross(_shaft(T), slope), sag)


def _rcm(params: Params, j: int, history: History, q: Array, T: Array) -> Array:
    return alike.turned(
        T,
        np.zeros((len(q), 3)),
        alike.lateral_force(history.reference.payload, history.gravity, T) / params["stiffness"],
    )


KINDS = {
    "cable_stretch": Kind(alike.draw_stretch, shrink=("stiffness",), loop=_stretch),
    "nonlinear_stretch": Kind(
        alike.draw_nonlinear, shrink=("stiffness", "cubic"), power={"cubic": 3.0}, loop=_nonlinear
    ),
    "length_dependent_stiffness": Kind(_draw_length, shrink=("rigidity",), loop=_length),
    "gravity_sag": Kind(alike.draw_sag, shrink=("stiffness",), path=_sag),
    "payload": Kind(_draw_payload, where="all", grow=("mass",), loop=_payload),
    "shaft_bending": Kind(alike.draw_bending, where="tool", shrink=("rigidity",), tip=_bending, tracker_only=True),
    "rcm_shift": Kind(alike.draw_rcm, where="base", shrink=("stiffness",), tip=_rcm, tracker_only=True),
}
