"""The messages, and how they become bytes: JSON for people, MessagePack for speed, both strict.

What is asked, what is answered beside corrections, and what travels beside both. SI units; poses are
`x y z qw qx qy qz`; null where a number does not exist.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeVar, get_args

import msgspec

from gpcorrect_service.protocol.errors import bad_input

SCHEMA_VERSION = 1  # of the messages; a server refuses a newer one
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
State = Literal["DISABLED", "ENABLED", "PAUSED", "FAULT"]  # CRTK's operating states, of robots and of servers
Numbers = tuple[float, ...]
Row = tuple[float | None, ...]
Session = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]  # what MessagePack and arrays of numbers hold
Form = Kind | Literal["error", "estimate", "joint_state"]  # what an encoding names
FORMS: tuple[Form, ...] = (*KINDS, "error", "estimate", "joint_state")
S = TypeVar("S", bound=msgspec.Struct)


class CorrectRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One desired pose: 7 numbers (or 3 for a position alone), and its twist (6) where known."""

    pose: Numbers
    twist: Numbers | None = None


class CorrectPathRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A timed path: n poses of 7 (or 3) numbers, n times in s."""

    poses: tuple[Numbers, ...]
    times: Numbers


class CorrectJointsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A timed path of joints: n rows of d positions (rad or m; null where missing), n times in s.

    `efforts` are n rows as logged (N m or N), for models that use them; `sessions` are n numbers: where one differs
    from that before, the arm was homed or moved by hand, and the path begins anew.
    """

    q: tuple[Row, ...]
    times: Numbers
    efforts: tuple[Row, ...] | None = None
    sessions: tuple[Session, ...] | None = None


class JointState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Joints as CRTK's `measured_js`: rad or m, a second, N m or N; `stamp` is the robot's clock, s, and never 0."""

    stamp: float
    position: Row
    velocity: Row | None = None
    effort: Row | None = None
    session: Session = 0


class ModelAnswer(msgspec.Struct, frozen=True):
    """The active model: name, SHA-256 of its file, and its own description (frames, features, fit report).

    `registration` is :meth:`gpcorrect.rigid.RigidModel.to_dict`, of a model of poses that has one.
    """

    id: str
    hash: str
    arm: str
    replica: str
    info: dict[str, Any]
    registration: dict[str, Any] | None = None


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


class ActivateRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Which model of the server's store is to answer: its name, or the beginning of its hash.

    `back` says that it is the one before, and the present one is given up: the next one back is an older one.
    """

    model: str
    back: bool = False


class ActivateAnswer(msgspec.Struct, frozen=True):
    """Which model answers now, which one did before, and how far their commands lie apart (None where not known)."""

    id: str
    hash: str
    kind: str
    before: str
    replica: str
    apart_mm: float | None = None
    apart_deg: float | None = None


class PartRmse(msgspec.Struct, frozen=True):
    """Held-out error (RMSE) of what is quoted together, such as the position, in its unit."""

    part: str
    unit: str
    rmse: float


class ModelEntry(msgspec.Struct, frozen=True):
    """One model of a store; when it was made (ISO 8601) and its held-out errors, where its file knows them."""

    id: str
    hash: str
    kind: str
    added: float
    active: bool
    made: str = ""
    held_out: list[PartRmse] = []


class ModelListAnswer(msgspec.Struct, frozen=True):
    """The models of the server's store, oldest first, and those that answered before, latest last, by kind."""

    replica: str
    models: list[ModelEntry]
    history: dict[str, list[str]]
    serving: dict[str, str]


class StateRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """PAUSED stops corrections, ENABLED goes on, and ends a FAULT."""

    state: Literal["ENABLED", "PAUSED"]


class StateAnswer(msgspec.Struct, frozen=True):
    """The state after the change, and whether a server that is started again will know of it."""

    state: str
    replica: str
    stays: bool = False


class ErrorAnswer(msgspec.Struct, frozen=True):
    """A refusal: what happened, why, and what to do next."""

    status: str
    cause: str
    next_step: str
    request_id: str
    replica: str
    schema_version: int = SCHEMA_VERSION


