"""The steps of the servo loop, compiled: the one place where a motor, its controller and its frictions are moved on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.sim.effects.laws import contact, resisting
from gpcorrect.types import FloatArray, IntArray

__all__ = ["Given", "Laws", "Outside", "advance", "no_outside"]

MOTOR, JOINT = 0, 1  # before and behind the transmission: the order of `stages.SIDES`


class Given(NamedTuple):
    """What the loop is given: constants `(dof,)`, and references at its m steps `(m, N, dof)`.

    `gain` is the speed won in a step for each unit of torque; `load` goes against the motion, `carried` is what the
    frictions see.
    """

    kp: FloatArray
    kd: FloatArray
    gain: FloatArray
    step: float
    position: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    load: FloatArray
    carried: FloatArray


class Laws(NamedTuple):
    """Laws of the catalogue's effects: rows of numbers, the column that each acts on, and a friction's side."""

    friction: FloatArray
    friction_column: IntArray
    friction_side: IntArray
    torque: FloatArray
    torque_column: IntArray


class Outside(NamedTuple):
    """What effects that have no law do in a step: torque `(N, dof)`; limits and damping by side, `(2, N, dof)`."""

    torque: FloatArray
    forward: FloatArray
    backward: FloatArray
    damping: FloatArray


@njit(cache=True)
def advance(
    first: int,
    last: int,
    stride: int,
    given: Given,
    laws: Laws,
    outside: Outside,
    position: FloatArray,
    velocity: FloatArray,
    samples: FloatArray,
) -> None:
    """Move `position` and `velocity` `(N, dof)` through the steps `first` to `last`, in place.

    Every `stride`-th step leaves its position, velocity, commanded torque and torque behind the transmission in
    `samples` `(4, n, N, dof)`.
    """
    for i in range(first, last):
        sampled = i % stride == 0
        k = i // stride
        for r in range(position.shape[0]):
            for j in range(position.shape[1]):
                q, v = position[r, j], velocity[r, j]
                torque = given.kp[j] * (given.position[i, r, j] - q) + given.kd[j] * (given.velocity[i, r, j] - v)
                torque += given.feedforward[i, r, j]
                pressed = _pressed(laws, j, q)
                driving = _delivered(laws, j, torque + outside.torque[r, j]) - pressed - given.load[i, r, j]
                forward, backward, damping = _friction(laws, outside, r, j, q, v, given.carried[i, r, j])
                factor = 1.0 / (1.0 + given.gain[j] * (damping[MOTOR] + damping[JOINT]))
                gain = given.gain[j] * factor
                free = factor * v + gain * driving
                ceiling = gain * (forward[MOTOR] + forward[JOINT])
                floor = -gain * (backward[MOTOR] + backward[JOINT])
                taken = min(max(free, floor), ceiling)
                velocity[r, j] = free - taken
                position[r, j] = q + given.step * velocity[r, j]
                if sampled:
                    limits = forward if taken > 0.0 else backward
                    share = limits[JOINT] / max(limits[MOTOR] + limits[JOINT], 1e-300)
                    samples[0, k, r, j], samples[1, k, r, j], samples[2, k, r, j] = q, v, torque
                    samples[3, k, r, j] = share * taken / gain + damping[JOINT] * velocity[r, j] + pressed


@njit(cache=True)
def _delivered(laws: Laws, j: int, torque: float) -> float:
    for i in range(len(laws.torque_column)):
        if laws.torque_column[i] == j:
            torque = min(max(torque, -laws.torque[i, 0]), laws.torque[i, 0])
    return torque


@njit(cache=True)
def _pressed(laws: Laws, j: int, q: float) -> float:
    pressed = 0.0
    for i in range(len(laws.torque_column)):
        if laws.torque_column[i] == j:
            pressed += contact(laws.torque[i], q)
    return pressed


@njit(cache=True)
def _friction(
    laws: Laws, outside: Outside, r: int, j: int, q: float, v: float, load: float
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Limits against forward and backward motion, and damping, each before and behind the transmission."""
    forward, backward = outside.forward[MOTOR, r, j], outside.backward[MOTOR, r, j]
    forward_behind, backward_behind = outside.forward[JOINT, r, j], outside.backward[JOINT, r, j]
    damping, damping_behind = outside.damping[MOTOR, r, j], outside.damping[JOINT, r, j]
    for i in range(len(laws.friction_column)):
        if laws.friction_column[i] == j:
            up, down = resisting(laws.friction[i], q, v, load)
            if laws.friction_side[i] == JOINT:
                forward_behind, backward_behind = forward_behind + up, backward_behind + down
                damping_behind += laws.friction[i, 7]
            else:
                forward, backward, damping = forward + up, backward + down, damping + laws.friction[i, 7]
    return (forward, forward_behind), (backward, backward_behind), (damping, damping_behind)


def no_outside(runs: int, dof: int) -> Outside:
    """Return arrays for effects without a law, all zero."""
    return Outside(np.zeros((runs, dof)), *(np.zeros((2, runs, dof)) for _ in range(3)))
