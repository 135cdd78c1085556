"""Operators with memory, compiled, on paths `(n,)` of uneven time steps; none is the one that a catalogue would use."""

from __future__ import annotations

from math import erf, pi, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

DRAG = 5e-5  # s; compression of the contact for each unit of speed
GAPS = 24  # sorts of relay
CELLS = 60  # relays of one sort along a width


@njit(cache=True)
def dead_zone_drag(path, radius, step):
    """Place of a massless element that a spring with a dead zone drags against viscous friction: backlash.

    In contact the spring is compressed by `DRAG` times the speed, the solution of `DRAG w' = dead_zone(u - w)` once the
    start has died away, which takes far less than a step.
    """
    out = np.empty(len(path))
    place = path[0]
    for i in range(len(path)):
        moved = path[i] - path[max(i - 1, 0)]
        reach = radius + DRAG * abs(moved) / step
        if path[i] - place > reach:
            place = path[i] - reach
        elif path[i] - place < -reach:
            place = path[i] + reach
        out[i] = place
    return out


class Relays(NamedTuple):
    """Preisach's plane: how many relays there are of each gap and place.

    `depth` is the share of the motion that goes through relays. Of gaps up to `2 width` a beta density with exponents
    `narrow` and `wide`; of places, evenly many and a crowd (`crowd` times as many more) about `middle`, `spread` wide,
    which lies higher for wider gaps.
    """

    depth: float
    width: float
    narrow: float
    wide: float
    crowd: float
    middle: float
    spread: float


@njit(cache=True)
def preisach(path, relays):
    """Lag of a path behind itself, at most `depth` times `width`, by relays that are neither alike nor evenly spread.

    After a reversal the lag takes up `depth` of the motion where the crowd is, and less elsewhere; then ever less.
    Relays of one gap lie along the path, a `CELLS`-th of the width apart; those that are up end at a front, and only
    that front moves, so that counting relays costs one comparison a gap (Mayergoyz 1991, Ch. 1). Loops are wider where
    the crowd is, and minor loops are not congruent, which no sum of plays shows.
    """
    cell = relays.width / CELLS
    front, gap, share = np.full(GAPS, path[0]), np.empty(GAPS), np.empty(GAPS)
    for g in range(GAPS):
        part = (g + 0.5) / GAPS
        gap[g] = part * 2 * relays.width
        share[g] = part ** (relays.narrow - 1.0) * (1.0 - part) ** (relays.wide - 1.0)
    share /= share.sum()
    out = np.empty(len(path))
    for i in range(len(path)):
        lag = 0.0
        for g in range(GAPS):
            up = np.floor((path[i] - 0.5 * gap[g]) / cell) * cell
            down = np.ceil((path[i] + 0.5 * gap[g]) / cell) * cell
            front[g] = min(max(front[g], up), down)
            lag += share[g] * (_below(relays, gap[g], path[i]) - _below(relays, gap[g], front[g]))
        out[i] = lag * relays.depth / (1.0 + relays.crowd)
    return out


@njit(cache=True)
def _below(relays, gap, place):
    """Count of relays of a gap below a place, up to a constant."""
    away = (place - relays.middle - 0.5 * gap) / relays.spread
    return place + relays.crowd * relays.spread * 0.5 * sqrt(pi) * erf(away)


@njit(cache=True)
def kelvin_voigt(time, load, gain, seconds):
    """Strain of a spring and a dashpot side by side under a load: exact for a load that is constant in a step."""
    out = np.empty(len(load))
    strain = gain * load[0]
    for i in range(len(load)):
        if i:
            strain += (1.0 - np.exp(-(time[i] - time[i - 1]) / seconds)) * (gain * load[i - 1] - strain)
        out[i] = strain
    return out


@njit(cache=True)
def second_order(path, omega, damping, step):
    """Answer from rest of a mass on a spring whose other end follows a path, damped against the ground.

    Half a drift, a kick, half a drift, four times a step.
    """
    out = np.empty(len(path))
    fine = 4
    h = step / fine
    x, v = path[0], 0.0
    for i in range(len(path)):
        out[i] = x
        after = path[min(i + 1, len(path) - 1)]
        for s in range(fine):
            u = path[i] + (after - path[i]) * (s + 0.5) / fine
            x += 0.5 * h * v
            v += h * (omega * omega * (u - x) - 2 * damping * omega * v)
            x += 0.5 * h * v
    return out


@njit(cache=True)
def warm_up(time, power, seconds):
    """Temperature of a body heated by a power and cooled in proportion to itself; a unit of power gives a degree."""
    out = np.empty(len(power))
    warm = 0.0
    for i in range(len(power)):
        if i:
            warm += (1.0 - np.exp(-(time[i] - time[i - 1]) / seconds)) * (power[i] - warm)
        out[i] = warm
    return out
