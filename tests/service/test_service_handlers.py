"""From request bytes to reply bytes, without a network."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from service_support import POSE, SHIFT, FaultyCorrector, ShiftCorrector

from gpcorrect.errors import DataError
from gpcorrect.rigid import RigidModel
from gpcorrect_service import ServerSettings
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.protocol.answer import PathAnswer, PoseAnswer
from gpcorrect_service.protocol.messages import (
    JSON,
    MSGPACK,
    Codec,
    CorrectPathRequest,
    CorrectRequest,
    ErrorAnswer,
    Kind,
    ModelAnswer,
    ReplyMeta,
    RequestMeta,
    error_codec,
)
from gpcorrect_service.server.handlers import Corrections
from gpcorrect_service.server.models import FAULTS_IN_A_ROW, Active, Model
from gpcorrect_service.server.requests import Clock, Request, RequestParser, Response

NOW = 100.0
ENCODINGS = ["application/json", "application/msgpack", "zenoh/bytes", "text/plain"]


class Answering:
    """The keys of one model, answered without a network."""

    def __init__(
        self,
        corrector: ShiftCorrector | FaultyCorrector | None,
        log: io.StringIO | None = None,
        *,
        strict: bool = False,
    ) -> None:
        model = None if corrector is None else Model(corrector, id="m", hash="h")
        clock = Clock(monotonic=lambda: NOW, wall=lambda: 1e9)
        logger = open_logger(log or io.StringIO())
        parser = RequestParser(Active(model), ServerSettings(replica="r1", strict=strict), logger, clock)
        handlers = Corrections(parser).handlers()
        self.correct, self.correct_path, self.model = (handlers[k] for k in ("correct", "correct_path", "model"))


def request(kind: Kind, body: Any, codec: Codec = JSON, age: float = 0.0, **meta: Any) -> Request:
    payload = body if isinstance(body, bytes) else codec.encode(body)
    attachment = codec.encode(RequestMeta(**meta)) if meta else b""
    return Request(payload, codec.encoding(kind), attachment, NOW - age)


def refusal(answer: Response) -> ErrorAnswer:
    codec = error_codec(answer.encoding)
    assert answer.is_error
    assert codec is not None
    return codec.decode(ErrorAnswer, answer.payload)


@pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=["json", "msgpack"])
def test_correct(codec: Codec) -> None:
    """A pose comes back shifted, in the encoding it came in, with request, model and replica named."""
    asked = request("correct", CorrectRequest(tuple(POSE)), codec, request_id="q7")
    answer = Answering(ShiftCorrector()).correct(asked)
    reply = codec.decode(PoseAnswer, answer.payload)
    beside = codec.decode(ReplyMeta, answer.attachment)
    np.testing.assert_allclose(reply.position, POSE[:3] + SHIFT, rtol=0, atol=1e-15)
    assert reply.quaternion == POSE[3:]
    assert reply.std[3:] == [None] * 3
    assert answer.encoding == codec.encoding("correct")
    assert beside == ReplyMeta("q7", "m", "h", "r1", 1e9, 0.0)


@pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=["json", "msgpack"])
def test_path_equals_its_poses(codec: Codec) -> None:
    """For a corrector without memory, a path's answers are those of its poses."""
    serve = Answering(ShiftCorrector())
    poses = tuple((x, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0) for x in (0.1, 0.4, 0.7))
    path = serve.correct_path(request("correct_path", CorrectPathRequest(poses, (0.0, 0.1, 0.2)), codec))
    whole = codec.decode(PathAnswer, path.payload)
    for row, pose in enumerate(poses):
        answer = serve.correct(request("correct", CorrectRequest(pose), codec))
        one = codec.decode(PoseAnswer, answer.payload)
        assert one.position == whole.position[row]
        assert (one.std, one.interval95) == (whole.std[row], whole.interval95[row])
        assert (one.in_domain, one.status, one.reason) == (
            whole.in_domain[row],
            whole.status[row],
            whole.reason[row],
        )
    assert path.status == "EXTRAPOLATING"


def test_position_alone() -> None:
    """Three numbers in, no quaternion out."""
    answer = Answering(ShiftCorrector()).correct(request("correct", CorrectRequest((0.1, 0.0, 0.0))))
    assert JSON.decode(PoseAnswer, answer.payload).quaternion is None


def test_model_tells_itself() -> None:
    """The model key names the file, its hash and what it says of itself; it needs no payload."""
    answer = Answering(ShiftCorrector()).model(request("model", b""))
    result = JSON.decode(ModelAnswer, answer.payload)
    assert (result.id, result.hash, result.arm, result.replica) == ("m", "h", "arm1", "r1")
    assert result.info == ShiftCorrector().info()


