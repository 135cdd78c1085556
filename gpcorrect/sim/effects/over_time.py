"""Effects of time: what creeps, drifts and slips, and what is seen or commanded late."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.body import Drive
from gpcorrect.sim.effects.base import DriveEffect, JointEffect, PathEffect, PathOperator, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import PAUSES, Memory, lag, shifted
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

# Units, physical ranges and typical sizes on revolute and prismatic joints.
COMPLIANCE = Range("rad/(N m)", 0.0, 0.1, 2e-3), Range("m/N", 0.0, 1e-3, 2e-5)
RATE = Range("rad/s", -1e-3, 1e-3, 2e-6), Range("m/s", -1e-4, 1e-4, 2e-7)
SLIP = Range("rad", -0.5, 0.5, 0.01), Range("m", -0.05, 0.05, 5e-4)


@dataclass(frozen=True)
class Creep(JointEffect):
    """The joint lags behind the motor by a stretch that follows the load with a delay of seconds to minutes.

    A session starts in balance with its first load, or at a part of that: at nothing, where the cable was slack before.
    From run to run it goes on. When in the pause between two runs the load changes, as where another payload is taken
    up, no log says: that is a choice.
    """

    compliance: float
    time_constant: float
    pause: str = "linear"  # "held": the load changes as the next run begins; "at_once": as the one before it ends
    balance: float = 1.0

    about = Description(
        name="creep",
        number=21,
        family=Family.TIME,
        equation="q = m - x, time_constant x' + x = compliance tau",
        source="Kelvin-Voigt element; Findley, Lai, Onaran 1976, Creep and Relaxation of Nonlinear Materials, Ch. 5",
        parameters=(
            Parameter("compliance", "settled stretch for each unit of load", *COMPLIANCE),
            Parameter(
                "time_constant",
                "time in which it settles",
                Range("s", 0.1, 1e4, 10.0),
                ladder=Ladder(Per.PRIOR, (0.1, 1.0, 10.0)),
            ),
            Parameter(
                "balance",
                "part of what the first load comes to at last, with which a session begins",
                Range("1", -4.0, 5.0, 1.0),
                positive=False,
                ladder=Ladder(Per.PRIOR, (0.0,), absent=True),
            ),
        ),
        neighbours=("drift", "cable_stretch"),
        separating_runs=(Run.HOLD_UNLOAD, Run.LOAD_SWAP),
        choices=(("pause", PAUSES),),
        carries_over=True,
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        load = motion.load[..., j]
        slow = lag(load, motion.time, self.time_constant, motion.session, memory, self.pause, self.balance)
        return q[..., j] - self.compliance * slow


@dataclass(frozen=True)
class Drift(JointEffect):
    """An offset that grows with session time: steadily, or towards a limit."""

    rate: float
    time_constant: float = inf

    stage = Stage.ENCODER
    about = Description(
        name="drift",
        number=22,
        family=Family.TIME,
        equation="reported = q + rate T (1 - exp(-t / T)), T = time_constant; rate t as T grows",
        source="RAVEN-II calibration paper: shift over six hours of running; first-order warm-up law",
        parameters=(
            Parameter("rate", "first rate of reported minus true position", *RATE, positive=False),
            Parameter(
                "time_constant",
                "time over which it settles",
                Range("s", 10.0, inf, 3600.0),
                ladder=Ladder(Per.SESSION, (inf, 0.5, 0.1)),
            ),
        ),
        neighbours=("creep", "cable_slip"),
        separating_runs=(Run.REFERENCE_RETURNS, Run.HOLD_UNLOAD),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        if np.isinf(self.time_constant):
            return q[..., j] - self.rate * motion.time
        return q[..., j] + self.rate * self.time_constant * np.expm1(-motion.time / self.time_constant)


@dataclass(frozen=True)
class Delay(PathEffect):
    """Every joint is seen where it was `delay` seconds ago; outside the recorded time it stood still.

    By all sensors, or by the tracker alone ("tool"), which has a clock of its own. Between samples the path is a
    monotone cubic, which never overshoots a play's corners.
    """

    delay: float  # negative where the robot's own reports are the late ones

    stage = Stage.CLOCK
    about = Description(
        name="delay",
        number=23,
        family=Family.TIME,
        equation="y(t) = x(t - delay), of all sensors or of the tracker",
        source="Fritsch and Carlson 1980, SIAM J. Numer. Anal. 17(2), for the values between samples",
        parameters=(Parameter("delay", "age of what is seen", Range("s", -0.5, 0.5, 0.03), positive=False),),
        neighbours=("viscous_friction", "resonance"),
        separating_runs=(Run.SPEED_LADDER, Run.ONE_JOINT),
        sites=(Site.ALL, Site.TOOL),
    )

    def is_seen_by(self, *, tracker: bool) -> bool:
        """See :class:`PathEffect`."""
        return tracker or self.joint == "all"

    def operator(self) -> PathOperator:
        """Refuse a negative delay: an arm that moves now is not seen before it moves."""
        if self.delay < 0:
            raise DataError(
                f"an arm that runs live cannot be seen {-self.delay} s before it moves.",
                hint="Leave the effect `delay` out, or give it a delay of at least 0.",
            )
        return super().operator()

    def advance(self, q: FloatArray, motion: Motion, memory: Memory) -> FloatArray:
        """Return each run's path as it was before; of a stretch, with what is left of the stretches before it."""
        if self.delay == 0:
            return q
        path = np.concatenate([memory["path"], q]) if memory else q
        time = np.concatenate([memory["time"], motion.time]) if memory else motion.time
        rows = np.broadcast_to(time[..., None], path.shape).reshape(len(path), -1)
        behind = shifted(np.ascontiguousarray(path).reshape(len(path), -1), rows, self.delay).reshape(path.shape)
        passed = int((time <= time[-1] - self.delay).sum(axis=0).min())
        memory["path"], memory["time"] = path[max(passed - 2, 0) :], time[max(passed - 2, 0) :]
        return behind[len(path) - len(q) :]


