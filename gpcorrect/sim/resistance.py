"""All friction of the arm together, as the servo loop needs it: a threshold and a damping for every joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gpcorrect.sim.effects import FrictionEffect
from gpcorrect.sim.effects.stages import SIDES
from gpcorrect.sim.motion import DriveState
from gpcorrect.types import FloatArray

__all__ = ["Resistance", "Sides", "Slowing"]


class Slowing(NamedTuple):
    """What friction does to the speed in one step, `(N, dof)` arrays.

    `factor` is the damping's part; dry friction then takes away at most `ceiling` (`floor` is its negative).
    """

    factor: FloatArray
    floor: FloatArray
    ceiling: FloatArray


class Sides(NamedTuple):
    """Dry limit and damping before (`motor`) and behind (`joint`) the transmission, `(2, N, dof)` arrays."""

    limit: FloatArray
    damping: FloatArray


class Resistance:
    """Sum of the frictions, with the constant ones added up once.

    Parameters
    ----------
    effects : sequence of FrictionEffect
        Frictions.
    joints : tuple of int
        Joint numbers of the columns.
    gain : (N, dof) array
        Speed gained in a step for each unit of torque.
    """

    def __init__(self, effects: Sequence[FrictionEffect], joints: tuple[int, ...], gain: FloatArray) -> None:
        self.present = bool(effects)
        self.varies = any(e.varies for e in effects)
        self._behind = any(e.side == "joint" for e in effects)
        self._changing = [e for e in effects if e.varies]
        self._joints, self._gain = joints, gain
        rest = DriveState(joints, np.zeros(gain.shape), np.zeros(gain.shape), np.zeros(gain.shape))
        nothing = Sides(np.zeros((2, *gain.shape)), np.zeros((2, *gain.shape)))
        self._constant = self._add(nothing, [e for e in effects if not e.varies], rest)
        self._constant_slowing = self._slowing(self._constant)

    def at(self, state: DriveState | None) -> Slowing:
        """Slowing in a state; the state may be None when nothing varies."""
        if state is None or not self.varies:
            return self._constant_slowing
        return self._slowing(self._add(self._constant, self._changing, state))

    def behind(self, state: DriveState, velocity: FloatArray, taken: FloatArray) -> FloatArray:
        """Friction torque `(N, dof)` behind the transmission, given the speed and what dry friction took of it."""
        if not self._behind:
            return np.zeros(velocity.shape)
        limit, damping = self._add(self._constant, self._changing, state)
        total = limit.sum(axis=0)
        share = limit[1] / np.where(total > 0, total, 1.0)
        factor = 1.0 / (1.0 + self._gain * damping.sum(axis=0))
        torque: FloatArray = share * taken / (self._gain * factor) + damping[1] * velocity
        return torque

    def _slowing(self, sides: Sides) -> Slowing:
        factor = 1.0 / (1.0 + self._gain * sides.damping.sum(axis=0))
        ceiling = self._gain * factor * sides.limit.sum(axis=0)
        return Slowing(factor, -ceiling, ceiling)

    def _add(self, sides: Sides, effects: Sequence[FrictionEffect], state: DriveState) -> Sides:
        if not effects:
            return sides
        limit, damping = sides.limit.copy(), sides.damping.copy()
        for effect in effects:
            where = SIDES.index(effect.side), slice(None), effect.column(self._joints)
            friction = effect.act(state)
            limit[where] += friction.limit
            damping[where] += friction.damping
        return Sides(limit, damping)
