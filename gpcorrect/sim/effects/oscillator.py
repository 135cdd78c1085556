"""The free motion of a damped oscillator, in closed form."""

from __future__ import annotations

from math import cos, exp, sin, sqrt

from numba import njit

__all__ = ["swung"]

CRITICAL = 1e-6  # relative distance from critical damping inside which the limit is used


@njit(cache=True)
def swung(away: float, speed: float, after: float, omega: float, damping: float) -> tuple[float, float]:
    """Place and speed after some time of `x'' + 2 d w x' + w^2 x = 0`, under, at and over critical damping.

    Parameters
    ----------
    away, speed : float
        Where it starts, and how fast.
    after : float
        s.
    omega, damping : float
        w, rad/s, and d.

    Returns
    -------
    away, speed : float
    """
    decay = damping * omega
    lead = speed + decay * away
    split = 1.0 - damping**2
    if abs(split) < CRITICAL:
        fade = exp(-decay * after)
        return fade * (away + lead * after), fade * (lead - decay * (away + lead * after))
    if split > 0.0:
        nu = omega * sqrt(split)
        fade, c, s = exp(-decay * after), cos(nu * after), sin(nu * after)
        x = fade * (away * c + lead / nu * s)
        return x, fade * (lead * c - away * nu * s) - decay * x
    nu = omega * sqrt(-split)
    # The slow root's part and the fast one's, each with its own decay, so that no hyperbolic function overflows.
    slow, fast = exp((nu - decay) * after), exp(-(nu + decay) * after)
    plus, minus = 0.5 * (away + lead / nu), 0.5 * (away - lead / nu)
    return plus * slow + minus * fast, (nu - decay) * plus * slow - (nu + decay) * minus * fast
