"""The recording beside the simulator: what the sensors should have measured if the model, plus some effects, were true.

The motor side is replayed: where motors are measured, everything behind them is predicted from their measured path, so
that an error of the servo model cannot pass for one of the transmission. Where the model has a controller, and the log
commands, the closed loop is run as well and predicts the motors themselves. In it act the effects of load and drive,
and all that the model has. Others of transmission and joint change the load by moving the links: that is taken to first
order and at rest, for a run of the loop takes ten times as long as their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gpcorrect import se3
from gpcorrect.discrepancy.recording.layout import Layout
from gpcorrect.discrepancy.recording.replay_memory import ReplayMemory
from gpcorrect.discrepancy.recording.servo_clock import Stamps
from gpcorrect.discrepancy.recording.tracker import Slack, Tracker
from gpcorrect.discrepancy.settings import CLOCK
from gpcorrect.sim.dynamics import JointPath, link_load
from gpcorrect.sim.effect_paths import joint_path, load_on_motors, tip_path
from gpcorrect.sim.effects import Effect, PathEffect, Stage, in_order, of_kind
from gpcorrect.sim.effects.base import SIDES, FrictionEffect
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.model import Model
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan
from gpcorrect.sim.plant import PASSES_BEYOND, Command, Driven, follow_command, mechanical
from gpcorrect.types import FloatArray, IntArray

LOOP_STAGES = (Stage.LOAD, Stage.CHAIN, Stage.TORQUE, Stage.FRICTION)
NUDGE = 1e-4  # rad or m, for slopes of the load


@dataclass(frozen=True)
class Channel:
    """One compared signal of a recording."""

    name: str  # such as "external_jp_2"
    signal: str  # of the log; the tracker's orientation counts as one of its own, "tracker_rotation"
    index: int  # column among the model's joints; of a tracker, the axis
    joint: int  # its number; 0 of a tracker
    unit: str  # "rad" or "m"


@dataclass(frozen=True, eq=False)
class Scene:
    """A log of n rows, a model of k joints, and the c channels that can be compared."""

    model: Model  # nominal; its own effects are always present
    machine: Machine  # the same resolved, without effects
    channels: tuple[Channel, ...]  # the tracker's stand last
    observed: FloatArray  # (n, c) what the sensors measured
    motion: Motion  # the motors as replayed, in N continuous runs
    acceleration: FloatArray  # (n, N, k) of the motors
    layout: Layout  # where the log's rows stand in these
    plan: Plan | None  # commands for the closed loop; None when it cannot be run
    payload: FloatArray  # (N,) kg at the tip in each run
    time: FloatArray  # (n,) s
    trajectory: IntArray  # (n,) as the log numbers them
    session: IntArray  # (n,) from 0
    effort: FloatArray | None  # (n, k) N m or N
    unclocked: bool = False  # a loop that is known was not run: no clock of its commands, or motions too short
    stamps: Stamps | None = None  # where the log's samples lie on the loop's clock; None when it has their own
    tracker: Tracker | None = None
    measured: bool = True  # else the motors' path is what the closed loop makes of the commands, where it runs
    slack: Slack | None = None  # the part of the tracker's residual that is left out of account
    remarks: tuple[str, ...] = ()  # what had to be assumed
    begun: tuple[Effect, ...] | None = None  # of a set those inside the loop: from its run loops take one further pass
    moved: tuple[Effect, ...] = ()  # of that set those that move the links in no loop: no others change the load there
    memory: ReplayMemory = field(default_factory=ReplayMemory, repr=False)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers of the joints."""
        return self.machine.body.joints

    @cached_property
    def step(self) -> float:
        """Usual time between samples, s."""
        steps = np.diff(self.time)
        return float(np.median(steps[steps > 0]))

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

    def way(self) -> FloatArray:
        """How far `(n, k)` each joint has come in its motion until then: the range of positions that it has been in."""
        path = self.motion.position
        return self.layout.gather(np.fmax.accumulate(path) - np.fmin.accumulate(path))

    def load(self) -> FloatArray:
        """Load `(n, k)` of each joint of the nominal model at the log's rows, N m or N."""
        return self.layout.gather(self._replay(self._machine(()))[0].load)

    def peak_torque(self) -> FloatArray | None:
        """Largest torque `(k,)` that the controllers ask for, N m or N; None where the closed loop cannot be run.

        Once they have forgotten how the motions began: motors that began elsewhere are pulled back by far more.
        """
        if (loop := self._loop(self._machine(()))) is None:
            return None
        later = self.motion.time - self.motion.time[0] >= CLOCK.settles
        return np.asarray(np.abs(loop.torque).max(axis=(0, 1), where=later[..., None], initial=0.0))

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
        machine = self._machine(effects)
        replayed, motors = self._replay(machine)
        found = []
        for signal in dict.fromkeys(c.signal for c in self.channels if c.joint):  # of all joints, in their order
            path = motors if signal == "measured_jp" else self._joint_path(machine, replayed)
            found.append(self.layout.gather(path))
        if self.tracker is not None:
            predicted = self.tracker.predicted(self._poses(machine, replayed))
            left_out = 0.0 if self.slack is None else self.slack.part(self.tracker.observed - predicted)
            found.append(predicted + left_out)
        return np.concatenate(found, axis=1)

    def marker_poses(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return the marker's poses `(n, 4, 4)` in the tracker's frame as far as the model states it.

        Parameters
        ----------
        effects : sequence of Effect, beyond the model's own, on an arm whose kinematics are known
        """
        machine = self._machine(effects)
        return self._poses(machine, self._replay(machine)[0])

    def _poses(self, machine: Machine, replayed: Motion) -> FloatArray:
        q = self._joint_path(machine, replayed, tracker=True)
        tip = tip_path(machine.effects, machine.actual_body(self.payload).forward(q), replayed)
        assert tip is not None
        return self.layout.gather(se3.compose(machine.T_tracker_base, tip, machine.T_tip_marker))

    def strict(self) -> Scene:
        """Return the scene with all of the residual in account, also what is within the tolerance of the table."""
        return replace(self, slack=None)

    def near(self, effects: Sequence[Effect]) -> Scene:
        """Return the scene for what differs by little from a set, in half of the time.

        Closed loops take one further pass from the set's run. A difference from the set, as seen there too, lacks what
        it changes of the load by its own change of the motors' path: a few per cent of itself, on arms as stiff as the
        two passes of other runs suppose. So does one that moves the links lack what that changes of the load.

        Parameters
        ----------
        effects : sequence of Effect, the set
        """
        machine = self._machine(effects)
        near = replace(self, begun=self._inside(machine), moved=self._moves(machine))
        return self if self.plan is None else near

    def residual(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return measured minus simulated `(n, c)`; NaN where nothing was measured.

        Parameters
        ----------
        effects : sequence of Effect
        """
        return self.observed - self.predict(effects)

    def _machine(self, effects: Sequence[Effect]) -> Machine:
        return self.machine.with_effects(*in_order((*self.model.effects, *effects)))

    def _replay(self, machine: Machine) -> tuple[Motion, FloatArray]:
        """Motion and load of the motors, as measured where they are, and their path `(n, N, k)` as it should have been.

        Without a loop that is the measured one, and the load is that of it.
        """
        loop, motion = self._loop(machine), self.motion
        if loop is None:
            body = machine.actual_body(self.payload)
            carried = link_load(body, JointPath(motion.position, motion.velocity, self.acceleration))
            motion = replace(motion, load=carried.total, gravity_load=carried.gravity, tip_force=body.tip_force)
            return motion, motion.position
        made, more, drive = loop.motion, self._more_load(machine, loop), machine.actual_drive
        load, gravity = made.load + more, made.gravity_load + more
        motion = replace(motion, load=load, gravity_load=gravity, tip_force=made.tip_force)
        if not self.measured:
            motion = replace(motion, position=made.position, velocity=made.velocity)
        # Controllers let motors go under more load, but for those that sum errors.
        more = more + self._geared(machine, load)
        return motion, made.position - more / drive.kp * (drive.ki is None or np.asarray(drive.ki) == 0.0)

    def _loop(self, machine: Machine) -> Driven | None:
        """Closed-loop run with the effects inside the loop, at the log's samples."""
        return None if self.plan is None else self._run(self._inside(machine))

    def _run(self, inside: tuple[Effect, ...]) -> Driven:
        """Return the same with these effects inside; at the plan's samples where the log's have no stamps of theirs."""
        key, loops = (inside, self.begun, self.stamps is None), self.memory.loops
        if (known := loops.get(key)) is not None:
            return known
        if self.stamps is not None:
            return loops.keep(key, self.stamps.read(replace(self, stamps=None)._run(inside)))
        return loops.keep(key, follow_command(self.machine.with_effects(*inside), self._command(inside)))

    def _command(self, inside: tuple[Effect, ...]) -> Command:
        """Commands of the closed loop with these effects: from the run of the model, or of a set that is begun from."""
        assert self.plan is not None
        memory, own = self.memory, self._inside(self._machine(()))
        if memory.command is None:
            memory.command = Command.of(self.machine, self.plan)
        if self.begun is None and inside == own:
            return memory.command
        before, passes = (own, None) if self.begun is None else (self.begun, PASSES_BEYOND)
        if (known := memory.begun.get((before, passes))) is None:
            driven = replace(self, begun=None)._run(before)
            known = memory.begun.keep((before, passes), replace(memory.command, begun=driven, passes=passes))
        return known

    def _inside(self, machine: Machine) -> tuple[Effect, ...]:
        """Effects that act in the closed loop, all friction at the motor where nothing behind feels on which side."""
        own, effects = self.model.effects, machine.effects
        inside = tuple(e for e in effects if e.stage in LOOP_STAGES or (e.stage < Stage.CLOCK and e in own))
        if any(e.stage not in LOOP_STAGES for e in effects):
            return inside
        return tuple(replace(e, side=SIDES[0]) if isinstance(e, FrictionEffect) else e for e in inside)

    def _moves(self, machine: Machine) -> tuple[Effect, ...]:
        """Effects that move the links in no closed loop."""
        if self.begun is not None:
            return self.moved
        inside = self._inside(machine)
        moves = tuple(e for e in machine.effects if e.stage < Stage.CLOCK and e not in inside)
        return moves if moves and self.plan is not None and self._pull().any() else ()  # links may weigh nothing

    def _pull(self) -> FloatArray:
        """Change `(n, N, k, k)` of each joint's load at rest for each joint's position, along the loop of the model."""
        if self.memory.pull is None:
            nominal = self._machine(())
            loop = self._loop(nominal)
            assert loop is not None
            body, still = nominal.actual_body(self.payload), np.zeros(loop.q.shape)
            moved = (np.zeros(len(self.joints)), *(NUDGE * np.eye(len(self.joints))))
            at, *beside = (link_load(body, JointPath(loop.q + by, still, still)).gravity for by in moved)
            self.memory.pull = np.stack([(load - at) / NUDGE for load in beside], axis=-1)
        return self.memory.pull

    def _more_load(self, machine: Machine, loop: Driven) -> FloatArray:
        """Load `(n, N, k)` that the joints have more where effects move the links that act in no loop."""
        if not (moves := self._moves(machine)):
            return np.zeros(1)
        motion = self.motion if self.measured else loop.motion
        motion = replace(motion, load=loop.motion.load, gravity_load=loop.motion.gravity_load)
        own = [e for e in mechanical(machine) if e in self.model.effects]
        moved = joint_path(in_order((*own, *moves)), motion) - joint_path(own, motion)
        return np.asarray(np.einsum("nNij,nNj->nNi", self._pull(), moved))

    def _geared(self, machine: Machine, load: FloatArray) -> FloatArray:
        """Load `(n, N, k)` that motors feel more than joints do, by effects that gear them and act in no loop."""
        inside = self._inside(machine)
        behind = [e for e in machine.effects if e.stage < Stage.CLOCK and e not in inside]
        return load_on_motors(behind, load, self.joints) - load

    def _joint_path(self, machine: Machine, motion: Motion, *, tracker: bool = False) -> FloatArray:
        """Return the true path `(n, N, k)` of the joints when the encoders, or the tracker, see it."""
        effects = [e for e in of_kind(machine.effects, PathEffect) if e.is_seen_by(tracker=tracker)]
        if self.plan is not None:
            return joint_path(effects, motion)
        # Without a loop loads depend on what hangs on the arm alone.
        hung = tuple(e for e in machine.effects if not isinstance(e, PathEffect))
        return joint_path(effects, motion, self.memory.columns, hung)
