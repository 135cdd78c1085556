"""An arm that speaks CRTK over zenoh: commands in, state out, at its own rate.

zenoh's callbacks only queue; one thread takes the commands, lets the arm's time pass, and publishes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import GpCorrectError
from gpcorrect.types import FloatArray
from gpcorrect_service.crtk.bus import Bus
from gpcorrect_service.crtk.messages import Heartbeat, JointState, OperatingState, Pose, Text, checked_numbers
from gpcorrect_service.protocol.bounds import OLDEST
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.limits import LIMITS, checked_pose, checked_stamp

STATE_HZ = 10.0  # chosen by hand: fast enough for people
BEAT_HZ = 2.0  # chosen by hand: who listens notices within a second that it ended
TRACKER_HZ = 100.0  # of the tracker and the outside encoders
BASE, TRACKER = "base", "tracker"  # names of the frames that poses are in
BEHIND = 0.5  # chosen by hand: s of wall time after which lost ticks are given up instead of caught up with


@dataclass(frozen=True)
class ArmServerSettings:
    """How an arm is served.

    Parameters
    ----------
    rate_hz : float, state messages a second of the arm's clock
    time_scale : float
        Seconds of the arm's clock in one of the wall's: above 1 a simulated arm runs faster than a real one.
    corrected : bool
        Take Cartesian commands from the pre-filter (`corrected/servo_cp`) and not from planners (`servo_cp`).
    command_age : float, s of wall time after which a corrected pose no longer moves the arm
    """

    rate_hz: float = 100.0
    time_scale: float = 1.0
    corrected: bool = False
    command_age: float = OLDEST


class ArmServer:
    """Serves one arm until it is stopped.

    Parameters
    ----------
    arm : object
        With the commands and the state of `gpcorrect.sim.live_robot.LiveRobot`, which a server must not import.
    bus : Bus
    settings : ArmServerSettings
    epoch : float, stamp at the arm's time 0, s since 1970
    """

    def __init__(self, arm: Any, bus: Bus, settings: ArmServerSettings, epoch: float) -> None:
        self._arm, self._bus, self._settings, self._epoch = arm, bus, settings, epoch
        self._orders: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._late = 0
        prefix = "corrected/" if settings.corrected else ""
        for name, act in (("servo_jp", arm.servo_jp), ("move_jp", arm.move_jp)):
            self._obey_topic(name, self._joints, act)
        for name, act in (("servo_cp", arm.servo_cp), ("move_cp", arm.move_cp)):
            self._obey_topic(prefix + name, self._pose, act)
        self._obey_topic("state_command", lambda message: message.string, arm.operate)

    def run(self, stop: threading.Event) -> None:
        """Let the arm live until it is stopped.

        Parameters
        ----------
        stop : threading.Event
        """
        period = 1.0 / self._settings.rate_hz
        tick, due = 0, time.monotonic()
        while not stop.is_set():
            self._obey()
            self._arm.advance(period)
            self._publish(tick)
            tick += 1
            due += period / self._settings.time_scale
            ahead = due - time.monotonic()
            if ahead > 0:
                stop.wait(ahead)
                continue
            self._late += 1
            if ahead <= -BEHIND:  # far too late: the time that was lost is given up
                due = time.monotonic()

    def _obey_topic(self, name: str, read: Callable[..., object], act: Callable[..., None]) -> None:
        def _refused(error: GpCorrectError) -> None:
            def _raise() -> None:
                raise error

            self._orders.put(_raise)

        self._bus.subscribe(name, lambda message: self._orders.put(lambda: act(read(message))), _refused)

    def _obey(self) -> None:
        """Do what was commanded since the last tick; what is refused is published on `error`."""
        while True:
            try:
                order = self._orders.get_nowait()
            except Empty:
                return
            try:
                order()
            except GpCorrectError as error:
                self._bus.publish("error", Text(self._stamp(), str(error)))

    def _joints(self, message: JointState) -> FloatArray:
        checked_stamp(message.stamp)
        return np.array(checked_numbers(message.position, len(self._arm.setpoint), "joints"))

    def _pose(self, message: Pose) -> FloatArray:
        age = (self._stamp() - checked_stamp(message.stamp)) / self._settings.time_scale
        if self._settings.corrected and age > self._settings.command_age:
            raise ServiceError("STALE", f"the pose is {age:.2f} s old.", hint="Was the pre-filter held up?")
        numbers = checked_pose(checked_numbers(message.pose, 7, "a pose (x y z qw qx qy qz)"), LIMITS.room)
        return se3.from_parts(numbers[:3], numbers[3:])

    def _stamp(self) -> float:
        stamp: float = self._epoch + self._arm.time
        return stamp

    def _publish(self, tick: int) -> None:
        bus, arm, settings, stamp = self._bus, self._arm, self._settings, self._stamp()
        tracked = self._every(tick, TRACKER_HZ)
        seen, setpoint = arm.read(tracked=tracked), arm.setpoint
        bus.publish("measured_js", JointState(stamp, _row(seen.position), _row(seen.velocity), _row(seen.effort)))
        bus.publish("setpoint_js", JointState(stamp, _row(setpoint)))
        poses = arm.poses_of(np.stack([seen.position, setpoint]))
        if poses is not None:
            self._publish_pose("measured_cp", stamp, poses[0], BASE)
            self._publish_pose("setpoint_cp", stamp, poses[1], BASE)
        if tracked:
            bus.publish("external_js", JointState(stamp, _row(seen.external)))
            self._publish_pose("tracker_cp", stamp, seen.tracker, TRACKER)
        if self._every(tick, STATE_HZ):
            bus.publish("operating_state", OperatingState(stamp, arm.state, arm.is_homed, arm.is_busy))
        if self._every(tick, BEAT_HZ):
            bus.publish("heartbeat", Heartbeat(stamp, settings.rate_hz, self._late))

    def _every(self, tick: int, rate_hz: float) -> bool:
        return tick % max(1, round(self._settings.rate_hz / rate_hz)) == 0

    def _publish_pose(self, name: str, stamp: float, T: FloatArray | None, frame: str) -> None:
        if T is not None:
            position, quaternion = se3.to_parts(T)
            self._bus.publish(name, Pose(stamp, (*position.tolist(), *quaternion.tolist()), frame))


def _row(values: FloatArray) -> tuple[float, ...]:
    return tuple(values.tolist())
