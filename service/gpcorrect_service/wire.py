"""The messages on the wire: JSON for people, MessagePack for speed, both strict.

Numbers are SI; poses are `x y z qw qx qy qz`. A number that does not exist (the spread of what was not
learned) is null. Request id, client time, deadline and schema version travel in the attachment, in the
payload's encoding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import msgspec

from gpcorrect_service.errors import ServiceError

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
    "HealthAnswer",
    "Kind",
    "ModelAnswer",
    "ReplyMeta",
    "RequestMeta",
    "choose_codec",
    "encoding_name",
    "error_codec",
]

SCHEMA_VERSION = 1

Kind = Literal["correct", "correct_path", "model", "health"]
KINDS: tuple[Kind, ...] = ("correct", "correct_path", "model", "health")
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
    """What travels beside a reply: request, model, process, date (s since 1970) and serving time (s)."""

    request_id: str
    model_id: str
    model_hash: str
    replica: str
    served_at: float
    serving_seconds: float
    schema_version: int = SCHEMA_VERSION


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


MESSAGES: tuple[type[msgspec.Struct], ...] = (
    CorrectRequest,
    CorrectPathRequest,
    CorrectAnswer,
    CorrectPathAnswer,
    ModelAnswer,
    HealthAnswer,
    ErrorAnswer,
    RequestMeta,
    ReplyMeta,
)
JSON = Codec(
    "json",
    "application/json",
    msgspec.json.Encoder().encode,
    {m: msgspec.json.Decoder(m).decode for m in MESSAGES},
)
MSGPACK = Codec(
    "msgpack",
    "application/msgpack",
    msgspec.msgpack.Encoder().encode,
    {m: msgspec.msgpack.Decoder(m).decode for m in MESSAGES},
)
CODECS = {codec.name: codec for codec in (JSON, MSGPACK)}


def encoding_name(codec: Codec, schema: str) -> str:
    """Return the zenoh encoding of a message, as `application/json;gpcorrect.correct/1`."""
    return f"{codec.media_type};gpcorrect.{schema}/{SCHEMA_VERSION}"


KNOWN_ENCODINGS = {encoding_name(codec, kind): (codec, kind) for codec in CODECS.values() for kind in KINDS}
ERROR_ENCODINGS = {encoding_name(codec, "error"): codec for codec in CODECS.values()}
# zenoh/bytes is what zenoh writes where nothing was said, as people do who ask by hand.
PLAIN_ENCODINGS = {**{codec.media_type: codec for codec in CODECS.values()}, "zenoh/bytes": JSON}


def error_codec(encoding: str) -> Codec | None:
    """Return the codec of an error reply that a server of ours wrote, None for zenoh's own errors."""
    return ERROR_ENCODINGS.get(encoding)


def choose_codec(encoding: str, kind: Kind) -> Codec:
    """Return how a request of `kind` is written; a bare media type is the newest schema.

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
