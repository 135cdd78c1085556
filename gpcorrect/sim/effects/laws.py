"""The laws that act inside the servo loop, as numbers and compiled functions of one joint at one instant.

The loop runs a thousand times a second for every run and joint: an effect gives it a law to evaluate, not a method to
call.
"""

from __future__ import annotations

from math import exp, inf, sin
from typing import NamedTuple

from numba import njit

from gpcorrect.types import FloatArray


class FrictionLaw(NamedTuple):
    """Friction as a function of speed v, position q and load tau.

    Its dry limit is `torque + (static - torque) exp(-(v / speed)^2) + swing sin(waves q + phase)`, at least 0, plus
    `|tau| (exp(wrap) - 1)` against the load or `|tau| (1 - exp(-wrap))` with it; `damping v` comes on top
    (Armstrong-Helouvry, Dupont, Canudas de Wit 1994; Euler and Eytelwein's belt).

    With a `slope` it is soft instead: `slope v + inertia v'`, up to that limit, and the damping (the friction loss of
    MuJoCo: its documentation, Computation, constraint model).

    With a `bristle` it is a force F that bends before it slips, F' = bristle (v - |v| F / limit): Dahl's, or
    LuGre's without its micro-damping (Canudas de Wit et al. 1995, IEEE TAC 40(3)).

    Parameters
    ----------
    torque, static : float, kinetic and static limit, N m or N
    speed : float, over which the one becomes the other, rad/s or m/s; at 0 there is no static limit
    swing, waves, phase : float
        Part that varies with position: N m or N, rad of phase per unit of the joint, rad.
    wrap : float, friction coefficient times wrap angle of a cable under the load
    damping : float, N m s/rad or N s/m
    slope : float, of soft friction over speed, N m s/rad or N s/m; at 0 the friction is dry
    inertia : float, by which soft friction resists a change of speed too, kg m^2 or kg
    bristle : float, stiffness of what bends before it slips, N m/rad or N/m; at 0 there is none
    """

    torque: float = 0.0
    static: float = 0.0
    speed: float = 0.0
    swing: float = 0.0
    waves: float = 0.0
    phase: float = 0.0
    wrap: float = 0.0
    damping: float = 0.0
    slope: float = 0.0
    inertia: float = 0.0
    bristle: float = 0.0

    def softened(self, onset: float, onset_time: float) -> FrictionLaw:
        """Return the same friction where it creeps before it slips; dry as it is where the onset is 0.

        Parameters
        ----------
        onset : float, speed over which it grows, rad/s or m/s
        onset_time : float
            Time constant with which it brings to rest, or to its creep, what it can hold, s; a step of the loop counts
            when it is less.
        """
        if onset == 0.0:
            return self
        slope = max(self.torque, self.static) / onset
        return self._replace(slope=slope, inertia=slope * onset_time)


class TorqueLaw(NamedTuple):
    """What becomes of the commanded torque: cut at `limit`, and pushed back by a stop or a spring.

    Parameters
    ----------
    limit : float, N m or N
    stiffness : float, of the stop, N m/rad or N/m
    upper, lower : float, joint values beyond which it pushes, rad or m
    push : float, with which it pushes everywhere, N m or N
    """

    limit: float = inf
    stiffness: float = 0.0
    upper: float = inf
    lower: float = -inf
    push: float = 0.0


@njit(cache=True)
def resisting(laws: FloatArray, i: int, q: float, v: float, load: float) -> tuple[float, float]:
    """Return the dry limits against forward and against backward motion, N m or N, both >= 0.

    Parameters
    ----------
    laws : (k, 11) array, rows of :class:`FrictionLaw` numbers
    i : int
    q, v, load : float, position, speed and load of the joint, SI units
    """
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
    """Return the torque with which a stop is pressed, N m or N, positive at its upper end.

    Parameters
    ----------
    laws : (k, 5) array, rows of :class:`TorqueLaw` numbers
    i : int
    q : float, position of the joint, rad or m
    """
    stiffness, upper, lower, pressed = laws[i, 1], laws[i, 2], laws[i, 3], laws[i, 4]
    if stiffness != 0.0:
        pressed += stiffness * (max(q - upper, 0.0) - max(lower - q, 0.0))
    return float(pressed)
