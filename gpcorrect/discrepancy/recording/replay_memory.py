"""What was simulated of a recording so far: closed-loop runs, and joint paths joint by joint; changes no result."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from gpcorrect.sim.effects import Effect, PathEffect, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.plant import Command, Driven, follow_command
from gpcorrect.types import FloatArray

REMEMBERED = 48  # closed-loop runs in memory
REMEMBERED_BYTES = 120_000_000  # of joint paths: memory only, no result depends on it


class ReplayMemory:
    """Closed-loop runs of the last sets of effects, and joint paths by what made them; the oldest are forgotten.

    A joint's path has a number, by the motion and the joint, or by an effect and the numbers of the paths it looks at:
    a change at one joint need not walk the others' paths again.
    """

    def __init__(self) -> None:
        self._command: Command | None = None
        self._loops: dict[tuple[Effect, ...], Driven] = {}
        self._numbers: dict[Hashable, int] = {}
        self._paths: dict[int, FloatArray] = {}

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

    def joint_paths(
        self, effects: Sequence[Effect], motion: Motion, of_motion: Hashable
    ) -> tuple[list[int], list[FloatArray]]:
        """Return the number and the true path `(n, N)` of each joint, as `gpcorrect.sim.plant.joint_path` makes it.

        Parameters
        ----------
        effects : sequence of Effect
            In the order in which they act.
        motion : Motion
            Of the motors.
        of_motion : hashable
            What the motion depends on.
        """
        paths = list(np.moveaxis(motion.position, -1, 0))
        numbers = [self._number((of_motion, j)) for j in range(len(paths))]
        for effect in of_kind(effects, PathEffect):
            changed = self._changed(effect, numbers, motion)
            if any(number not in self._paths for number in changed.values()):
                self._walk(effect, paths, motion, changed)
            for j, number in changed.items():
                numbers[j], paths[j] = number, self._paths[number]
        return numbers, paths

    def _changed(self, effect: PathEffect, numbers: list[int], motion: Motion) -> dict[int, int]:
        """Numbers of the paths behind an effect, by the joints that it changes."""
        if isinstance(effect.joint, int):
            looked_at = [numbers[effect.column(motion.joints, joint)] for joint in effect.joints]
            return {effect.column(motion.joints): self._number((effect, *looked_at))}
        if effect.joint_by_joint:
            return {j: self._number((effect, number)) for j, number in enumerate(numbers)}
        return {j: self._number((effect, tuple(numbers), j)) for j in range(len(numbers))}

    def _walk(self, effect: PathEffect, paths: list[FloatArray], motion: Motion, changed: dict[int, int]) -> None:
        while len(self._paths) * paths[0].nbytes > REMEMBERED_BYTES:
            self._paths.pop(next(iter(self._paths)))
        if not effect.joint_by_joint:
            behind = effect.act(np.stack(paths, axis=-1), motion)
            self._paths.update({number: behind[..., j] for j, number in changed.items()})
            return
        for j, number in changed.items():
            if number not in self._paths:
                self._paths[number] = effect.act(paths[j][..., None], motion)[..., 0]

    def _number(self, made: Hashable) -> int:
        return self._numbers.setdefault(made, len(self._numbers))
