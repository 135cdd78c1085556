"""Joint paths through effects, remembered joint by joint.

A change at one joint need not walk the others' paths again.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect.sim.effects import Effect, PathEffect, of_kind
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["JointColumn", "PathMemory"]

REMEMBERED_BYTES = 120_000_000


@dataclass(frozen=True, eq=False)
class JointColumn:
    """One joint's path, and a number that stands for all that made it.

    Parameters
    ----------
    number : int
        Two columns of one memory with the same number are the same.
    path : (n, N) array
        rad or m.
    """

    number: int
    path: FloatArray


@dataclass(frozen=True, eq=False)
class PathMemory:
    """Columns of joint paths by what made them.

    Parameters
    ----------
    numbers : dict
        Number of a column, by the motion and the joint, or by an effect and the numbers of the columns it looks at.
    paths : dict
        Path `(n, N)` of each number; the oldest are forgotten.
    """

    numbers: dict[Hashable, int] = field(default_factory=dict, repr=False)
    paths: dict[int, FloatArray] = field(default_factory=dict, repr=False)

    def joint_columns(self, effects: Sequence[Effect], motion: Motion, of_motion: Hashable) -> list[JointColumn]:
        """Return the true path of each joint, the same as `gpcorrect.sim.plant.joint_path`.

        Parameters
        ----------
        effects : sequence of Effect
            In the order in which they act.
        motion : Motion
            Of the motors.
        of_motion : hashable
            What the motion depends on.
        """
        q = motion.position
        columns = [JointColumn(self._number((of_motion, j)), q[..., j]) for j in range(q.shape[-1])]
        for effect in of_kind(effects, PathEffect):
            columns = self._behind(effect, columns, motion)
        return columns

    def joint_path(self, effects: Sequence[Effect], motion: Motion, of_motion: Hashable) -> FloatArray:
        """Return the paths of all joints `(n, N, k)`."""
        return np.stack([c.path for c in self.joint_columns(effects, motion, of_motion)], axis=-1)

    def _behind(self, effect: PathEffect, columns: list[JointColumn], motion: Motion) -> list[JointColumn]:
        """Return the columns behind an effect: those that it changes anew, or from memory."""
        if isinstance(effect.joint, int):
            j = effect.column(motion.joints)
            looked_at = [columns[effect.column(motion.joints, number)].number for number in effect.joints]
            changed = {j: self._number((effect, *looked_at))}
        elif effect.joint_by_joint:
            changed = {j: self._number((effect, column.number)) for j, column in enumerate(columns)}
        else:
            every = tuple(column.number for column in columns)
            changed = {j: self._number((effect, every, j)) for j in range(len(columns))}
        if any(number not in self.paths for number in changed.values()):
            self._walk(effect, columns, motion, changed)
        return [JointColumn(changed[j], self.paths[changed[j]]) if j in changed else c for j, c in enumerate(columns)]

    def _walk(self, effect: PathEffect, columns: list[JointColumn], motion: Motion, changed: dict[int, int]) -> None:
        self._forget(columns[0].path.nbytes)
        if not effect.joint_by_joint:
            behind = effect.act(np.stack([c.path for c in columns], axis=-1), motion)
            self.paths.update({number: behind[..., j] for j, number in changed.items()})
            return
        for j, number in changed.items():
            if number not in self.paths:
                self.paths[number] = effect.act(columns[j].path[..., None], motion)[..., 0]

    def _number(self, made: Hashable) -> int:
        return self.numbers.setdefault(made, len(self.numbers))

    def _forget(self, size: int) -> None:
        while len(self.paths) * size > REMEMBERED_BYTES:
            self.paths.pop(next(iter(self.paths)))
