"""What was simulated of a recording so far: closed-loop runs, and joint paths joint by joint; changes no result."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.sim.effects import Effect, PathEffect, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.plant import Command, Driven, follow_command
from gpcorrect.types import FloatArray

REMEMBERED_BYTES = 120_000_000  # of joint paths: memory only, no result depends on it


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


class PathMemory:
    """Columns of joint paths by what made them: a change at one joint need not walk the others' paths again.

    A column has a number, by the motion and the joint, or by an effect and the numbers of the columns it looks at.
    The oldest paths are forgotten.
    """

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}
        self._paths: dict[int, FloatArray] = {}

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
        """Return the paths of all joints `(n, N, k)`.

        Parameters
        ----------
        effects : sequence of Effect
            In the order in which they act.
        motion : Motion
            Of the motors.
        of_motion : hashable
            What the motion depends on.
        """
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
        if any(number not in self._paths for number in changed.values()):
            self._walk(effect, columns, motion, changed)
        return [JointColumn(changed[j], self._paths[changed[j]]) if j in changed else c for j, c in enumerate(columns)]

    def _walk(self, effect: PathEffect, columns: list[JointColumn], motion: Motion, changed: dict[int, int]) -> None:
        while len(self._paths) * columns[0].path.nbytes > REMEMBERED_BYTES:
            self._paths.pop(next(iter(self._paths)))
        if not effect.joint_by_joint:
            behind = effect.act(np.stack([c.path for c in columns], axis=-1), motion)
            self._paths.update({number: behind[..., j] for j, number in changed.items()})
            return
        for j, number in changed.items():
            if number not in self._paths:
                self._paths[number] = effect.act(columns[j].path[..., None], motion)[..., 0]

    def _number(self, made: Hashable) -> int:
        return self._numbers.setdefault(made, len(self._numbers))


REMEMBERED = 48  # closed-loop runs in memory


class ReplayMemory:
    """What a scene has simulated so far: closed-loop runs of the last sets, and joint paths."""

    def __init__(self) -> None:
        self.paths = PathMemory()
        self._command: Command | None = None
        self._loops: dict[tuple[Effect, ...], Driven] = {}

    def loop(self, machine: Machine, plan: Plan) -> Driven:
        """Return the closed-loop run of a machine, made where it is not known.

        Parameters
        ----------
        machine : Machine
            With the effects inside the loop only.
        plan : Plan
            Commands, always the same.
        """
        if self._command is None:
            self._command = Command.of(machine.with_effects(), plan)
        if machine.effects not in self._loops:
            while len(self._loops) >= REMEMBERED:
                self._loops.pop(next(iter(self._loops)))
            self._loops[machine.effects] = follow_command(machine, self._command)
        return self._loops[machine.effects]
