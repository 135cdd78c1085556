"""The other side of an arm's topics: what a program that moves a robot needs, and how fast it may stream a path."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import partial
from typing import Any

import numpy as np

from gpcorrect.errors import DataError, GpCorrectError
from gpcorrect.types import FloatArray
from gpcorrect_service.crtk.bus import Bus, BusSettings
from gpcorrect_service.crtk.messages import Event, JointState, OperatingState, Pose, Text

LONGEST_STEP = 0.08  # chosen by hand: s of a path between two commands
LONGEST_LEAD = 0.2  # chosen by hand: s of a path from where the robot is to a command; our arm refuses 0.3
GRAIN = 0.005  # chosen by hand: s of a path between two places at which the robot is looked for
ALIKE = 0.01  # chosen by hand: s at the path's top speed; places nearer to each other than that are one
RESTED = 0.5  # chosen by hand: s of the robot's clock after the last command: who is where it says has obeyed it
TINY = 1e-9  # s at the path's top speed: rounding
FLOOR = 1e-6  # rad/s or m/s: the top speed of a joint that rests

# State commands, and whether a state obeys them.
OPERATIONS: dict[str, Callable[[OperatingState], bool]] = {
    "enable": lambda state: state.state == "ENABLED",
    "disable": lambda state: state.state == "DISABLED",
    "pause": lambda state: state.state == "PAUSED",
    "resume": lambda state: state.state == "ENABLED",
    "home": lambda state: state.is_homed,
    "unhome": lambda state: not state.is_homed,
}

PATIENCE = 10.0  # chosen by hand: s for a robot to say or obey, on a machine that is busy with other things as well
NO_TRAJECTORY = -1  # in events: between trajectories
POLL = 0.002  # s, chosen by hand
NEAR = 1e-6  # chosen by hand: rad or m from a goal that count as there
STALLED = 5.0  # chosen by hand: s of wall time without a state message after which a robot counts as gone


class Pacing:
    """Moments of a path as the robot's clock goes, none too far ahead of the robot.

    A tool that its machine held up goes on where it was: the path takes longer, and nothing jumps. States that waited
    meanwhile come all at once after it, and so may the commands for them at the robot: none is further along the path
    than `LONGEST_LEAD` from where the latest setpoint shows that the robot has come. Where the path has been at that
    setpoint more than once since, as at a corner, that is the first time.

    Parameters
    ----------
    times : (n,) array, s
    clock : float, the robot's, as it begins, s
    q : (n, k) array, optional, joints of the path, rad or m; without them the robot's clock alone sets the pace
    """

    def __init__(self, times: FloatArray, clock: float, q: FloatArray | None = None) -> None:
        self.moment = self._seen = float(times[0])
        self._end, self._clock, self._sent, self._times, self._q = float(times[-1]), clock, clock, times, q
        if q is not None:
            self._fastest = np.abs(np.diff(q, axis=0) / np.diff(times)[:, None]).max(axis=0, initial=FLOOR)

    @property
    def is_over(self) -> bool:
        """Whether the moment is the path's last."""
        return self.moment >= self._end

    @property
    def joints(self) -> FloatArray:
        """(k,) joints at the moment."""
        return np.asarray(self._joints_at(np.array([self.moment]))[0])

    def advance(self, clock: float, setpoint: FloatArray) -> None:
        """Go on to the moment for the next command; it stays while the robot has yet to come nearer.

        Parameters
        ----------
        clock : float, stamp of the robot's latest state, s
        setpoint : (k,) array, that state's joints
        """
        passed, self._clock = clock - self._clock, clock
        there = self.moment if self._q is None else self._come_to(setpoint)
        further = min(self.moment + min(passed, LONGEST_STEP), there + LONGEST_LEAD, self._end)
        if further > self.moment:
            self.moment, self._sent = further, clock

    def _come_to(self, setpoint: FloatArray) -> float:
        """Return the end of the first stretch of the path, from where the robot was seen on, that lies about it."""
        moments = np.linspace(self._seen, self.moment, 1 + math.ceil((self.moment - self._seen) / GRAIN))
        apart = (np.abs(self._joints_at(moments) - setpoint) / self._fastest).sum(axis=1)
        if apart[-1] <= ALIKE and self._clock > self._sent + RESTED:
            self._seen = self.moment
            return self.moment
        near = apart <= apart.min() + ALIKE
        first = int(near.argmax())
        stretch = apart[first : first + int(np.append(~near[first:], True).argmax())]
        # The last of the nearest, so that a long rest of the path is not gone over again and again.
        self._seen = float(moments[first + np.flatnonzero(stretch <= stretch.min() + TINY)[-1]])
        return float(moments[first + len(stretch) - 1])

    def _joints_at(self, moments: FloatArray) -> FloatArray:
        assert self._q is not None
        return np.stack([np.interp(moments, self._times, column) for column in self._q.T], axis=1)