def test_no_model() -> None:
    """Without a model every correction says so, and what to do."""
    serve = Answering(None)
    for answer in (
        serve.correct(request("correct", CorrectRequest(tuple(POSE)))),
        serve.model(request("model", b"")),
    ):
        assert refusal(answer).status == "NO_MODEL"
        assert "gpcorrect serve" in refusal(answer).next_step


@pytest.mark.parametrize("body", [b"", b"{", b"\x00\xff\xfe", b"[]", b'{"pose": [1, 2]}', b'{"pose": "here"}'])
@pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=["json", "msgpack"])
def test_bad_payload(codec: Codec, body: bytes) -> None:
    """Bytes that are no request are BAD_INPUT in the request's encoding, with its id and a next step."""
    result = refusal(Answering(ShiftCorrector()).correct(request("correct", body, codec, request_id="q8")))
    assert (result.status, result.request_id, result.replica) == ("BAD_INPUT", "q8", "r1")
    assert result.cause
    assert result.next_step


@pytest.mark.parametrize("age", [0.0, 0.1, 0.2, 10.0])
def test_deadline(age: float) -> None:
    """A request is STALE exactly when it waited longer than it is wanted; without a deadline never."""
    body = CorrectRequest(tuple(POSE))
    timed = Answering(ShiftCorrector()).correct(request("correct", body, age=age, deadline=0.15))
    assert (timed.status == "STALE") == (age > 0.15)
    assert Answering(ShiftCorrector()).correct(request("correct", body, age=age)).status == "OK"


@pytest.mark.parametrize("deadline", [0.0, -1.0])
def test_deadline_is_a_time_span(deadline: float) -> None:
    """A deadline of nothing is a mistake, not an expired request."""
    body = CorrectRequest(tuple(POSE))
    assert Answering(ShiftCorrector()).correct(request("correct", body, deadline=deadline)).status == "BAD_INPUT"


@pytest.mark.parametrize(
    ("codec", "beside"),
    [
        (JSON, {"request_id": "q7", "deadlin": 0.5}),
        (MSGPACK, {"request_id": "q7", "deadline": math.inf}),
        (MSGPACK, {"request_id": "q7", "client_time": math.nan}),
    ],
    ids=["unknown", "infinite", "nan"],
)
def test_what_travels_beside_is_strict(codec: Codec, beside: dict[str, Any]) -> None:
    """A misspelt deadline would be none: unknown names, and what is no number, are refused under the request's id."""
    body, encoding = codec.encode(CorrectRequest(tuple(POSE))), codec.encoding("correct")
    result = refusal(Answering(ShiftCorrector()).correct(Request(body, encoding, codec.encode(beside), NOW)))
    assert (result.status, result.request_id) == ("BAD_INPUT", "q7")


@pytest.mark.parametrize("client_time", [0.0, -5.0, 4e9])
def test_clocks_of_clients_do_not_matter(client_time: float) -> None:
    """Ages are measured on the server's monotonic clock: a client's clock may stand anywhere."""
    body = CorrectRequest(tuple(POSE))
    asked = request("correct", body, client_time=client_time, deadline=0.5)
    assert Answering(ShiftCorrector()).correct(asked).status == "OK"


def test_newer_schema() -> None:
    """A request of a newer schema is refused with both versions, even with fields that are not known yet."""
    attachment = json.dumps({"schema_version": 2, "request_id": "q9", "priority": "high"}).encode()
    asked = Request(JSON.encode(CorrectRequest(tuple(POSE))), JSON.encoding("correct"), attachment, NOW)
    result = refusal(Answering(ShiftCorrector()).correct(asked))
    assert (result.status, result.request_id) == ("BAD_INPUT", "q9")
    assert "schema 2" in result.cause
    assert "Upgrade" in result.next_step


def test_fault_in_the_model_is_internal_and_logged() -> None:
    """An exception in the model is answered INTERNAL; its details are logged under the request's id."""
    log = io.StringIO()
    asked = request("correct", CorrectRequest((-0.1, *POSE[1:])), request_id="q10")
    result = refusal(Answering(FaultyCorrector(), log).correct(asked))
    line = json.loads(log.getvalue())
    assert (result.status, result.request_id) == ("INTERNAL", "q10")
    assert "a fault inside the model" not in result.cause
    assert line["request_id"] == "q10"
    assert line["exception"][0]["exc_type"] == "ZeroDivisionError"


class Poisoned(ShiftCorrector):
    """Fails on x < 0 and is far off on x > 0.9, though well on its own check query until it is broken."""

    def __init__(self) -> None:
        self.broken = False

    def check_answers(self) -> Any:
        return np.full((1, 7), np.nan if self.broken else 1.0)

    def correct(self, pose: Any, twist: Any = None) -> Any:
        if pose[0] < 0 or self.broken:
            raise ZeroDivisionError("a fault inside the model")
        answer = super().correct(pose, twist)
        return replace(answer, position=np.full(3, 100.0)) if pose[0] > 0.9 else answer


