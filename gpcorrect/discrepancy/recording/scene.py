"""The recording beside the simulator: what the sensors should have measured if the model, plus some effects, were true.

The motor side is replayed: where motors are measured, everything behind them is predicted from their measured path, so
that an error of the servo model cannot pass for one of the transmission. Where the model has a controller, and the log
commands on an even clock, the closed loop is run as well and predicts the motors themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from gpcorrect import se3
from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.discrepancy.recording.layout import Layout
from gpcorrect.discrepancy.recording.tolerance import Slack
from gpcorrect.discrepancy.recording.tracker import Tracker
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.effects import Effect, PathEffect, Stage, in_order, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.model import Model
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.plant import Command, Driven, follow_command, tip_path
from gpcorrect.types import FloatArray, IntArray

LOOP_STAGES = (Stage.LOAD, Stage.CHAIN, Stage.TORQUE, Stage.FRICTION)
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


class Signal(NamedTuple):
    """One or more channels as simulated: two of a scene with the same key have the same rows `(n, k)`."""

    key: Hashable
    rows: Callable[[], FloatArray]


@dataclass(frozen=True, eq=False)
class Scene:
    """A log, a model, and what can be compared.

    Parameters
    ----------
    model : Model
        Nominal model; its own effects are always present.
    machine : Machine
        The model resolved, without effects.
    channels : tuple of Channel
        What is compared.
    observed : (n, c) array
        What the sensors measured.
    motion : Motion
        The motors as replayed, n samples of N continuous runs.
    layout : Layout
        Where the log's rows stand in the runs.
    plan : Plan or None
        Commands for the closed loop; None when it cannot be run.
    payload : (N,) array
        kg at the tip in each run.
    time, trajectory, session : (n,) arrays
        Of the log's rows; sessions numbered from 0.
    effort : (n, k) array or None
        Reported efforts.
    tracker : Tracker or None
        Where one saw the arm: its channels stand last.
    measured : bool
        Whether the motors are measured; else their path is what the closed loop makes of the commands, where it runs.
    slack : Slack or None
        Part of the tracker's residual that is left out of account.
    remarks : tuple of str
        What had to be assumed.
    """

    model: Model
    machine: Machine
    channels: tuple[Channel, ...]
    observed: FloatArray
    motion: Motion
    layout: Layout
    plan: Plan | None
    payload: FloatArray
    time: FloatArray
    trajectory: IntArray
    session: IntArray
    effort: FloatArray | None
    tracker: Tracker | None = None
    measured: bool = True
    slack: Slack | None = None
    remarks: tuple[str, ...] = ()
    memory: ReplayMemory = field(default_factory=ReplayMemory, repr=False)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers of the joints."""
        return self.machine.body.joints

    @property
    def n_sessions(self) -> int:
        """Number of sessions."""
        return int(self.session.max()) + 1

    def run_of_row(self) -> IntArray:
        """Run `(n,)` that each of the log's rows stands in."""
        return self.layout.gather(np.broadcast_to(np.arange(len(self.payload)), self.layout.rows.shape))

    def motor_path(self) -> FloatArray:
        """Replayed motor path `(n, k)` of the log's rows."""
        return self.layout.gather(self.motion.position)

    def load(self) -> FloatArray:
        """Load `(n, k)` of each joint of the nominal model at the log's rows, N m or N."""
        return self.layout.gather(self._replay(self._machine(())).load)

    def peak_torque(self) -> FloatArray | None:
        """Largest torque `(k,)` that the controllers ask for, N m or N; None where the closed loop cannot be run."""
        loop = self._loop(self._machine(()))
        return None if loop is None else np.abs(loop.torque).max(axis=(0, 1))

    def predict(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return what the channels `(n, c)` should say with these effects beyond the model's own.

        Parameters
        ----------
        effects : sequence of Effect

        Raises
        ------
        DataError
            An effect does not fit the machine.
        """
        return np.concatenate([signal.rows() for signal in self.signals(effects)], axis=1)

    def signals(self, effects: Sequence[Effect] = ()) -> list[Signal]:
        """Return the same joint by joint, and for the tracker as a whole, each with what it depends on.

        Parameters
        ----------
        effects : sequence of Effect

        Raises
        ------
        DataError
            An effect does not fit the machine.
        """
        machine = self._machine(effects)
        inside, loop, motion = _inside(machine), self._loop(machine), self._replay(machine)
        numbers, paths = self.memory.joint_paths(machine.effects, motion, inside)
        measured = self.motion.position if loop is None else loop.motion.position
        found = []
        for c in self.channels:
            if c.joint:
                outside = c.signal == "external_jp"
                made, path = (numbers[c.index], paths[c.index]) if outside else (inside, measured[..., c.index])
                found.append(Signal((c.name, made), partial(self.layout.gather, path[..., None])))
        if self.tracker is not None:
            found.append(Signal(("tracker", machine.effects), partial(self._tracked_rows, self.tracker, effects)))
        return found

    def _tracked_rows(self, tracker: Tracker, effects: Sequence[Effect]) -> FloatArray:
        """Return what the tracker says `(n, a)`."""
        predicted = tracker.predicted(self.marker_poses(effects))
        return predicted if self.slack is None else predicted + self.slack.part(tracker.observed - predicted)

    def marker_poses(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return the marker's poses `(n, 4, 4)` in the tracker's frame as far as the model states it.

        Parameters
        ----------
        effects : sequence of Effect
            Beyond the model's own, on an arm whose kinematics are known.
        """
        machine = self._machine(effects)
        replay = self._replay(machine)
        q = np.stack(self.memory.joint_paths(machine.effects, replay, _inside(machine))[1], axis=-1)
        tip = tip_path(machine.effects, machine.actual_body(self.payload).forward(q), replay)
        assert tip is not None
        return self.layout.gather(se3.compose(machine.T_tracker_base, tip, machine.T_tip_marker))

    def strict(self) -> Scene:
        """Return the scene with all of the residual in account, also what is within the tolerance of the table."""
        return replace(self, slack=None)

    def residual(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return measured minus simulated `(n, c)`; NaN where nothing was measured.

        Parameters
        ----------
        effects : sequence of Effect
        """
        return self.observed - self.predict(effects)

    def _machine(self, effects: Sequence[Effect]) -> Machine:
        return self.machine.with_effects(*in_order((*self.model.effects, *effects)))

    def _replay(self, machine: Machine) -> Motion:
        """Motion and load of the motors, as measured where they are."""
        loop = self._loop(machine)
        if loop is not None:
            made = loop.motion
            motion = replace(self.motion, load=made.load, gravity_load=made.gravity_load, tip_force=made.tip_force)
            return motion if self.measured else replace(motion, position=made.position, velocity=made.velocity)
        body = machine.actual_body(self.payload)
        posture = posture_at(body, self.motion.position)
        if posture is None:
            return self.motion
        gravity = posture.gravity_load()
        return replace(self.motion, load=gravity, gravity_load=gravity, tip_force=body.tip_force)

    def _loop(self, machine: Machine) -> Driven | None:
        if self.plan is None:
            return None
        return self.memory.loop(machine.with_effects(*_inside(machine)), self.plan)


def _inside(machine: Machine) -> tuple[Effect, ...]:
    """Effects that act inside the closed loop."""
    return tuple(e for e in machine.effects if e.stage in LOOP_STAGES)
