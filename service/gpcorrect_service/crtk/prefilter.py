"""The correction before a robot's own `servo_cp`: desired poses in, commands out, or a refusal with its reason.

`Prefilter` knows no network; `FilterServer` gives it the arm's topics.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from queue import Empty, Full, Queue

import numpy as np

from gpcorrect import se3
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect_service.crtk.bus import Bus
from gpcorrect_service.crtk.messages import OperatingState, Pose, Report, Text
from gpcorrect_service.ops.logger import Logger
from gpcorrect_service.protocol import limits
from gpcorrect_service.protocol.answer import PoseAnswer, pack
from gpcorrect_service.protocol.bounds import OLDEST, StreamClock
from gpcorrect_service.protocol.errors import ServiceError, bad_input
from gpcorrect_service.protocol.sessions import PREFILTER
from gpcorrect_service.server.models import Model

WAITING = 64  # chosen by hand: poses that may wait; a stream that is further behind loses its oldest
SETTLING = 1.0  # chosen by hand: s in which what waited for a process that was stopped has come in
LOG_EVERY = 1000  # refusals between two lines about them in the log
CLOCK_HINT = "Where that was set back, wait for a second; where it was held up, disable and enable the robot."


Correct = Callable[[Pose], tuple[Pose, Report]]


@dataclass(frozen=True)
class PrefilterSettings:
    """What the pre-filter allows."""

    # how much faster a command may change than the desired pose does, m/s and rad/s: the correction's own speed
    linear: float = 0.05
    angular: float = 1.0
    gap: float = 0.5  # s between two servo commands after which the stream begins anew
    state_age: float = 1.0  # s for which the robot's last operating state is believed
    # s after which a desired pose no longer moves the robot. Stamps are the robot's clock: one that lies as far ahead
    # of it says nothing of its age, and is refused as well
    command_age: float = OLDEST
    # seconds of the robot's clock in one of ours; above 1 for a simulated arm that lives faster
    time_scale: float = 1.0
    frame: str = "base"  # name of the frame that commands are in
    desired_frame: str = ""  # name of the frame that desired poses come in; empty for the model's own
    outside: bool = True  # whether poses out of the model's domain are passed on at all


class Prefilter:
    """Corrects one arm's stream of desired poses; `monotonic` is the clock for ages and serving times, s."""

    def __init__(
        self,
        model: Model,
        settings: PrefilterSettings | None = None,
        *,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._model = model
        self._settings = settings or PrefilterSettings()
        self._monotonic = monotonic
        self._stream = model.corrector.stream()
        self._state: OperatingState | None = None
        self._clock = StreamClock(self._settings.time_scale)
        self._newest = self._settled_at = self._heard_at = -math.inf
        self._last: _Step | None = None
        self._lock = threading.Lock()

    def robot_is(self, state: OperatingState) -> None:
        """Take note of the robot's operating state, from any thread.

        Parameters
        ----------
        state : OperatingState
            BAD_INPUT where its stamp does not say when, so that nobody knows how old it is; it is not known then.
        """
        now = self._monotonic()
        with self._lock:
            self._state = None
            limits.checked_stamp(state.stamp)
            if not _ready(state):
                # A robot that is enabled again may have been held up, or its clock set: learned anew, and not from
                # what waited.
                self._last = None
                self._clock.reset()
                self._settled_at = now + SETTLING
            self._clock.delay(state.stamp, now)
            self._state, self._heard_at = state, now

    def servo(self, message: Pose) -> tuple[Pose, Report]:
        """Return the command for one of a stream of desired poses, and what was made of it.

        Parameters
        ----------
        message : Pose

        Raises
        ------
        ServiceError
            BAD_INPUT: no stamp, no pose, not later than the one before. STALE: the robot is not known to be ready, or
            the pose is too old. INTERNAL: the command is not fit to be sent.
        """
        began = self._monotonic()
        with self._lock:
            pose, twist = self._checked(message)
            last = self._last
            if last is not None and not 0 < message.stamp - last.stamp <= self._settings.gap:
                last = None
            if last is None:
                self._stream.reset()
            answer = self._answer(lambda: self._stream.correct(message.stamp, pose, twist))
            if last is not None:
                answer = self._bounded(last, message.stamp, pose, answer)
            reported = self._reported(message, pose, answer, began)
            self._last = _Step(message.stamp, pose, _pose(answer))
        return reported

    def move(self, message: Pose) -> tuple[Pose, Report]:
        """Return the command for one desired pose at rest, and what was made of it; raises as :meth:`servo`.

        Parameters
        ----------
        message : Pose
        """
        began = self._monotonic()
        with self._lock:
            pose, _ = self._checked(message)
            answer = self._answer(lambda: self._model.corrector.correct(pose, np.zeros(6)))
            self._last = None
            return self._reported(message, pose, answer, began)

    def _answer(self, ask: Callable[[], Correction]) -> Correction:
        try:
            answer = ask()
        except DataError as error:
            raise bad_input(error.message, error.hint) from error
        if answer.quaternion is None:
            raise ServiceError("NO_MODEL", "this model corrects positions only.", hint="Fit one to full poses.")
        if not self._settings.outside:
            limits.check_inside(answer)
        return answer

    def _checked(self, message: Pose) -> tuple[FloatArray, FloatArray | None]:
        state, now, most = self._state, self._monotonic(), self._settings.state_age
        if state is None or now - self._heard_at > most:
            hint = "Is the robot running and connected?"
            raise ServiceError("STALE", "the robot's operating state is not known.", hint=hint)
        if (age := self._clock.age(state.stamp, now)) > most:
            cause = f"the robot's operating state comes, and is stamped {age:.2f} s behind the robot's clock."
            raise ServiceError("STALE", cause, hint=CLOCK_HINT)
        if not _ready(state):
            homed = "homed" if state.is_homed else "not homed"
            raise ServiceError("STALE", f"the robot is {state.state} and {homed}.", hint="Enable and home it first.")
        self._check_age(limits.checked_stamp(message.stamp))
        # What is older than a command may be was refused above: stamps that lie further back are of a set clock.
        if 0 <= self._newest - message.stamp <= 2 * self._settings.command_age * self._settings.time_scale:
            hint = "Send every pose once, in order."
            raise bad_input(f"a pose stamped {message.stamp:.6f} came after one stamped {self._newest:.6f}.", hint)
        limits.check_frame(message.frame, self._settings.desired_frame or self._model.frames[0])
        if len(message.pose) != limits.POSE:
            what = f"a pose is 7 numbers (x y z qw qx qy qz), got {len(message.pose)}."
            raise bad_input(what, "Send metres and wxyz.")
        return limits.checked_pose(message.pose, self._model.limit), limits.checked_twist(message.twist)

    def _check_age(self, stamp: float) -> None:
        """Refuse what is too old, or stamped by another clock than the robot's; now, and not when it came."""
        now, most = self._monotonic(), self._settings.command_age
        if now < self._settled_at:
            hint = f"Wait for {SETTLING:g} s."
            raise ServiceError("STALE", "the robot has just become ready, and its clock is not known yet.", hint=hint)
        age = self._clock.age(stamp, now)
        if abs(age) > most:
            raise ServiceError(
                "STALE",
                f"the pose is stamped {abs(age):.2f} s {'behind' if age > 0 else 'ahead of'} the robot's clock; "
                f"{most:g} s are allowed.",
                hint=f"Stamp poses with the robot's clock. {CLOCK_HINT}",
            )

    def _bounded(self, last: _Step, stamp: float, pose: FloatArray, answer: Correction) -> Correction:
        """Let the command change no faster than the desired pose does, and the correction's own speed on top."""
        command, seconds = _pose(answer), stamp - last.stamp
        linear = float(np.linalg.norm(pose[:3] - last.desired[:3])) + self._settings.linear * seconds
        angular = float(se3.quaternion_angle(pose[3:], last.desired[3:])) + self._settings.angular * seconds
        fraction = min(
            1.0,
            linear / max(float(np.linalg.norm(command[:3] - last.command[:3])), 1e-12),
            angular / max(float(se3.quaternion_angle(command[3:], last.command[3:])), 1e-12),
        )
        if fraction >= 1.0:
            return answer
        begin, end = (se3.from_parts(p[:3], p[3:]) for p in (last.command, command))
        turn = se3.rotvec_from_matrix(end[:3, :3] @ begin[:3, :3].T)
        position = begin[:3, 3] + fraction * (end - begin)[:3, 3]
        T = se3.pose(se3.matrix_from_rotvec(fraction * turn) @ begin[:3, :3], position)
        position, quaternion = se3.to_parts(T)
        return replace(answer, position=position, quaternion=quaternion).because(Reason.RATE_LIMITED)

    def _reported(self, message: Pose, pose: FloatArray, answer: Correction, began: float) -> tuple[Pose, Report]:
        packed, command = pack(PoseAnswer, answer), _pose(answer).tolist()
        limits.check_command(command[:3], command[3:], self._model.limit, lambda: self._model.reference_position(pose))
        report = Report(
            stamp=message.stamp,
            desired=tuple(pose.tolist()),
            command=tuple(command),
            std=tuple(packed.std),
            interval95=tuple(packed.interval95),
            in_domain=packed.in_domain,
            status=packed.status,
            reason=packed.reason,
            seconds=self._monotonic() - began,
            model_id=self._model.id,
            model_hash=self._model.hash,
            reference=tuple(self._model.reference(pose[None])[0].tolist()),
        )
        self._check_age(message.stamp)  # the process may have been stopped since it was asked
        self._newest = message.stamp
        return Pose(message.stamp, tuple(command), self._settings.frame), report


class FilterServer:
    """Corrects an arm's commands: `servo_cp` and `move_cp` in, `corrected/...` out, refusals on `error`.

    Parameters
    ----------
    prefilter : Prefilter
    bus : Bus
        DataError where another pre-filter corrects its arm: a robot that hears both would follow two models in turn.
    logger : Logger, where refusals and dropped poses are written, the first and every thousandth
    """

    def __init__(self, prefilter: Prefilter, bus: Bus, logger: Logger) -> None:
        bus.claim(PREFILTER)
        self._prefilter, self._bus, self._logger = prefilter, bus, logger
        self._waiting: Queue[tuple[str, Correct, Pose]] = Queue(WAITING)
        self._refused = self._lost = 0
        bus.subscribe("operating_state", self._robot_is)
        for name, answer in (("servo_cp", prefilter.servo), ("move_cp", prefilter.move)):
            bus.subscribe(name, self._queueing(f"corrected/{name}", answer), lambda error: self._refuse(0.0, error))

    def run(self, stop: threading.Event) -> None:
        """Answer until stopped.

        Parameters
        ----------
        stop : threading.Event
        """
        while not stop.is_set():
            try:
                out, answer, message = self._waiting.get(timeout=0.1)
            except Empty:
                continue
            self._answer(out, answer, message)

    def _answer(self, out: str, answer: Correct, message: Pose) -> None:
        try:
            command, report = answer(message)
        except ServiceError as error:
            self._refuse(message.stamp, error)
        except Exception as error:
            self._logger.error("correction failed inside", exc_info=error)
            fault = ServiceError("INTERNAL", f"the model failed on this pose ({type(error).__name__}).")
            self._refuse(message.stamp, fault)
        else:
            self._bus.publish(out, command)
            self._bus.publish("corrected/report", report)

    def _robot_is(self, state: OperatingState) -> None:
        try:
            self._prefilter.robot_is(state)
        except ServiceError as error:
            self._refuse(0.0, error)

    def _queueing(self, out: str, answer: Correct) -> Callable[[Pose], None]:
        def _receive(message: Pose) -> None:
            # Where the queue is full the newest pose is the one that counts.
            while True:
                try:
                    self._waiting.put_nowait((out, answer, message))
                except Full:
                    with suppress(Empty):
                        self._waiting.get_nowait()
                        self._lose()
                else:
                    return

        return _receive

    def _lose(self) -> None:
        """Say that poses are not answered, since they come faster than they are."""
        if self._lost % LOG_EVERY == 0:
            self._logger.warning("oldest pose dropped, the queue is full", waiting=WAITING, dropped=self._lost + 1)
        self._lost += 1

    def _refuse(self, stamp: float, error: ServiceError) -> None:
        self._bus.publish("error", Text(stamp, str(error)))
        if self._refused % LOG_EVERY == 0:
            self._logger.warning("message refused", status=error.status, cause=error.message, refused=self._refused + 1)
        self._refused += 1


@dataclass(frozen=True, eq=False)
class _Step:
    stamp: float
    desired: FloatArray
    command: FloatArray


def _ready(state: OperatingState) -> bool:
    return state.state == "ENABLED" and state.is_homed


def _pose(answer: Correction) -> FloatArray:
    assert answer.position is not None
    assert answer.quaternion is not None
    return np.concatenate([answer.position, answer.quaternion])