def test_what_one_client_asks_never_counts_against_the_model() -> None:
    """However many questions a model cannot answer, it goes on answering others, until its own check queries fail."""
    corrector = Poisoned()
    serve = Answering(corrector)
    ok, poison, far = (request("correct", CorrectRequest((x, *POSE[1:]))) for x in (0.1, -0.1, 0.95))
    for _ in range(FAULTS_IN_A_ROW):
        assert (serve.correct(poison).status, serve.correct(far).status) == ("INTERNAL", "INTERNAL")
    assert serve.correct(ok).status == "OK"
    corrector.broken = True
    for _ in range(FAULTS_IN_A_ROW):
        assert serve.correct(ok).status == "INTERNAL"
    assert "FAULT" in refusal(serve.correct(ok)).cause


class Registered(ShiftCorrector):
    """Poses lie half a metre further out in the frame of commands."""

    rigid = RigidModel("pose", t=np.array([0.5, 0.0, 0.0]))

    def correct_path(self, poses: Any, times: Any) -> Any:
        answer = super().correct_path(poses, times)
        return replace(answer, position=answer.position + self.rigid.t)


def test_a_pose_that_registration_takes_out_of_reach_is_bad_input() -> None:
    """A pose within the limit where it was asked, and beyond it where it is commanded, is the client's mistake."""
    serve, pose = Answering(Registered()), (4.9999, 0.0, 0.0, *POSE[3:])
    for _ in range(FAULTS_IN_A_ROW + 1):
        assert serve.correct(request("correct", CorrectRequest(pose))).status == "BAD_INPUT"
        assert serve.correct_path(request("correct_path", CorrectPathRequest((pose,), (0.0,)))).status == "BAD_INPUT"
    assert serve.correct(request("correct", CorrectRequest(tuple(POSE)))).status == "OK"


def test_a_panic_in_the_model_is_answered() -> None:
    """What is no ordinary exception, as a panic of compiled code, is INTERNAL too, and the caller hears of it."""

    class Panics(ShiftCorrector):
        def correct(self, pose: Any, twist: Any = None) -> Any:
            raise SystemExit(1)

    answer = Answering(Panics()).correct(request("correct", CorrectRequest(tuple(POSE))))
    assert refusal(answer).status == "INTERNAL"


def test_a_strict_server_refuses_what_it_does_not_know() -> None:
    """Poses and paths outside the training region are BAD_INPUT, naming the row; those inside are answered."""
    serve = Answering(ShiftCorrector(), strict=True)
    inside, outside = (tuple(POSE)), (0.6, *POSE[1:])
    assert serve.correct(request("correct", CorrectRequest(inside))).status == "OK"
    assert refusal(serve.correct(request("correct", CorrectRequest(outside)))).status == "BAD_INPUT"
    path = CorrectPathRequest((inside, outside, inside), (0.0, 0.1, 0.2))
    result = refusal(serve.correct_path(request("correct_path", path)))
    assert (result.status, "row 1" in result.cause) == ("BAD_INPUT", True)


def test_unsafe_command_is_internal_and_logged() -> None:
    """A command that is not finite is withheld and logged."""
    log = io.StringIO()
    asked = request("correct", CorrectRequest((0.0, *POSE[1:])), request_id="q11")
    result = refusal(Answering(FaultyCorrector(), log).correct(asked))
    assert (result.status, result.request_id) == ("INTERNAL", "q11")
    assert json.loads(log.getvalue())["request_id"] == "q11"


@given(payload=st.binary(max_size=300), attachment=st.binary(max_size=60), encoding=st.sampled_from(ENCODINGS))
def test_no_bytes_bring_the_server_down(payload: bytes, attachment: bytes, encoding: str) -> None:
    """Whatever bytes come as payload and attachment, every key answers, and never INTERNAL."""
    serve = Answering(ShiftCorrector())
    asked = Request(payload, encoding, attachment, NOW)
    for answer in (serve.correct(asked), serve.correct_path(asked), serve.model(asked)):
        assert answer.status in {"OK", "EXTRAPOLATING", "BAD_INPUT"}


def test_the_models_own_objection_is_bad_input() -> None:
    """What the corrector calls bad data is the planner's BAD_INPUT, with the corrector's own hint."""

    class Picky(ShiftCorrector):
        def correct(self, pose: Any, twist: Any = None) -> Any:
            raise DataError("this model needs a twist.", hint="Send one.")

    result = refusal(Answering(Picky()).correct(request("correct", CorrectRequest(tuple(POSE)))))
    assert (result.status, result.cause, result.next_step) == (
        "BAD_INPUT",
        "this model needs a twist.",
        "Send one.",
    )
