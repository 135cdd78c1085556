"""The messages of joint-space mode: a path of joints and its answer, and the samples of the live stream."""

from __future__ import annotations

import msgspec

from gpcorrect_service.protocol.wire import Gaps

__all__ = ["CorrectJointsAnswer", "CorrectJointsRequest", "JointEstimate", "JointState"]

Row = tuple[float | None, ...]


class CorrectJointsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A timed path of joints: n rows of d positions (rad or m; null where missing), n times in s.

    `efforts` are n rows as logged (N m or N), for models that look at them; `sessions` are n numbers: where one
    differs from that before, the arm was homed or moved by hand, and the path begins anew.
    """

    q: tuple[Row, ...]
    times: tuple[float, ...]
    efforts: tuple[Row, ...] | None = None
    sessions: tuple[int, ...] | None = None


class CorrectJointsAnswer(msgspec.Struct, frozen=True):
    """Corrected joints and their standard deviations, n rows of d; null where a number was missing."""

    q: list[Gaps]
    std: list[Gaps]
    status: list[str]


class JointState(msgspec.Struct, frozen=True):
    """One sample of the robot's state, as CRTK's `measured_js`; `stamp` is the robot's clock, s, and never 0."""

    stamp: float
    position: Row
    velocity: Row | None = None
    effort: Row | None = None
    session: int = 0


class JointEstimate(msgspec.Struct, frozen=True):
    """What the stream says of one sample: true joints, standard deviations, and which model said so.

    `status` is OK, LIMITED (the bound on how fast a correction may change acted), MISSING (a joint or an effort that
    the model needs was not there: the joints are null) or STALE (the sample waited too long; it is answered all the
    same, for the slack of the cables is a matter of every sample).
    """

    stamp: float
    position: Gaps
    std: Gaps
    status: str
    session: int
    model_hash: str
    replica: str
