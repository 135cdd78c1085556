"""A client's half of the conversation without the network: what is sent, and what a reply means."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Sequence
from typing import Any, TypeVar, cast

import msgspec
import numpy as np
import zenoh
from numpy.typing import ArrayLike

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import FailureStatus, ServiceError
from gpcorrect_service.protocol.settings import MAX_MESSAGE_BYTES, ClientSettings
from gpcorrect_service.protocol.wire import gaps

__all__ = ["Exchange", "Message", "array", "gaps", "no_service", "numbers"]

S = TypeVar("S", bound=msgspec.Struct)


class Message(msgspec.Struct, frozen=True):
    """A request ready to send."""

    payload: bytes
    encoding: str
    attachment: bytes


class Exchange:
    """Writes requests and reads replies, in one encoding.

    Parameters
    ----------
    encoding : str
        "msgpack" or "json".
    """

    def __init__(self, encoding: str) -> None:
        if encoding not in wire.CODECS:
            raise DataError(f"encoding {encoding!r} is not known.", hint=f"Use one of: {', '.join(wire.CODECS)}.")
        self._codec = wire.CODECS[encoding]
        self._prefix = os.urandom(4).hex()
        self._numbers = itertools.count(1)

    def message(self, kind: wire.Kind, body: msgspec.Struct | None, deadline: float) -> Message:
        """Return a request with its attachment; `deadline` is how many seconds the answer is wanted for.

        Raises
        ------
        ServiceError
            BAD_INPUT: the request is larger than a server takes.
        """
        payload = b"" if body is None else self._codec.encode(body)
        if len(payload) > MAX_MESSAGE_BYTES:
            raise ServiceError(
                "BAD_INPUT",
                f"the request has {len(payload)} bytes; a server takes {MAX_MESSAGE_BYTES}.",
                hint="Send the path in parts, cut where the robot rests.",
            )
        meta = wire.RequestMeta(
            request_id=f"{self._prefix}-{next(self._numbers)}", client_time=time.time(), deadline=deadline
        )
        return Message(payload, wire.encoding_name(self._codec, kind), self._codec.encode(meta))

    def read(self, reply: zenoh.Reply, form: type[S]) -> tuple[S, bytes]:
        """Return what a server answered, and the attachment beside it.

        Raises
        ------
        ServiceError
            The server's own refusal; or NO_SERVICE when the reply is zenoh's or not understood.
        """
        sample = reply.ok
        if sample is None:
            raise _refusal(reply)
        attachment = sample.attachment
        try:
            body = self._codec.decode(form, sample.payload.to_bytes())
        except ServiceError as error:
            raise no_service(f"a reply that is not the service's ({error.message})") from error
        return body, (b"" if attachment is None else attachment.to_bytes())

    def read_text(self, reply: zenoh.Reply) -> str:
        """Return what a server answered as text; raises as :meth:`read`."""
        if reply.ok is None:
            raise _refusal(reply)
        return reply.ok.payload.to_bytes().decode(errors="replace")

    def read_meta(self, attachment: bytes) -> wire.ReplyMeta:
        """Return what the server wrote beside its reply.

        Raises
        ------
        ServiceError
            NO_SERVICE: nothing of ours is there.
        """
        try:
            return self._codec.decode(wire.ReplyMeta, attachment)
        except ServiceError as error:
            raise no_service(f"a reply without the service's attachment ({error.message})") from error


def _refusal(reply: zenoh.Reply) -> ServiceError:
    failure = reply.err
    if failure is None:
        return no_service("an empty reply")
    codec = wire.error_codec(str(failure.encoding))
    if codec is None:
        return no_service(f"an error of zenoh ({failure.payload.to_bytes()[:100].decode(errors='replace')})")
    try:
        told = codec.decode(wire.ErrorAnswer, failure.payload.to_bytes())
    except ServiceError as error:
        return no_service(f"an error that is not the service's ({error.message})")
    status = cast(FailureStatus, told.status)
    return ServiceError(status, told.cause, hint=told.next_step, request_id=told.request_id)


def no_service(what: str = "", settings: ClientSettings | None = None) -> ServiceError:
    """Return the error of a query that no server answered, with what may be the matter.

    Zero replies without an error is all that zenoh shows, whatever the cause.
    """
    where = ""
    if settings is not None:
        address = settings.config_file or ", ".join(settings.endpoints)
        where = f" on {settings.namespace}/{settings.arm} at {address}"
    return ServiceError(
        "NO_SERVICE",
        f"no server answered{where}" + (f": got {what}." if what else "."),
        hint=(
            "Is the server running, with this arm, namespace and address? Other causes: access denied, "
            "a query larger than the server takes, a server that hangs."
        ),
    )


def array(values: ArrayLike, what: str, ndim: int) -> FloatArray:
    """Return values as an array of `ndim` dimensions.

    Raises
    ------
    ServiceError
        BAD_INPUT: these are not numbers, or not so many dimensions.
    """
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ServiceError("BAD_INPUT", f"the {what} are not an array of numbers ({error}).") from error
    if numbers.ndim != ndim:
        raise ServiceError("BAD_INPUT", f"the {what} have {numbers.ndim} dimensions, {ndim} were expected.")
    return numbers


def numbers(values: ArrayLike, what: str) -> list[Any]:
    """Return an array as nested lists of float, ready for the wire.

    Raises
    ------
    ServiceError
        BAD_INPUT: these are not numbers.
    """
    try:
        listed: Sequence[Any] = np.asarray(values, dtype=np.float64).tolist()
    except (TypeError, ValueError) as error:
        raise ServiceError("BAD_INPUT", f"the {what} is not an array of numbers ({error}).") from error
    return list(listed) if isinstance(listed, list) else [listed]