class RobotError(GpCorrectError):
    """A robot that is not there, does not obey, or says why it cannot."""


class Robot(AbstractContextManager["Robot"]):
    """Commands one arm and knows its latest state, by its topics on `bus`; a context manager.

    Parameters
    ----------
    settings : BusSettings
    patience : float, seconds, wall time, to wait for the arm's first state and for each change of its operating state

    Raises
    ------
    EndpointError, RobotError
        Nobody listens there; no arm of that name publishes its state.
    """

    def __init__(self, settings: BusSettings, patience: float = PATIENCE) -> None:
        self.bus = Bus(settings, node="gpcorrect_tool")
        self._patience = patience
        self._latest: dict[str, Any] = {}
        self._latest_at = time.monotonic()
        self._fresh = threading.Condition()
        self._errors: list[str] = []
        for name in ("measured_js", "setpoint_js", "setpoint_cp", "operating_state"):
            self.bus.subscribe(name, partial(self._note, name))
        self.bus.subscribe("error", self._complain)
        try:
            self._until(lambda: {"setpoint_js", "operating_state"} <= self._latest.keys(), patience, "say its state")
        except RobotError:
            self.bus.close()
            raise

    def __exit__(self, *_: object) -> None:
        self.bus.close()

    @property
    def time(self) -> float:
        """The robot's clock: the stamp of its latest state, s."""
        stamp: float = self._latest["setpoint_js"].stamp
        return stamp

    @property
    def state(self) -> OperatingState:
        """Latest operating state."""
        state: OperatingState = self._latest["operating_state"]
        return state

    @property
    def setpoint(self) -> FloatArray:
        """(dof,) joints that are commanded, rad or m."""
        return np.array(self._latest["setpoint_js"].position)

    @property
    def measured(self) -> FloatArray:
        """(dof,) joints that the robot reports, as soon as it does; RobotError where it never does."""
        self._until(lambda: "measured_js" in self._latest, self._patience, "report its joints")
        return np.array(self._latest["measured_js"].position)

    @property
    def setpoint_pose(self) -> FloatArray | None:
        """(7,) tool pose that is commanded, base frame; None where the robot says none with its joints."""
        until = self.time + RESTED
        with suppress(RobotError):
            self._until(lambda: "setpoint_cp" in self._latest or self.time > until, self._patience, "say its pose")
        pose: Pose | None = self._latest.get("setpoint_cp")
        return None if pose is None else np.array(pose.pose)

    def make_ready(self) -> None:
        """Enable and home; RobotError where it does not."""
        if self.state.state != "ENABLED":
            self.operate("resume" if self.state.state == "PAUSED" else "enable")
        if not self.state.is_homed:
            self.operate("home")

    def operate(self, command: str) -> None:
        """Send a state command, and wait until the robot's state obeys it; RobotError where it does not.

        Parameters
        ----------
        command : str, one of `OPERATIONS`; DataError for another
        """
        obeyed = OPERATIONS.get(command)
        if obeyed is None:
            raise DataError(f"a robot has no state command {command!r}.", hint=f"Say one of {', '.join(OPERATIONS)}.")
        self._errors.clear()
        self.bus.publish("state_command", Text(self.time, command))
        self._until(lambda: obeyed(self.state), self._patience, f"obey {command}")

    def servo_jp(self, q: FloatArray) -> None:
        """Send one of a stream of joint commands.

        Parameters
        ----------
        q : (dof,) array, rad or m
        """
        self.bus.publish("servo_jp", JointState(self.time, tuple(q.tolist())))

    def servo_cp(self, pose: FloatArray, frame: str = "") -> None:
        """Send one of a stream of poses.

        Parameters
        ----------
        pose : (7,) array
        frame : str, the base's, or the planner's where a pre-filter listens
        """
        self.bus.publish("servo_cp", Pose(self.time, tuple(pose.tolist()), frame))

    def move_jp(self, q: FloatArray) -> None:
        """Go to joints and wait until the robot is there; RobotError where it says why it cannot, or stops elsewhere.

        Parameters
        ----------
        q : (dof,) array, rad or m
        """
        self._errors.clear()
        what = f"go to {np.round(q, 4).tolist()}"

        self.bus.publish("move_jp", JointState(self.time, tuple(q.tolist())))
        # A lost command, a lost complaint and a stop elsewhere all look like a robot at rest: none is waited for long.
        self._until(lambda: self._is_at(q) or self.state.is_busy or bool(self._errors), self._patience, what)
        self._until(lambda: self._is_at(q) or not (self.state.is_busy or self._errors), None, what)
        self._until(lambda: self._is_at(q), self._patience, what)

    def _is_at(self, q: FloatArray) -> bool:
        return bool(np.abs(self.setpoint - q).max() < NEAR)

    def rest(self) -> None:
        """Wait until the move that was sent last is over; one that is not begun within the patience was none."""
        with suppress(RobotError):
            self._until(lambda: self.state.is_busy or bool(self._errors), self._patience, "begin to move")
        self._until(lambda: not self.state.is_busy, None, "come to rest")

    def follow(self, times: FloatArray, q: FloatArray, trajectory: int = 0) -> None:
        """Go to the start of a path of the first joints, then stream it on the robot's own clock; the others stay.

        A path takes longer, and is not cut short, where this process or the robot is held up: :class:`Pacing`.

        Parameters
        ----------
        times : (n,) array, s
        q : (n, k) array, rad or m; DataError where the path has more joints than the robot
        trajectory : int, number that recorders give the samples of this path
        """
        here = self.setpoint
        if q.shape[1] > len(here):
            raise DataError(f"the path has {q.shape[1]} joints, the robot {len(here)}.")
        q = np.hstack([q, np.tile(here[q.shape[1] :], (len(q), 1))])
        self.move_jp(q[0])
        self._mark(trajectory)
        pacing = Pacing(times, self.time, q)
        self.servo_jp(pacing.joints)
        while not pacing.is_over:
            self._advance(pacing)
            self.servo_jp(pacing.joints)
        # The last sample is streamed once more, to be there before the mark that ends the trajectory.
        self._until(lambda: self._is_at(q[-1]), self._patience, "reach the path's end")
        self._mark(NO_TRAJECTORY)

    def follow_poses(self, times: FloatArray, poses: FloatArray, frame: str) -> None:
        """Stream a path of desired poses on the robot's own clock, each as it stands.

        Parameters
        ----------
        times : (n,) array, s
        poses : (n, 7) array
        frame : str
        """
        pacing, last = Pacing(times, self.time), 0
        self.servo_cp(poses[0], frame)
        while not pacing.is_over:
            self._advance(pacing)
            last = max(0, int(np.searchsorted(times, pacing.moment, side="right")) - 1)
            self.servo_cp(poses[last], frame)

    def _advance(self, pacing: Pacing) -> None:
        """Wait for the robot's next state, and go on by it."""
        before = self.time
        self._until(lambda: self.time > before, None, "go on")
        state: JointState = self._latest["setpoint_js"]
        pacing.advance(state.stamp, np.array(state.position))

    def _mark(self, trajectory: int) -> None:
        self.bus.publish("event", Event(self.time, trajectory))

    def _until(self, done: Callable[[], bool], patience: float | None, what: str) -> None:
        """Wait until something holds: at most `patience` seconds; without, while the robot is alive and content."""
        until = np.inf if patience is None else time.monotonic() + patience
        with self._fresh:
            while not done():
                if self._errors and patience is None:
                    raise RobotError(f"the robot does not {what}: {self._errors[-1]}")
                now = time.monotonic()
                if now > until or now > self._latest_at + STALLED:
                    where = f"{self.bus.settings.namespace}/{self.bus.settings.arm} on {self.bus.settings.where}"
                    said = f" It said: {self._errors[-1]}" if self._errors else ""
                    hint = "Is it running, with this arm and namespace?"
                    raise RobotError(f"the robot at {where} does not {what}.{said}", hint=hint)
                self._fresh.wait(POLL if patience is not None else 0.1)

    def _note(self, name: str, message: Any) -> None:
        with self._fresh:
            self._latest[name] = message
            self._latest_at = time.monotonic()
            self._fresh.notify_all()

    def _complain(self, message: Text) -> None:
        with self._fresh:
            self._errors.append(message.string)
            self._fresh.notify_all()
