"""The recording beside the simulator: what the sensors should have measured if the model, plus some effects, were true.

The motor side is replayed: where motors are measured, everything behind them is predicted from their measured path, so
that an error of the servo model cannot pass for one of the transmission. Where the model has a controller, and the log
commands on an even clock, the closed loop is run as well and predicts the motors themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from gpcorrect import se3
from gpcorrect.discrepancy.recording.channels import (
    Channel,
)
from gpcorrect.discrepancy.recording.layout import Layout
from gpcorrect.discrepancy.recording.tolerance import (
    Slack,
    rotation_onto,
)
from gpcorrect.sim.body import Body
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.effects import ChainEffect, Effect, LoadEffect, PathEffect, Stage, in_order, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.model import Model
from gpcorrect.sim.motion import Motion, Readings
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.plant import Command, Driven, follow_command, tip_path
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["JointColumn", "PathMemory", "Scene", "Signal"]

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
        self._forget(columns[0].path.nbytes)
        if not effect.joint_by_joint:
            behind = effect.act(np.stack([c.path for c in columns], axis=-1), motion)
            self._paths.update({number: behind[..., j] for j, number in changed.items()})
            return
        for j, number in changed.items():
            if number not in self._paths:
                self._paths[number] = effect.act(columns[j].path[..., None], motion)[..., 0]

    def _number(self, made: Hashable) -> int:
        return self._numbers.setdefault(made, len(self._numbers))

    def _forget(self, size: int) -> None:
        while len(self._paths) * size > REMEMBERED_BYTES:
            self._paths.pop(next(iter(self._paths)))


REMEMBERED = 48  # closed-loop runs in memory
LOOP_STAGES = (Stage.LOAD, Stage.CHAIN, Stage.TORQUE, Stage.FRICTION)


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


class Signal(NamedTuple):
    """One channel as simulated: two of a scene with the same key say the same."""

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
    registered_on : (n,) bool array
        Rows on which the tracker's frame is registered, when the model does not give it.
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
    registered_on: BoolArray
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
        columns = np.broadcast_to(np.arange(self.layout.rows.shape[1], dtype=np.float64), self.layout.rows.shape)
        return self.layout.gather(columns, len(self)).astype(np.int64)

    def motor_path(self) -> FloatArray:
        """Replayed motor path `(n, k)` of the log's rows."""
        return self.layout.gather(self.motion.position, len(self))

    def load(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return the load `(n, k)` of each joint at the log's rows, N m or N.

        Parameters
        ----------
        effects : sequence of Effect
            Beyond the model's own.
        """
        return self.layout.gather(self._replay(self._machine(effects)).load, len(self))

    def peak_torque(self) -> FloatArray | None:
        """Largest torque `(k,)` that the controllers ask for, N m or N; None where the closed loop cannot be run."""
        loop = self._loop(self._machine(()))
        return None if loop is None else np.abs(loop.torque).max(axis=(0, 1))

    def predict(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return what the channels `(n, c)` should say with these effects beyond the model's own.

        Parameters
        ----------
        effects : sequence of Effect
            Beyond the model's own.

        Raises
        ------
        DataError
            An effect does not fit the machine.
        """
        return np.stack([signal.rows() for signal in self.signals(effects)], axis=1)

    def signals(self, effects: Sequence[Effect] = ()) -> list[Signal]:
        """Return the same channel by channel, each with what it depends on.

        Parameters
        ----------
        effects : sequence of Effect
            Beyond the model's own.

        Raises
        ------
        DataError
            An effect does not fit the machine.
        """
        machine = self._machine(effects)
        if self.tracked:
            return self._signals_together(machine)
        inside = _inside(machine)
        loop, columns = (
            self._loop(machine),
            self.memory.paths.joint_columns(machine.effects, self._replay(machine), inside),
        )
        measured = self.motion.position if loop is None else loop.motion.position
        return [
            Signal((c.name, columns[c.index].number), self._rows_of(columns[c.index].path))
            if c.signal == "external_jp"
            else Signal((c.name, inside), self._rows_of(measured[..., c.index]))
            for c in self.channels
        ]

    def _rows_of(self, grid: FloatArray) -> Callable[[], FloatArray]:
        return lambda: self.layout.gather(grid, len(self))

    def _signals_together(self, machine: Machine) -> list[Signal]:
        """Signals where each depends on every effect."""

        @cache
        def together() -> FloatArray:
            return self._all_rows(machine)

        def one(i: int) -> Callable[[], FloatArray]:
            return lambda: together()[:, i]

        return [Signal((c.name, machine.effects), one(i)) for i, c in enumerate(self.channels)]

    def _all_rows(self, machine: Machine) -> FloatArray:
        """Return what the sensors say `(n, c)`."""
        readings = self._readings(machine)
        grids = {
            "measured_jp": readings.measured_jp,
            "external_jp": readings.external_jp,
            "tracker_cp": None if readings.T_tracker_marker is None else readings.T_tracker_marker[..., :3, 3],
        }
        columns = {name: self.layout.gather(g, len(self)) for name, g in grids.items() if g is not None}
        if "tracker_cp" in columns and self.model.T_tracker_base is None:
            columns["tracker_cp"] = self._registered(columns["tracker_cp"])
        predicted = np.stack([columns[c.signal][:, c.index] for c in self.channels], axis=1)
        return predicted if self.slack is None else predicted + self.slack.part(self.observed - predicted)

    def strict(self) -> Scene:
        """Return the scene with all of the residual in account, also what is within the tolerance of the table."""
        return replace(self, slack=None)

    def residual(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return measured minus simulated `(n, c)`; NaN where nothing was measured.

        Parameters
        ----------
        effects : sequence of Effect
            Beyond the model's own.
        """
        return self.observed - self.predict(effects)

    def _machine(self, effects: Sequence[Effect]) -> Machine:
        return self.machine.with_effects(*in_order((*self.model.effects, *effects)))

    def _readings(self, machine: Machine) -> Readings:
        replay = self._replay(machine)
        loop = self._loop(machine)
        before = _inside(machine)
        q = self.memory.paths.joint_path(machine.effects, replay, before)
        marker = None
        if self._sees("tracker_cp"):
            tip = tip_path(machine.effects, self._body(machine).forward(q), replay)
            marker = None if tip is None else se3.compose(machine.T_tracker_base, tip, machine.T_tip_marker)
        measured = replay.position if loop is None else loop.motion.position
        velocity = replay.velocity if loop is None else loop.motion.velocity
        torque = replay.load if loop is None else loop.torque
        return Readings(measured, velocity, torque, q, marker)  # effects on readings are noise: they change no mean

    def _replay(self, machine: Machine) -> Motion:
        loop = self._loop(machine)
        if loop is not None:
            made = loop.motion
            motion = replace(self.motion, load=made.load, gravity_load=made.gravity_load, tip_force=made.tip_force)
            return motion if self.measured else replace(motion, position=made.position, velocity=made.velocity)
        body = self._body(machine)
        posture = posture_at(body, self.motion.position)
        if posture is None:
            return self.motion
        gravity = posture.gravity_load()
        return replace(self.motion, load=gravity, gravity_load=gravity, tip_force=body.tip_force)

    def _body(self, machine: Machine) -> Body:
        """Body with the payloads of the replayed runs and the effects on masses and geometry."""
        links, chain = replace(machine.body.links, payload=self.payload), machine.body.chain
        for load in of_kind(machine.effects, LoadEffect):
            links = load.act(links)
        for change in of_kind(machine.effects, ChainEffect):
            chain = chain if chain is None else change.act(chain)
        return replace(machine.body, links=links, chain=chain).compact()

    def _loop(self, machine: Machine) -> Driven | None:
        if self.plan is None:
            return None
        return self.memory.loop(machine.with_effects(*_inside(machine)), self.plan)

    @property
    def tracked(self) -> bool:
        """Whether the arm is seen by a tracker."""
        return self._sees("tracker_cp")

    def _sees(self, signal: str) -> bool:
        return any(c.signal == signal for c in self.channels)

    def _registered(self, position: FloatArray) -> FloatArray:
        """Positions `(n, 3)` moved rigidly onto the tracker's: least squares on the rows for it (Arun 1987)."""
        seen = np.stack([self.observed[:, i] for i, c in enumerate(self.channels) if c.signal == "tracker_cp"], axis=1)
        rows = self.registered_on & np.isfinite(seen).all(axis=1) & np.isfinite(position).all(axis=1)
        a, b = position[rows], seen[rows]
        moved: FloatArray = (position - a.mean(axis=0)) @ rotation_onto(a, b).T + b.mean(axis=0)
        return moved


def _inside(machine: Machine) -> tuple[Effect, ...]:
    """Effects that act inside the closed loop."""
    return tuple(e for e in machine.effects if e.stage in LOOP_STAGES)
