"""The steps of the servo loop, compiled: the one place where a motor, its controller and its frictions are moved on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.sim.effects.laws import contact, resisting
from gpcorrect.types import FloatArray, IntArray

__all__ = ["Given", "Laws", "Outside", "advance", "no_outside"]

MOTOR, JOINT = 0, 1  # before and behind the transmission: the order of `stages.SIDES`
Sides = tuple[float, float]


class Given(NamedTuple):
    """What the loop is given: constants `(dof,)`, and references runs first, so that each run reads along its memory.

    `position` and `velocity` are given at the m steps `(N, m, dof)`, `feedforward`, `load` and `carried` at every
    `stride`-th of them `(N, n, dof)` and are linear between. `gain` is the speed won in a step for each unit of torque;
    `load` goes against the motion, `carried` is what the frictions see.
    """

    kp: FloatArray
    kd: FloatArray
    gain: FloatArray
    step: float
    stride: int
    position: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    load: FloatArray
    carried: FloatArray


class Laws(NamedTuple):
    """Laws of the catalogue's effects: rows of numbers in the order of their columns, and a friction's side.

    Those of column j are the rows `of[j]` to `of[j + 1]`. Nothing in the steps cuts rows out of an array: the counting
    of references to the cuts would take longer than the laws.
    """

    friction: FloatArray
    friction_of: IntArray
    friction_side: IntArray
    torque: FloatArray
    torque_of: IntArray


class Outside(NamedTuple):
    """What effects that have no law do in a step: torque `(N, dof)`; limits and damping by side, `(2, N, dof)`."""

    torque: FloatArray
    forward: FloatArray
    backward: FloatArray
    damping: FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def advance(
    runs: tuple[int, int],
    steps: tuple[int, int],
    given: Given,
    laws: Laws,
    outside: Outside,
    position: FloatArray,
    velocity: FloatArray,
    samples: FloatArray,
) -> None:
    """Move `position` and `velocity` `(N, dof)` of some runs (first, last) through some steps (first, last), in place.

    Every `stride`-th step leaves its position, velocity, commanded torque and torque behind the transmission in
    `samples` `(4, N, n, dof)`.
    """
    last = given.load.shape[1] - 1
    for r in range(runs[0], runs[1]):
        k, beyond = divmod(steps[0], given.stride)
        wanted, pace, fed = given.position[r], given.velocity[r], given.feedforward[r]
        loads, loads_felt = given.load[r], given.carried[r]
        for i in range(steps[0], steps[1]):
            part, after = beyond / given.stride, min(k + 1, last)
            for j in range(position.shape[1]):
                q, v = position[r, j], velocity[r, j]
                torque = given.kp[j] * (wanted[i, j] - q) + given.kd[j] * (pace[i, j] - v)
                torque += _between(fed, k, after, part, j)
                load, felt = _between(loads, k, after, part, j), _between(loads_felt, k, after, part, j)
                delivered, pressed = _delivered(laws, j, torque + outside.torque[r, j], q)
                frictions = _frictions(laws, outside, r, j, q, v, felt)
                speed, behind = _braked(v, given.gain[j], delivered - pressed - load, frictions)
                position[r, j], velocity[r, j] = q + given.step * speed, speed
                if beyond == 0:
                    samples[0, r, k, j], samples[1, r, k, j], samples[2, r, k, j] = q, v, torque
                    samples[3, r, k, j] = behind + pressed
            beyond += 1
            if beyond == given.stride:
                k, beyond = k + 1, 0


@njit(cache=True, error_model="numpy")
def _between(samples: FloatArray, k: int, after: int, part: float, j: int) -> float:
    """Value between a sample and the one after it."""
    value: float = samples[k, j] + part * (samples[after, j] - samples[k, j])
    return value


@njit(cache=True, error_model="numpy")
def _delivered(laws: Laws, j: int, torque: float, q: float) -> tuple[float, float]:
    """Torque that the drive delivers, and the one with which stops are pressed."""
    pressed = 0.0
    for a in range(laws.torque_of[j], laws.torque_of[j + 1]):
        torque = min(max(torque, -laws.torque[a, 0]), laws.torque[a, 0])
        pressed += contact(laws.torque, a, q)
    return torque, pressed


@njit(cache=True, error_model="numpy")
def _frictions(
    laws: Laws, outside: Outside, r: int, j: int, q: float, v: float, load: float
) -> tuple[Sides, Sides, Sides]:
    """Limits against forward and backward motion, and damping."""
    forward = outside.forward[MOTOR, r, j], outside.forward[JOINT, r, j]
    backward = outside.backward[MOTOR, r, j], outside.backward[JOINT, r, j]
    damping = outside.damping[MOTOR, r, j], outside.damping[JOINT, r, j]
    for a in range(laws.friction_of[j], laws.friction_of[j + 1]):
        up, down = resisting(laws.friction, a, q, v, load)
        behind = laws.friction_side[a] == JOINT
        forward, backward = _added(forward, up, behind), _added(backward, down, behind)
        damping = _added(damping, laws.friction[a, 7], behind)
    return forward, backward, damping


@njit(cache=True, error_model="numpy")
def _braked(v: float, gain: float, driving: float, frictions: tuple[Sides, Sides, Sides]) -> tuple[float, float]:
    """Speed after a step, and the friction behind the transmission in it."""
    forward, backward, damping = frictions
    factor = 1.0 / (1.0 + gain * (damping[MOTOR] + damping[JOINT]))
    gain = gain * factor
    free = factor * v + gain * driving
    ceiling = gain * (forward[MOTOR] + forward[JOINT])
    floor = -gain * (backward[MOTOR] + backward[JOINT])
    taken = min(max(free, floor), ceiling)
    limits = forward if taken > 0.0 else backward
    share = limits[JOINT] / max(limits[MOTOR] + limits[JOINT], 1e-300)
    return free - taken, share * taken / gain + damping[JOINT] * (free - taken)


@njit(cache=True, error_model="numpy")
def _added(sides: Sides, value: float, behind: bool) -> Sides:
    """Return the same with a value more before the transmission, or behind it."""
    return (sides[MOTOR], sides[JOINT] + value) if behind else (sides[MOTOR] + value, sides[JOINT])


def no_outside(runs: int, dof: int) -> Outside:
    """Return arrays for effects without a law, all zero."""
    return Outside(np.zeros((runs, dof)), *(np.zeros((2, runs, dof)) for _ in range(3)))