class RequestName(msgspec.Struct, frozen=True):
    """What can be read of a :class:`RequestMeta` of any schema."""

    schema_version: int = SCHEMA_VERSION
    request_id: str = ""


class RequestMeta(RequestName, frozen=True, forbid_unknown_fields=True):
    """What travels beside a request.

    `client_time` is the sender's clock (s since 1970), for logs only: clocks differ between machines. `deadline` is how
    many seconds after its arrival the answer is still wanted, measured on the server's monotonic clock.
    """

    client_time: float | None = None
    deadline: float | None = None


class ReplyMeta(msgspec.Struct, frozen=True):
    """What travels beside a reply, and where it comes from; empty in a fallback, which comes from nowhere."""

    # the request, the model file (name and SHA-256), and the server process
    request_id: str = ""
    model_id: str = ""
    model_hash: str = ""
    replica: str = ""
    # when the server answered (its clock, s since 1970), and how long it worked, s; NaN in a fallback
    served_at: float = math.nan
    serving_seconds: float = math.nan
    schema_version: int = SCHEMA_VERSION  # of the messages
    # the operator's: what answers of the same model may differ by from server to server; empty for none
    bounds: str = ""


class Codec:
    """One of the two ways to write messages: its name, what encodes a message, and msgspec's decoder class."""

    def __init__(self, name: str, encode: Callable[[Any], bytes], decoder: Callable[[type], Any]) -> None:
        self.name = name
        self.media_type = f"application/{name}"
        self.encode = encode
        self._decoder = decoder
        self._decode: dict[type, Callable[[bytes], Any]] = {}
        self._encodings = {
            form: f"{self.media_type};gpcorrect.{form.replace('/', '_')}/{SCHEMA_VERSION}" for form in FORMS
        }

    def encoding(self, form: Form) -> str:
        """Return the zenoh encoding of a message, as `application/json;gpcorrect.correct/1`.

        Parameters
        ----------
        form : str, a key, "error", "estimate" or "joint_state"
        """
        return self._encodings[form]

    def decode(self, message: type[S], data: bytes) -> S:
        """Read one message; BAD_INPUT where the bytes are not it.

        Parameters
        ----------
        message : type
        data : bytes
        """
        decode = self._decode.get(message)
        if decode is None:
            decode = self._decode[message] = self._decoder(message).decode
        try:
            decoded: S = decode(data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            hint = "Compare with the forms in docs/service.md; null stands where JSON was given NaN."
            raise bad_input(f"{len(data)} bytes are not a {message.__name__} in {self.name}: {error}.", hint) from error
        return decoded


JSON = Codec("json", msgspec.json.Encoder().encode, msgspec.json.Decoder)
MSGPACK = Codec("msgpack", msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder)
CODECS = {codec.name: codec for codec in (JSON, MSGPACK)}
KNOWN = {codec.encoding(form): (codec, form) for codec in CODECS.values() for form in FORMS}
# zenoh/bytes is what zenoh writes where no encoding was given, as people do who ask by hand.
PLAIN = {**{codec.media_type: codec for codec in CODECS.values()}, "zenoh/bytes": JSON}


def error_codec(encoding: str) -> Codec | None:
    """Return the codec of an error reply that a server of ours wrote, None for zenoh's own errors.

    Parameters
    ----------
    encoding : str, as zenoh names it
    """
    codec, form = KNOWN.get(encoding, (None, None))
    return codec if form == "error" else None


def codec_of(encoding: str, form: Form) -> Codec:
    """Return how a message is written; a bare media type is the newest schema.

    BAD_INPUT where the encoding is not known here, is of another message, or of a newer schema.

    Parameters
    ----------
    encoding : str, as zenoh names it
    form : str
    """
    codec, named = KNOWN.get(encoding, (None, None))
    if codec is not None and named == form:
        return codec
    if encoding in PLAIN:
        return PLAIN[encoding]
    expected = " or ".join(codec.encoding(form) for codec in CODECS.values())
    cause = f"encoding {encoding[:100]!r} is not understood here; this server speaks schema {SCHEMA_VERSION}."
    raise bad_input(cause, f"Send {expected}.")
