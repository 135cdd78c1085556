"""The laws that act inside the servo loop, as numbers and compiled functions of one joint at one instant.

The loop runs a thousand times a second for every run and joint: an effect of the catalogue gives it a law to
evaluate, not a method to call. Each formula stands here once, for the loop and for `act` alike.
"""

from __future__ import annotations

from math import exp, inf, sin
from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.types import FloatArray

__all__ = ["FrictionLaw", "TorqueLaw", "contact", "contact_along", "resisting", "resisting_along"]


class FrictionLaw(NamedTuple):
    """Friction as a function of speed v, position q and load tau.

    Its dry limit is `torque + (static - torque) exp(-(v / speed)^2) + swing sin(waves q + phase)`, at least 0, plus
    `|tau| (exp(wrap) - 1)` against the load or `|tau| (1 - exp(-wrap))` with it; `damping v` comes on top
    (Armstrong-Helouvry, Dupont, Canudas de Wit 1994; Euler and Eytelwein's belt).

    Parameters
    ----------
    torque, static : float
        Kinetic and static limit, N m or N.
    speed : float
        Over which the one becomes the other, rad/s or m/s; at 0 there is no static limit.
    swing, waves, phase : float
        Part that varies with position: N m or N, rad of phase per unit of the joint, rad.
    wrap : float
        Friction coefficient times wrap angle of a cable under the load.
    damping : float
        N m s/rad or N s/m.
    """

    torque: float = 0.0
    static: float = 0.0
    speed: float = 0.0
    swing: float = 0.0
    waves: float = 0.0
    phase: float = 0.0
    wrap: float = 0.0
    damping: float = 0.0


class TorqueLaw(NamedTuple):
    """What becomes of the commanded torque: cut at `limit`, and pushed back by a stop.

    Parameters
    ----------
    limit : float
        N m or N.
    stiffness : float
        Of the stop, N m/rad or N/m.
    upper, lower : float
        Joint values beyond which it pushes, rad or m.
    """

    limit: float = inf
    stiffness: float = 0.0
    upper: float = inf
    lower: float = -inf


@njit(cache=True)
def resisting(laws: FloatArray, i: int, q: float, v: float, load: float) -> tuple[float, float]:
    """Dry limits against forward and backward motion, >= 0, of row i of :class:`FrictionLaw` numbers."""
    torque, static, speed = laws[i, 0], laws[i, 1], laws[i, 2]
    swing, waves, phase, wrap = laws[i, 3], laws[i, 4], laws[i, 5], laws[i, 6]
    limit = torque
    if speed > 0.0:
        limit += (static - torque) * exp(-((v / speed) ** 2))
    if swing != 0.0:
        limit += swing * sin(waves * q + phase)
    limit = max(limit, 0.0)
    if wrap == 0.0:
        return limit, limit
    against, along = abs(load) * (exp(wrap) - 1.0), abs(load) * (1.0 - exp(-wrap))
    return (limit + against, limit + along) if load > 0.0 else (limit + along, limit + against)


@njit(cache=True)
def contact(laws: FloatArray, i: int, q: float) -> float:
    """Torque with which a stop is pressed, positive at its upper end, of row i of :class:`TorqueLaw` numbers."""
    stiffness, upper, lower = laws[i, 1], laws[i, 2], laws[i, 3]
    if stiffness == 0.0:
        return 0.0
    pressed: float = stiffness * (max(q - upper, 0.0) - max(lower - q, 0.0))
    return pressed


@njit(cache=True)
def _resisting_rows(law: FloatArray, q: FloatArray, v: FloatArray, load: FloatArray) -> FloatArray:
    limits = np.empty((2, q.size))
    for i in range(q.size):
        limits[0, i], limits[1, i] = resisting(law, 0, q[i], v[i], load[i])
    return limits


def resisting_along(law: FrictionLaw, q: FloatArray, v: FloatArray, load: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Dry limits against forward and backward motion in many states, arrays of the states' shape."""
    limits = _resisting_rows(np.array([law]), *(np.ravel(a).astype(np.float64) for a in (q, v, load)))
    return limits[0].reshape(q.shape), limits[1].reshape(q.shape)


def contact_along(law: TorqueLaw, q: FloatArray) -> FloatArray:
    """Torque with which a stop is pressed at many joint values."""
    pressed = [contact(np.array([law]), 0, float(value)) for value in np.ravel(q)]
    return np.array(pressed).reshape(q.shape)
