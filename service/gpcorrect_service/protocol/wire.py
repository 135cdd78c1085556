"""The messages on the wire: JSON for people, MessagePack for speed, both strict.

Numbers are SI; poses are `x y z qw qx qy qz`. A number that does not exist (the spread of what was not
learned) is null. Request id, client time, deadline and schema version travel in the attachment, in the
payload's encoding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

import msgspec
import numpy as np

from gpcorrect.types import FloatArray
from gpcorrect_service.protocol.errors import ServiceError

__all__ = [
    "CODECS",
    "JSON",
    "KINDS",
    "MSGPACK",
    "SCHEMA_VERSION",
    "Codec",
    "CorrectAnswer",
    "CorrectPathAnswer",
    "CorrectPathRequest",
    "CorrectRequest",
    "ErrorAnswer",
    "Form",
    "HealthAnswer",
    "Kind",
    "ModelAnswer",
    "ReplyMeta",
    "RequestMeta",
    "choose_codec",
    "encoding_name",
    "error_codec",
    "gap_rows",
    "gaps",
]

SCHEMA_VERSION = 1

Kind = Literal[
    "correct",
    "correct_path",
    "correct_joints",
    "model",
    "model/list",
    "health",
    "metrics",
    "admin/activate",
    "admin/state",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
# What an encoding names: the messages of a queryable, an error, or a sample of a stream.
Form = Kind | Literal["error", "estimate", "joint_state"]
Numbers = tuple[float, ...]
Gaps = list[float | None]
S = TypeVar("S", bound=msgspec.Struct)


class CorrectRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One desired pose: 7 numbers (or 3 for a position alone), and its twist (6) where known."""

    pose: Numbers
    twist: Numbers | None = None


class CorrectPathRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A timed path: n poses of 7 (or 3) numbers, n times in s."""

    poses: tuple[Numbers, ...]
    times: Numbers


class CorrectAnswer(msgspec.Struct, frozen=True):
    """What to command, as in :class:`gpcorrect.types.Correction`."""

    position: list[float]
    quaternion: list[float] | None
    std: Gaps
    interval95: Gaps
    in_domain: bool
    status: str
    reason: str


class CorrectPathAnswer(msgspec.Struct, frozen=True):
    """What to command along a path: the columns of n corrections."""

    positions: list[list[float]]
    quaternions: list[list[float]] | None
    std: list[Gaps]
    interval95: list[Gaps]
    in_domain: list[bool]
    status: list[str]
    reason: list[str]


class ModelAnswer(msgspec.Struct, frozen=True):
    """The active model: name, SHA-256 of its file, and its own words (frames, features, fit report)."""

    id: str
    hash: str
    arm: str
    replica: str
    info: dict[str, Any]


class HealthAnswer(msgspec.Struct, frozen=True):
    """State of one server: CRTK state, queue lengths, and how many queries of each key ended how."""

    state: str
    arm: str
    replica: str
    model_id: str
    model_hash: str
    uptime: float
    queued: dict[str, int]
    counts: dict[str, dict[str, int]]
    joint_model_id: str = ""
    joint_model_hash: str = ""


class ErrorAnswer(msgspec.Struct, frozen=True):
    """A refusal: what happened, why, and what to do next."""

    status: str
    cause: str
    next_step: str
    request_id: str
    replica: str
    schema_version: int = SCHEMA_VERSION


class RequestMeta(msgspec.Struct, frozen=True):
    """What travels beside a request.

    `client_time` is the sender's clock (s since 1970), for logs only: clocks differ between machines.
    `deadline` is how many seconds after its arrival the answer is still wanted, measured on the server's
    monotonic clock.
    """

    schema_version: int = SCHEMA_VERSION
    request_id: str = ""
    client_time: float | None = None
    deadline: float | None = None


class ReplyMeta(msgspec.Struct, frozen=True):
    """What travels beside a reply, and where it comes from; empty in a fallback, which comes from nowhere.

    Parameters
    ----------
    request_id, model_id, model_hash, replica : str
        The request, the model file (name and SHA-256), and the server process.
    served_at, serving_seconds : float
        When the server answered (its clock, s since 1970), and how long it worked, s; NaN in a fallback.
    schema_version : int
        Of the messages.
    """

    request_id: str = ""
    model_id: str = ""
    model_hash: str = ""
    replica: str = ""
    served_at: float = math.nan
    serving_seconds: float = math.nan
    schema_version: int = SCHEMA_VERSION


class _Decoders(dict[type, Callable[[bytes], Any]]):
    """Decoders by message, each made when its message is first read."""

    def __init__(self, make: Callable[[type], Any]) -> None:
        super().__init__()
        self._make = make

    def __missing__(self, form: type) -> Callable[[bytes], Any]:
        decode: Callable[[bytes], Any] = self._make(form).decode
        self[form] = decode
        return decode


@dataclass(frozen=True)
class Codec:
    """One of the two ways to write the messages.

    Parameters
    ----------
    name, media_type : str
        As settings and as zenoh encodings name it.
    encode : callable
        From a message to bytes.
    decoders : mapping
        From a message class to its strict decoder.
    """

    name: str
    media_type: str
    encode: Callable[[Any], bytes]
    decoders: dict[type, Callable[[bytes], Any]]

    def decode(self, message: type[S], data: bytes) -> S:
        """Read one message.

        Raises
        ------
        ServiceError
            BAD_INPUT: the bytes are not this message.
        """
        try:
            decoded: S = self.decoders[message](data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ServiceError(
                "BAD_INPUT",
                f"{len(data)} bytes are not a {message.__name__} in {self.name}: {error}.",
                hint="Compare with the forms in docs/service.md; null stands where JSON was given NaN.",
            ) from error
        return decoded


JSON = Codec("json", "application/json", msgspec.json.Encoder().encode, _Decoders(msgspec.json.Decoder))
MSGPACK = Codec("msgpack", "application/msgpack", msgspec.msgpack.Encoder().encode, _Decoders(msgspec.msgpack.Decoder))
CODECS = {codec.name: codec for codec in (JSON, MSGPACK)}


FORMS: tuple[Form, ...] = (*KINDS, "error", "estimate", "joint_state")
NAMES: dict[tuple[str, Form], str] = {
    (codec.name, form): f"{codec.media_type};gpcorrect.{form.replace('/', '_')}/{SCHEMA_VERSION}"
    for codec in CODECS.values()
    for form in FORMS
}


def encoding_name(codec: Codec, form: Form) -> str:
    """Return the zenoh encoding of a message, as `application/json;gpcorrect.correct/1`."""
    return NAMES[codec.name, form]


KNOWN_ENCODINGS = {encoding_name(codec, form): (codec, form) for codec in CODECS.values() for form in FORMS}
ERROR_ENCODINGS = {encoding_name(codec, "error"): codec for codec in CODECS.values()}
# zenoh/bytes is what zenoh writes where nothing was said, as people do who ask by hand.
PLAIN_ENCODINGS = {**{codec.media_type: codec for codec in CODECS.values()}, "zenoh/bytes": JSON}


def gaps(numbers: list[float]) -> list[float | None]:
    """Numbers for the wire: None where there is none (JSON knows no NaN)."""
    if math.isfinite(sum(numbers)):
        return list(numbers)
    return [number if math.isfinite(number) else None for number in numbers]


def gap_rows(numbers: FloatArray) -> list[list[float | None]]:
    """Rows `(n, k)` for the wire, see :func:`gaps`."""
    rows: list[Any] = numbers.tolist()
    return rows if np.isfinite(numbers).all() else [gaps(row) for row in rows]


def error_codec(encoding: str) -> Codec | None:
    """Return the codec of an error reply that a server of ours wrote, None for zenoh's own errors."""
    return ERROR_ENCODINGS.get(encoding)


def choose_codec(encoding: str, kind: Form) -> Codec:
    """Return how a message of `kind` is written; a bare media type is the newest schema.

    Raises
    ------
    ServiceError
        BAD_INPUT: the encoding is another one, of another message, or of a newer schema.
    """
    known = KNOWN_ENCODINGS.get(encoding)
    if known is not None and known[1] == kind:
        return known[0]
    if encoding in PLAIN_ENCODINGS:
        return PLAIN_ENCODINGS[encoding]
    expected = " or ".join(encoding_name(codec, kind) for codec in CODECS.values())
    raise ServiceError(
        "BAD_INPUT",
        f"encoding {encoding[:100]!r} is not understood here; this server speaks schema {SCHEMA_VERSION}.",
        hint=f"Send {expected}.",
    )
