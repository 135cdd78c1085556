"""The correction before a robot's own `servo_cp`: desired poses in, commands out, or a refusal with its reason.

No network here; see `filter_server`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import Correction, FloatArray
from gpcorrect_service.crtk.messages import OperatingState, Pose, Report, checked_stamp
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.limits import check_answer, checked_pose, checked_twist, position_limit
from gpcorrect_service.server.models import Model

__all__ = ["Prefilter", "PrefilterSettings", "StreamingCorrector"]

POSE = 7


class CorrectionStreamLike(Protocol):
    """See :class:`gpcorrect.corrector.CorrectionStream`."""

    def correct(self, time: float, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for a pose at a time."""

    def reset(self) -> None:
        """Forget the past."""


class StreamingCorrector(Protocol):
    """A corrector that answers streams as well as single poses."""

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for one pose at rest, or with its twist."""

    def stream(self) -> CorrectionStreamLike:
        """Return a stream of poses one after the other."""


@dataclass(frozen=True)
class PrefilterSettings:
    """What the pre-filter allows.

    Parameters
    ----------
    linear, angular : float
        How much faster a command may change than the desired pose does, m/s and rad/s: the correction's own speed.
    gap : float
        s between two servo commands after which the stream begins anew.
    state_age : float
        s of the robot's clock for which its last operating state is believed.
    frame : str
        Name of the frame that commands are in.
    outside : bool
        Whether poses out of the model's domain are passed on at all.
    """

    linear: float = 0.05
    angular: float = 1.0
    gap: float = 0.5
    state_age: float = 1.0
    frame: str = "base"
    outside: bool = True


class Prefilter:
    """Corrects one arm's stream of desired poses.

    Parameters
    ----------
    model : Model
        Name and hash that reports carry.
    corrector : StreamingCorrector
    settings : PrefilterSettings
    reference : callable, optional
        From a desired pose (7,) to what registration alone would command; told in reports.
    monotonic : callable
        Clock for serving times, s.
    """

    def __init__(
        self,
        model: Model,
        corrector: StreamingCorrector,
        settings: PrefilterSettings | None = None,
        *,
        reference: Callable[[FloatArray], FloatArray] | None = None,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._model, self._corrector = model, corrector
        self._settings = settings or PrefilterSettings()
        self._monotonic, self._reference = monotonic, reference
        self._limit = position_limit(model.corrector.info())
        self._stream = corrector.stream()
        self._state: OperatingState | None = None
        self._last: _Step | None = None

    def robot_is(self, state: OperatingState) -> None:
        """Take note of the robot's operating state."""
        if not _ready(state):
            self._last = None
        self._state = state

    def servo(self, message: Pose) -> tuple[Pose, Report]:
        """Return the command for one of a stream of desired poses, and what was made of it.

        Raises
        ------
        ServiceError
            BAD_INPUT: no stamp, no pose, not later than the one before. STALE: the robot is not known to be ready.
            INTERNAL: the command is not fit to be sent.
        """
        began = self._monotonic()
        pose, twist = self._checked(message)
        if self._last is not None and message.stamp - self._last.stamp > self._settings.gap:
            self._last = None
        if self._last is None:
            self._stream.reset()
        elif message.stamp <= self._last.stamp:
            raise ServiceError(
                "BAD_INPUT",
                f"a pose stamped {message.stamp:.6f} came after one stamped {self._last.stamp:.6f}.",
                hint="Send every pose once, in order.",
            )
        answer = self._ask(lambda: self._stream.correct(message.stamp, pose, twist))
        command, status, reason = self._bounded(message.stamp, pose, answer)
        self._last = _Step(message.stamp, pose, command)
        return self._said(message, pose, command, answer, status, reason, began)

    def move(self, message: Pose) -> tuple[Pose, Report]:
        """Return the command for one desired pose at rest, and what was made of it.

        Raises
        ------
        ServiceError
            As for :meth:`servo`.
        """
        began = self._monotonic()
        pose, _ = self._checked(message)
        answer = self._ask(lambda: self._corrector.correct(pose, np.zeros(6)))
        self._last = None
        return self._said(message, pose, _pose(answer), answer, answer.status, answer.reason, began)

    def _ask(self, question: Callable[[], Correction]) -> Correction:
        try:
            answer = question()
        except DataError as error:
            raise ServiceError("BAD_INPUT", error.message, hint=error.hint) from error
        if answer.quaternion is None:
            raise ServiceError("NO_MODEL", "this model corrects positions only.", hint="Fit one to full poses.")
        if not answer.in_domain and not self._settings.outside:
            raise ServiceError("BAD_INPUT", "the pose is out of the model's domain.", hint="Stay near the training.")
        return answer

    def _checked(self, message: Pose) -> tuple[FloatArray, FloatArray | None]:
        self._check_ready(checked_stamp(message.stamp))
        if len(message.pose) != POSE:
            raise ServiceError("BAD_INPUT", f"a pose is 7 numbers (x y z qw qx qy qz), got {len(message.pose)}.")
        return checked_pose(message.pose, self._limit), checked_twist(message.twist)

    def _check_ready(self, stamp: float) -> None:
        state = self._state
        if state is None or stamp - state.stamp > self._settings.state_age:
            raise ServiceError(
                "STALE", "the robot's operating state is not known.", hint="Is the robot running and connected?"
            )
        if not _ready(state):
            homed = "homed" if state.is_homed else "not homed"
            raise ServiceError("STALE", f"the robot is {state.state} and {homed}.", hint="Enable and home it first.")

    def _bounded(self, stamp: float, pose: FloatArray, answer: Correction) -> tuple[FloatArray, str, str]:
        """Let the command change no faster than the desired pose does, and the correction's own speed on top."""
        command, last = _pose(answer), self._last
        if last is None:
            return command, answer.status, answer.reason
        seconds = stamp - last.stamp
        linear = float(np.linalg.norm(pose[:3] - last.desired[:3])) + self._settings.linear * seconds
        angular = _angle(pose, last.desired) + self._settings.angular * seconds
        share = min(
            1.0,
            linear / max(float(np.linalg.norm(command[:3] - last.command[:3])), 1e-12),
            angular / max(_angle(command, last.command), 1e-12),
        )
        if share >= 1.0:
            return command, answer.status, answer.reason
        begin, end = (se3.from_parts(p[:3], p[3:]) for p in (last.command, command))
        turn = se3.rotvec_from_matrix(end[:3, :3] @ begin[:3, :3].T)
        T = se3.pose(se3.matrix_from_rotvec(share * turn) @ begin[:3, :3], begin[:3, 3] + share * (end - begin)[:3, 3])
        return np.concatenate(se3.to_parts(T)), "LIMITED", "the command changed faster than the pre-filter allows"

    def _said(
        self,
        message: Pose,
        pose: FloatArray,
        command: FloatArray,
        answer: Correction,
        status: str,
        reason: str,
        began: float,
    ) -> tuple[Pose, Report]:
        numbers = command.tolist()
        check_answer(numbers[:3], numbers[3:], self._limit)
        out = Pose(message.stamp, tuple(numbers), self._settings.frame)
        report = Report(
            message.stamp,
            tuple(pose.tolist()),
            tuple(numbers),
            _gaps(answer.std),
            _gaps(answer.interval95),
            bool(answer.in_domain),
            status,
            reason,
            self._monotonic() - began,
            self._model.id,
            self._model.hash,
            None if self._reference is None else tuple(self._reference(pose).tolist()),
        )
        return out, report


@dataclass(frozen=True, eq=False)
class _Step:
    stamp: float
    desired: FloatArray
    command: FloatArray


def _ready(state: OperatingState) -> bool:
    return state.state == "ENABLED" and state.is_homed


def _pose(answer: Correction) -> FloatArray:
    assert answer.quaternion is not None
    return np.concatenate([answer.position, answer.quaternion])


def _angle(one: FloatArray, other: FloatArray) -> float:
    return 2.0 * math.acos(min(1.0, abs(float(one[3:] @ other[3:]))))


def _gaps(values: FloatArray) -> tuple[float | None, ...]:
    return tuple(value if math.isfinite(value) else None for value in values.tolist())
