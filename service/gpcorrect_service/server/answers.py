"""What every answer shares: the request as it came, its age, and how a refusal is told."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import ServiceError

__all__ = [
    "Answer",
    "Clock",
    "Request",
    "busy_error",
    "check_age",
    "error_answer",
    "internal_error",
    "plain_answer",
    "read_meta",
    "refusal",
]


@dataclass(frozen=True)
class Clock:
    """The two clocks of a process, s: one for ages, which nobody can set, and one for the date."""

    monotonic: Callable[[], float] = time.monotonic
    wall: Callable[[], float] = time.time


class Request(msgspec.Struct, frozen=True):
    """A query as it came: bytes, zenoh encoding, attachment, and when it arrived (s, monotonic)."""

    payload: bytes
    encoding: str
    attachment: bytes
    arrived: float


class Answer(msgspec.Struct, frozen=True):
    """A reply as it goes: bytes, zenoh encoding, attachment; status, poses and poses out of domain, for the counts."""

    payload: bytes
    encoding: str
    attachment: bytes
    status: str
    is_error: bool = False
    rows: int = 1
    outside: int = 0


def read_meta(codec: wire.Codec, attachment: bytes) -> wire.RequestMeta:
    """Read what travels beside a request; nothing there means no deadline and no name.

    Raises
    ------
    ServiceError
        BAD_INPUT: it cannot be read, its schema is newer, or its deadline is no time span.
    """
    if not attachment:
        return wire.RequestMeta()
    meta = codec.decode(wire.RequestMeta, attachment)
    if not 1 <= meta.schema_version <= wire.SCHEMA_VERSION:
        raise ServiceError(
            "BAD_INPUT",
            f"the request has schema {meta.schema_version}; this server speaks up to {wire.SCHEMA_VERSION}.",
            hint="Upgrade the server, or use the client of its version.",
            request_id=meta.request_id,
        )
    if meta.deadline is not None and not meta.deadline > 0:
        raise ServiceError(
            "BAD_INPUT",
            f"deadline {meta.deadline} s is no time span.",
            hint="Send seconds above zero.",
            request_id=meta.request_id,
        )
    return meta


def check_age(meta: wire.RequestMeta, age: float) -> None:
    """Refuse a request that waited (`age`, s) for longer than its answer is wanted.

    Raises
    ------
    ServiceError
        STALE.
    """
    if meta.deadline is not None and age > meta.deadline:
        raise ServiceError(
            "STALE",
            f"the request waited {age:.3f} s; its answer was wanted within {meta.deadline:.3f} s.",
            hint="Ask less often, allow more time, or add a replica.",
            request_id=meta.request_id,
        )


def plain_answer(codec: wire.Codec, kind: wire.Kind, message: msgspec.Struct) -> Answer:
    """Return an answer that needs nothing beside it."""
    return Answer(codec.encode(message), wire.encoding_name(codec, kind), b"", "OK")


def error_answer(codec: wire.Codec, error: ServiceError, replica: str, request_id: str = "") -> Answer:
    """Return the reply that tells a refusal, in the service's own error encoding."""
    message = wire.ErrorAnswer(error.status, error.message, error.hint, error.request_id or request_id, replica)
    return Answer(codec.encode(message), wire.encoding_name(codec, "error"), b"", error.status, is_error=True)


def refusal(request: Request, error: ServiceError, replica: str) -> Answer:
    """Answer `error` to a request that nobody read further than its id."""
    codec = wire.MSGPACK if request.encoding.startswith(wire.MSGPACK.media_type) else wire.JSON
    try:
        request_id = read_meta(codec, request.attachment).request_id
    except ServiceError as unread:
        request_id = unread.request_id
    return error_answer(codec, error, replica, request_id)


def busy_error(capacity: int) -> ServiceError:
    """Return what a request hears that found the queue full, or the server stopping."""
    return ServiceError(
        "BUSY",
        f"{capacity} requests are waiting already, or the server is stopping.",
        hint="Ask again later, or add a replica.",
    )


def internal_error(error: Exception) -> ServiceError:
    """Return what a planner hears of a fault inside; the details stay in the server's log."""
    return ServiceError(
        "INTERNAL",
        f"the server failed on this request ({type(error).__name__}).",
        hint="Look the request id up in the server's log.",
    )
