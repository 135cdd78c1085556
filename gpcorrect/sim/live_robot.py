"""A simulated arm that takes commands as a CRTK robot does: states, servo and move, joints and poses.

No clock and no network: `advance` lets time pass, the caller says how much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gpcorrect.arms import Arm, RemoteCentreArm
from gpcorrect.errors import DataError
from gpcorrect.sim.live import LiveArm
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.plan import minimum_jerk
from gpcorrect.sim.reaching import Pace, tour, working_posture
from gpcorrect.sim.sensors import Sensors
from gpcorrect.types import FloatArray

RobotState = Literal["DISABLED", "ENABLED", "PAUSED", "FAULT"]
COMMANDS = ("enable", "disable", "pause", "resume", "home", "unhome")

PEAK = 1.875  # of a minimum-jerk motion's speed over its mean (Flash and Hogan 1985)
# Chosen by hand:
UNRATED = 0.25  # of a joint's range a second, where no speed limit is published
HOLD = 0.1  # s: a servo command that comes later than this after the one before is gone to at the speed limit
HASTE = 3.0  # times the way of that time at the speed limit: a servo command further away is refused
CARTESIAN = Pace(speed=0.03, acceleration=0.3, turn_rate=0.6)
MOVE_RATE_HZ = 100.0  # of the poses of a straight move, whose joints are interpolated: enough at hand speed


@dataclass(frozen=True, eq=False)
class Reading:
    """What is known of the arm at one instant.

    Parameters
    ----------
    time : float, session time, s
    position, velocity, effort : (dof,) arrays, as the robot reports them, rad or m
    external : (dof,) array, true joints as outside encoders see them
    tracker : (4, 4) array or None
        Marker pose in the tracker's frame; None for bare joints, and where the tracker was not asked.
    """

    time: float
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    external: FloatArray
    tracker: FloatArray | None


class LiveRobot:
    """An arm with a controller that keeps its own rules; starts disabled and not homed.

    Parameters
    ----------
    machine : Machine, arm, drives, effects and sensors
    rng : numpy.random.Generator, of the sensors' noise
    block : int, servo steps between two looks at where the arm is; see :class:`~gpcorrect.sim.live.LiveArm`
    """

    def __init__(self, machine: Machine, rng: np.random.Generator, *, block: int = 5) -> None:
        self._arm: Arm | None = machine.description
        self._columns = [number - 1 for number in machine.body.joints]
        q = np.zeros(len(self._columns))
        if self._arm is not None:  # the posture in which it comes up
            q = (working_posture(self._arm) if isinstance(self._arm, RemoteCentreArm) else self._arm.home)[
                self._columns
            ]
        self.machine = machine
        self._live = LiveArm(machine, q, block=block)
        self._sensors = Sensors(machine, rng)
        self._setpoint, self._target = q, q
        self._speed = self._speed_limits()
        self._coming = 0.0  # s in which the servo's target is to be reached
        self._last_servo, self._interval = -np.inf, 0.0
        self._path = np.empty((0, len(q)))
        self.state: RobotState = "DISABLED"
        self.is_homed = False

    @property
    def time(self) -> float:
        """Session time, s."""
        return self._live.moment.time

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self._setpoint)

    @property
    def setpoint(self) -> FloatArray:
        """(dof,) joints that are commanded now, rad or m."""
        return self._setpoint

    @property
    def T_setpoint(self) -> FloatArray | None:  # noqa: N802 - a pose is named T
        """(4, 4) tool pose that is commanded now, base frame; None for bare joints."""
        return self.machine.body.forward(self._setpoint)

    @property
    def is_busy(self) -> bool:
        """Whether a move is under way."""
        return len(self._path) > 0

    @property
    def limits(self) -> FloatArray | None:
        """(dof, 2) joint limits, rad or m; None for bare joints."""
        return None if self._arm is None else self._arm.limits[self._columns]

    def read(self, *, tracked: bool = True) -> Reading:
        """Return what the sensors say now.

        Parameters
        ----------
        tracked : bool, whether the tracker is asked, which takes longest
        """
        here = self._live.moment
        seen = self._sensors.read(here.motion, here.torque, here.q, here.tip if tracked else None)
        return Reading(
            time=here.time,
            position=seen.measured_jp[0, 0],
            velocity=seen.measured_jv[0, 0],
            effort=seen.measured_jf[0, 0],
            external=seen.external_jp[0, 0],
            tracker=None if seen.T_tracker_marker is None else seen.T_tracker_marker[0, 0],
        )

    def poses_of(self, q: FloatArray) -> FloatArray | None:
        """Return the tool poses `(n, 4, 4)` that nominal kinematics give; None for bare joints.

        Parameters
        ----------
        q : (n, dof) array, joints, rad or m
        """
        return self.machine.body.forward(q)

    def operate(self, command: str) -> None:
        """Change the operating state: enable, disable, pause, resume, home, unhome.

        Parameters
        ----------
        command : str

        Raises
        ------
        DataError
            There is no such command, or the state does not allow it.
        """
        match command, self.state:
            case "enable", ("DISABLED" | "FAULT"):
                self.state = "ENABLED"
            case "disable", _:
                self.state = "DISABLED"
            case "pause", "ENABLED":
                self.state = "PAUSED"
            case "resume", "PAUSED":
                self.state = "ENABLED"
            case "home", "ENABLED":
                self.is_homed = True
            case "unhome", _:
                self.is_homed = False
            case _ if command in COMMANDS:
                raise DataError(f"a robot that is {self.state} cannot {command}.")
            case _:
                raise DataError(f"a robot knows {', '.join(COMMANDS)}; got {command!r}.")
        if command != "resume":
            self._path, self._target, self._coming = self._path[:0], self._setpoint, 0.0  # stay

    def servo_jp(self, q: FloatArray) -> None:
        """Go to joints at once: one of a stream of commands.

        Parameters
        ----------
        q : (dof,) array, rad or m

        Raises
        ------
        DataError
            The robot is not enabled and homed, the joints are beyond their limits, or too far to reach in time.
        """
        self._check_ready()
        self._check_limits(q)
        apart = np.abs(q - self._setpoint) / self._speed
        since, self._last_servo = self.time - self._last_servo, self.time
        if since <= HOLD and apart.max() > HASTE * HOLD:
            j = int(np.argmax(apart))
            raise DataError(
                f"joint {j + 1} would have to jump by {q[j] - self._setpoint[j]:.4g}.",
                hint="Send servo commands closer together, or use a move command.",
            )
        # Of a stream each command is reached when the next one comes; the first one at the speed limit.
        self._interval = 0.8 * self._interval + 0.2 * since if since <= HOLD else 0.0
        self._path = self._path[:0]
        self._target = np.array(q)
        self._coming = max(self._interval or float(apart.max()), since if since <= HOLD else 0.0, self._live.step)

    def move_jp(self, q: FloatArray) -> None:
        """Go to joints smoothly, within the speed limits.

        Parameters
        ----------
        q : (dof,) array, rad or m

        Raises
        ------
        DataError
            The robot is not enabled and homed, or the joints are beyond their limits.
        """
        self._check_ready()
        self._check_limits(q)
        duration = PEAK * float((np.abs(q - self._setpoint) / self._speed).max())
        fraction = minimum_jerk(max(duration, 0.05), 1.0 / self._live.step)[1:, None]
        self._path = self._setpoint + fraction * (q - self._setpoint)

    def servo_cp(self, T: FloatArray) -> None:
        """Go to a tool pose at once.

        Parameters
        ----------
        T : (4, 4) array, tool pose, base frame

        Raises
        ------
        DataError
            As for :meth:`servo_jp`, or the pose cannot be reached.
        """
        self.servo_jp(self._inverse(T[None])[-1])

    def move_cp(self, T: FloatArray) -> None:
        """Go to a tool pose in a straight line.

        Parameters
        ----------
        T : (4, 4) array, tool pose, base frame

        Raises
        ------
        DataError
            As for :meth:`move_jp`, or a pose on the way cannot be reached.
        """
        self._check_ready()
        here = self.T_setpoint
        if here is None:
            raise DataError("bare joints have no tool to move.", hint="Use move_jp.")
        path = tour(np.stack([here, T]), [0], [CARTESIAN], MOVE_RATE_HZ)
        q = self._inverse(path.T_base_tip)
        self._check_limits(q)
        at = np.arange(1, round((len(q) - 1) / MOVE_RATE_HZ / self._live.step) + 1) * self._live.step * MOVE_RATE_HZ
        self._path = np.stack([np.interp(at, np.arange(len(q)), q[:, j]) for j in range(q.shape[1])], axis=1)

    def advance(self, seconds: float) -> None:
        """Let time pass.

        Parameters
        ----------
        seconds : float, rounded to whole servo steps, at least one
        """
        steps = max(1, round(seconds / self._live.step))
        desired = np.repeat(self._setpoint[None], steps, axis=0)
        if self.state == "ENABLED":
            desired = self._desired(steps)
        self._setpoint = desired[-1]
        self._live.advance(desired)

    def _desired(self, steps: int) -> FloatArray:
        if len(self._path):
            now, self._path = self._path[:steps], self._path[steps:]
            self._target = now[-1] if not len(self._path) else self._target
            return np.concatenate([now, np.repeat(now[-1:], steps - len(now), axis=0)])
        if self._coming <= 0.0:
            return np.repeat(self._setpoint[None], steps, axis=0)
        fraction = np.minimum(np.arange(1, steps + 1) * self._live.step / self._coming, 1.0)[:, None]
        self._coming = max(0.0, self._coming - steps * self._live.step)
        path: FloatArray = self._setpoint + fraction * (self._target - self._setpoint)
        return path

    def _check_ready(self) -> None:
        if self.state != "ENABLED" or not self.is_homed:
            homed = "homed" if self.is_homed else "not homed"
            raise DataError(f"the robot is {self.state} and {homed}: it does not move.", hint="Send enable, then home.")

    def _check_limits(self, q: FloatArray) -> None:
        if np.shape(q)[-1] != self.dof or not np.isfinite(q).all():
            raise DataError(f"the robot has {self.dof} joints, got {np.shape(q)[-1]} numbers, all of them finite.")
        if self.limits is None:
            return
        beyond = ((q < self.limits[:, 0] - 1e-9) | (q > self.limits[:, 1] + 1e-9)).reshape(-1, self.dof).any(axis=0)
        if beyond.any():
            numbers = ", ".join(str(j + 1) for j in np.flatnonzero(beyond))
            raise DataError(
                f"joint {numbers} would go beyond its limits.", hint="Command a place inside the workspace."
            )

    def _inverse(self, T: FloatArray) -> FloatArray:
        """Joint path of tool poses `(n, 4, 4)` that goes on from where the arm is."""
        if self._arm is None or len(self._columns) != self._arm.dof:
            raise DataError("this machine does not move all joints of an arm: it takes joints, not poses.")
        if not isinstance(self._arm, RemoteCentreArm):
            return self._arm.follow(T, self._setpoint)
        found = self._arm.solutions(T)
        apart = np.abs(found.q[0] - self._setpoint).max(axis=-1)
        usable = np.flatnonzero(found.within_limits.all(axis=0))
        if not len(usable):
            raise DataError(f"{self._arm.name} cannot reach this pose.", hint="Move it into the workspace.")
        return found.q[:, usable[np.argmin(apart[usable])]]

    def _speed_limits(self) -> FloatArray:
        if self._arm is None:
            return np.full(self.dof, 0.5)
        published = self._arm.velocity_limits
        speed = UNRATED * np.ptp(self._arm.limits, axis=1) if published is None else np.array(published)
        return speed[self._columns]
