"""CRTK's messages as they travel on native keys: strict structs in MessagePack or JSON.

SI; poses are `x y z qw qx qy qz`; stamps are the robot's clock in s, and never 0 (https://crtk-robotics.readthedocs.io).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import msgspec

from gpcorrect_service.protocol.errors import ServiceError

__all__ = ["STATES", "Event", "Heartbeat", "JointState", "Message", "OperatingState", "Pose", "Report", "State", "Text"]

State = Literal["DISABLED", "ENABLED", "PAUSED", "FAULT"]
STATES: tuple[State, ...] = ("DISABLED", "ENABLED", "PAUSED", "FAULT")
Numbers = tuple[float, ...]


class JointState(msgspec.Struct, frozen=True):
    """Joints: what `measured_js`, `setpoint_js`, `servo_jp` and `move_jp` carry; rad or m, a second, N m or N."""

    stamp: float
    position: Numbers
    velocity: Numbers | None = None
    effort: Numbers | None = None
    session: int = 0


class Pose(msgspec.Struct, frozen=True):
    """A pose: what `measured_cp`, `setpoint_cp`, `tracker_cp`, `servo_cp` and `move_cp` carry; a twist where known."""

    stamp: float
    pose: Numbers
    frame: str = ""
    twist: Numbers | None = None


class OperatingState(msgspec.Struct, frozen=True):
    """CRTK's operating state."""

    stamp: float
    state: State
    is_homed: bool
    is_busy: bool


class Text(msgspec.Struct, frozen=True):
    """A word or a sentence: `state_command`, `error`, `warning`."""

    stamp: float
    string: str


class Event(msgspec.Struct, frozen=True):
    """What a tool says of its motion, so that a recorder knows: trajectory numbers from 0, -1 between them."""

    stamp: float
    trajectory: int


class Heartbeat(msgspec.Struct, frozen=True):
    """That the arm is alive: how fast it runs, Hz on its own clock, and how many ticks came late so far."""

    stamp: float
    rate: float
    late: int


class Report(msgspec.Struct, frozen=True):
    """What the pre-filter made of a desired pose: both poses, and how sure the correction is.

    `reference` is what registration alone would command: the correction is the command less that.
    """

    stamp: float
    desired: Numbers
    command: Numbers
    std: tuple[float | None, ...]
    interval95: tuple[float | None, ...]
    in_domain: bool
    status: str
    reason: str
    seconds: float
    model_id: str
    model_hash: str
    reference: Numbers | None = None


Message = JointState | Pose | OperatingState | Text | Event | Heartbeat | Report


def checked_stamp(stamp: float) -> float:
    """Return a stamp that says when.

    Raises
    ------
    ServiceError
        BAD_INPUT: it is 0, negative or not finite.
    """
    if not (math.isfinite(stamp) and stamp > 0):
        raise ServiceError("BAD_INPUT", f"the stamp is {stamp}.", hint="Stamp messages with the robot's clock, s.")
    return stamp


def checked_numbers(numbers: Sequence[float], count: int, what: str) -> tuple[float, ...]:
    """Return numbers that are finite and as many as expected.

    Raises
    ------
    ServiceError
        BAD_INPUT: they are not.
    """
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ServiceError("BAD_INPUT", f"{what} must be {count} finite numbers, got {list(numbers)}.")
    return tuple(numbers)
