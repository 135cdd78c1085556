"""How a request is read, refused and answered, whatever it asks; no network here."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import msgspec

from gpcorrect.errors import DataError
from gpcorrect_service.ops.logger import Logger
from gpcorrect_service.protocol import messages
from gpcorrect_service.protocol.errors import ServiceError, bad_input
from gpcorrect_service.protocol.messages import Codec, Kind
from gpcorrect_service.protocol.ros import CALL_ENCODING, CDR_ENCODING
from gpcorrect_service.protocol.settings import ServerSettings
from gpcorrect_service.server.models import Active, JointModel, Model

CORRECTIONS: frozenset[Kind] = frozenset({"correct", "correct_path", "correct_joints"})


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


class Response(msgspec.Struct, frozen=True):
    """A reply as it goes: bytes, zenoh encoding, attachment; status, poses and poses out of domain, for the counts.

    A refusal, and what is no correction, answers no pose.
    """

    payload: bytes
    encoding: str
    attachment: bytes = b""
    status: str = "OK"
    is_error: bool = False
    rows: int = 0
    outside: int = 0


class Parsed(msgspec.Struct, frozen=True):
    """A request that will be answered: on which key, how it is written, what came beside it, when work began (s)."""

    kind: Kind
    request: Request
    codec: Codec
    meta: messages.RequestMeta
    started: float


Handler = Callable[[Request], Response]
Work = Callable[[Parsed], Response]


class RequestParser:
    """Reads requests and turns what goes wrong into refusals; safe to use from several threads.

    Answers carry the names and bounds of the settings; failures of the model are logged.
    """

    def __init__(self, active: Active, settings: ServerSettings, logger: Logger, clock: Clock) -> None:
        self.active, self.settings, self.logger, self.clock = active, settings, logger, clock
        self._bounds = settings.bounds

    def handlers(self, works: Mapping[Kind, Work]) -> dict[Kind, Handler]:
        """Return what answers the requests of each key.

        Parameters
        ----------
        works : mapping from key to callable, which answers a parsed request; may raise ServiceError and DataError
        """
        return {kind: partial(self._answer, kind, work) for kind, work in works.items()}

    def meta(self, parsed: Parsed, model: Model | JointModel) -> messages.ReplyMeta:
        """Return what travels beside an answer.

        Parameters
        ----------
        parsed : Parsed
        model : Model or JointModel
        """
        now, serving = self.clock.wall(), self.clock.monotonic() - parsed.started
        return messages.ReplyMeta(
            parsed.meta.request_id, model.id, model.hash, self.settings.replica, now, serving, bounds=self._bounds
        )

    def _answer(self, kind: Kind, work: Work, request: Request) -> Response:
        started = self.clock.monotonic()
        codec, meta = messages.JSON, messages.RequestMeta()
        try:
            # What travels beside CDR is JSON.
            cdr = kind == "correct" and request.encoding.startswith((CDR_ENCODING, CALL_ENCODING))
            codec = messages.JSON if cdr else messages.codec_of(request.encoding, kind)
            meta = _read_meta(codec, request.attachment)
            age = started - request.arrived
            if meta.deadline is not None and age > meta.deadline:
                what = f"the request waited {age:.3f} s; its answer was wanted within {meta.deadline:.3f} s."
                raise ServiceError("STALE", what, hint="Ask less often, allow more time, or add a replica.")
            response = work(Parsed(kind, request, codec, meta, started))
        except ServiceError as error:
            if error.status == "INTERNAL":
                self._failed(kind)
                facts = {"kind": kind, "request_id": meta.request_id, "cause": error.message}
                self.logger.error("unsafe command withheld", **facts)
            return _error_response(codec, error, self.settings.replica, meta.request_id)
        except DataError as error:
            return _error_response(codec, bad_input(error.message, error.hint), self.settings.replica, meta.request_id)
        except BaseException as error:  # SystemExit and panics of compiled code are failures like others
            self._failed(kind)
            self.logger.error("query failed inside", kind=kind, request_id=meta.request_id, exc_info=error)
            cause = f"the server failed on this request ({type(error).__name__})."
            fault = ServiceError("INTERNAL", cause, hint="Look the request id up in the server's log.")
            return _error_response(codec, fault, self.settings.replica, meta.request_id)
        if kind in CORRECTIONS:
            self.active.answered()
        return response

    def _failed(self, kind: Kind) -> None:
        """Count a failure against the model, unless it is well: then it was what this one client asked."""
        model = self.active.joints if kind == "correct_joints" else self.active.pose
        if kind in CORRECTIONS and not (model is not None and model.check.passes()):
            self.active.failed()


def plain_response(parsed: Parsed, message: msgspec.Struct) -> Response:
    """Return an answer that needs nothing beside it.

    Parameters
    ----------
    parsed : Parsed
    message : Struct
    """
    return Response(parsed.codec.encode(message), parsed.codec.encoding(parsed.kind))


def refusal(request: Request, error: ServiceError, replica: str) -> Response:
    """Refuse a request that nobody read further than its id.

    Parameters
    ----------
    request : Request
    error : ServiceError
    replica : str
    """
    codec = messages.MSGPACK if request.encoding.startswith(messages.MSGPACK.media_type) else messages.JSON
    try:
        request_id = _read_meta(codec, request.attachment).request_id
    except ServiceError as unread:
        request_id = unread.request_id
    return _error_response(codec, error, replica, request_id)


def _read_meta(codec: Codec, attachment: bytes) -> messages.RequestMeta:
    """Read what travels beside a request; nothing there means no deadline and no name."""
    if not attachment:
        return messages.RequestMeta()
    try:
        meta = codec.decode(messages.RequestMeta, attachment)
    except ServiceError as error:
        named = codec.decode(messages.RequestName, attachment)
        _check_schema(named)
        raise ServiceError("BAD_INPUT", error.message, hint=error.hint, request_id=named.request_id) from error
    _check_schema(meta)
    if meta.deadline is not None and not 0 < meta.deadline < math.inf:
        cause, hint = f"deadline {meta.deadline} s is no time span.", "Send seconds above zero."
        raise ServiceError("BAD_INPUT", cause, hint=hint, request_id=meta.request_id)
    if meta.client_time is not None and not math.isfinite(meta.client_time):
        cause, hint = f"client_time {meta.client_time} s is no time.", "Send seconds since 1970, or nothing."
        raise ServiceError("BAD_INPUT", cause, hint=hint, request_id=meta.request_id)
    return meta


def _check_schema(name: messages.RequestName) -> None:
    """Refuse a request of a schema that is not spoken here."""
    if not 1 <= name.schema_version <= messages.SCHEMA_VERSION:
        cause = f"the request has schema {name.schema_version}; this server speaks up to {messages.SCHEMA_VERSION}."
        hint = "Upgrade the server, or use the client of its version."
        raise ServiceError("BAD_INPUT", cause, hint=hint, request_id=name.request_id)


def _error_response(codec: Codec, error: ServiceError, replica: str, request_id: str) -> Response:
    message = messages.ErrorAnswer(error.status, error.message, error.hint, error.request_id or request_id, replica)
    return Response(codec.encode(message), codec.encoding("error"), b"", error.status, is_error=True)