@dataclass(frozen=True)
class CommandDelay(DriveEffect):
    """Every controller, or a joint's alone, follows what was commanded `delay` seconds ago.

    Transport to the controllers is such a delay, a command that is held until the next one comes is half its period,
    and so is a log that stamps commands earlier than motors.
    """

    delay: float  # negative where the log's commands are the late ones

    about = Description(
        name="command_delay",
        number=33,
        family=Family.TIME,
        equation="q_d(t) = q_logged(t - delay)",
        source="zero-order hold and transport delay; Astrom and Wittenmark 1997, Computer-Controlled Systems, Sec. 2.3",
        parameters=(Parameter("delay", "age of what is followed", Range("s", -0.1, 0.2, 0.01), positive=False),),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("viscous_friction", "gain_error", "delay"),
        separating_runs=(Run.SPEED_LADDER, Run.ONE_JOINT),
        sites=(Site.ALL, Site.JOINT),
    )

    def is_a_matter_of_steps(self, drive: Drive, joints: tuple[int, ...]) -> bool:
        """Of all joints, up to a step by the order of command and state, and half for which a command is held."""
        return self.joint == "all" and abs(self.delay) <= 1.5 / drive.rate_hz

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Add to the latency."""
        return replace(drive, latency=self._of_each(self.delay, joints, drive.latency))


@dataclass(frozen=True)
class CableSlip(JointEffect):
    """The cable jumps on its drum: a step of the offset of the reported position, which the next homing takes away."""

    step: float
    instant: float
    session: int = 0  # index, from 0

    about = Description(
        name="cable_slip",
        number=24,
        family=Family.TIME,
        equation="reported = q + step [t >= instant]",
        source="a step at a change-point: Page 1954, Biometrika 41",
        parameters=(
            Parameter("step", "reported minus true position after the slip", *SLIP, positive=False),
            Parameter(
                "instant",
                "when it slips, in session time",
                Range("s", 0.0, 1e6, 600.0),
                ladder=Ladder(Per.SESSION, tuple(i / 32 for i in range(1, 32))),
                change_point=True,
            ),
        ),
        neighbours=("drift", "homing_offset"),
        separating_runs=(Run.REFERENCE_RETURNS, Run.REHOMING),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.session, int) and self.session >= 0):
            raise DataError(f"effect cable_slip: session must be an index from 0, got {self.session!r}.")

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        slipped = (motion.time >= self.instant) & (motion.session == self.session)
        behind: FloatArray = q[..., j] - self.step * slipped
        return behind
