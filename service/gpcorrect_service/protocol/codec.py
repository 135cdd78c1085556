"""How messages become bytes: JSON for people, MessagePack for speed, both strict; and the encodings that name them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

import msgspec

from gpcorrect_service.protocol.errors import bad_input
from gpcorrect_service.protocol.messages import KINDS, SCHEMA_VERSION, Kind

Form = Kind | Literal["error", "estimate", "joint_state"]  # what an encoding names
FORMS: tuple[Form, ...] = (*KINDS, "error", "estimate", "joint_state")
S = TypeVar("S", bound=msgspec.Struct)


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
            raise bad_input(
                f"{len(data)} bytes are not a {message.__name__} in {self.name}: {error}.",
                "Compare with the forms in docs/service.md; null stands where JSON was given NaN.",
            ) from error
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
    raise bad_input(
        f"encoding {encoding[:100]!r} is not understood here; this server speaks schema {SCHEMA_VERSION}.",
        f"Send {expected}.",
    )
