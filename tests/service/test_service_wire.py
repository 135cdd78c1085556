"""Messages survive the wire in both encodings, and nothing else passes for one."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpcorrect_service import ServiceError
from gpcorrect_service.protocol.answer import PoseAnswer
from gpcorrect_service.protocol.messages import CODECS, JSON, KINDS, Codec, CorrectRequest, Kind, codec_of, error_codec

codecs = st.sampled_from(list(CODECS.values()))
number = st.floats(allow_nan=False, allow_infinity=False)
numbers = st.lists(number, max_size=8)


@given(codec=codecs, pose=numbers, twist=st.none() | numbers)
def test_request_round_trip(codec: Codec, pose: list[float], twist: list[float] | None) -> None:
    """Decoding an encoded request gives back the same doubles, bit for bit."""
    request = CorrectRequest(tuple(pose), None if twist is None else tuple(twist))
    assert codec.decode(CorrectRequest, codec.encode(request)) == request


@given(codec=codecs, std=st.lists(number | st.none(), min_size=6, max_size=6), reason=st.text())
def test_answer_round_trip(codec: Codec, std: list[float | None], reason: str) -> None:
    """Missing numbers and any text survive both encodings."""
    answer = PoseAnswer(
        position=[0.0, 1.0, 2.0],
        quaternion=None,
        std=std,
        interval95=std,
        in_domain=True,
        status="OK",
        reason=reason,
        flags=0,
    )
    assert codec.decode(PoseAnswer, codec.encode(answer)) == answer


@given(codec=codecs, data=st.binary(max_size=200))
def test_random_bytes_are_bad_input(codec: Codec, data: bytes) -> None:
    """Random bytes are a request by luck or BAD_INPUT, never another error."""
    try:
        outcome = codec.decode(CorrectRequest, data).pose
    except ServiceError as error:
        outcome = error.status
    assert outcome == "BAD_INPUT" or isinstance(outcome, tuple)


@given(codec=codecs, cut=st.integers(0, 10_000))
def test_truncated_request_is_bad_input(codec: Codec, cut: int) -> None:
    """Every proper prefix of a request is refused."""
    data = codec.encode(CorrectRequest((0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0), (0.0,) * 6))
    with pytest.raises(ServiceError, match="BAD_INPUT"):
        codec.decode(CorrectRequest, data[: cut % len(data)])


@pytest.mark.parametrize(
    "body",
    [
        {"pose": ["0.1", 0, 0]},
        {"pose": [0.1, None, 0]},
        {"pose": [True, 0, 0]},
        {"pose": 0.1},
        {"pose": [0.1, 0, 0], "twits": None},
        {"twist": [0] * 6},
        [0.1, 0, 0],
        "pose",
    ],
)
@pytest.mark.parametrize("codec", list(CODECS.values()), ids=list(CODECS))
def test_types_are_strict(codec: Codec, body: object) -> None:
    """Texts, nulls and booleans are not numbers, unknown names are not ignored, missing ones are missed."""
    encode = msgspec.json.encode if codec is JSON else msgspec.msgpack.encode
    with pytest.raises(ServiceError, match="BAD_INPUT"):
        codec.decode(CorrectRequest, encode(body))


def test_deep_nesting_is_bad_input() -> None:
    """A payload nested deeper than the parser's stack is refused, not crashed on."""
    with pytest.raises(ServiceError, match="BAD_INPUT"):
        JSON.decode(CorrectRequest, b'{"pose":' + b"[" * 100_000)


def test_integers_are_numbers() -> None:
    """People write 1 for 1.0 in JSON."""
    assert JSON.decode(CorrectRequest, b'{"pose": [1, 2, 3]}').pose == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("codec", list(CODECS.values()), ids=list(CODECS))
def test_encoding_names_their_message(codec: Codec, kind: Kind) -> None:
    """An encoding's name leads back to its codec, for its own key only; a bare media type fits every key."""
    name = codec.encoding(kind)
    assert codec_of(name, kind) is codec
    assert codec_of(codec.media_type, kind) is codec
    for other in KINDS:
        if other != kind:
            with pytest.raises(ServiceError, match="BAD_INPUT"):
                codec_of(name, other)


@pytest.mark.parametrize(
    "encoding", ["zenoh/string", "", "text/plain", "application/json;gpcorrect.correct/2", "x" * 5000]
)
def test_unknown_encoding(encoding: str) -> None:
    """Another encoding, or one of a newer schema, is refused with those that are spoken."""
    with pytest.raises(ServiceError) as caught:
        codec_of(encoding, "correct")
    assert caught.value.status == "BAD_INPUT"
    assert "application/json;gpcorrect.correct/1" in caught.value.hint
    assert len(caught.value.message) < 300


def test_error_encoding_is_the_services_own() -> None:
    """Zenoh's own errors carry zenoh's encoding, and are never taken for a server's words."""
    assert error_codec("zenoh/string") is None
    assert error_codec("application/json") is None
    assert error_codec(JSON.encoding("error")) is JSON


def test_json_has_no_nan() -> None:
    """A NaN that reaches the JSON encoder becomes null, which a request refuses."""
    data = JSON.encode(CorrectRequest((math.nan, 0.0, 0.0)))
    with pytest.raises(ServiceError, match="null"):
        JSON.decode(CorrectRequest, data)
