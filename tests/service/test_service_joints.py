"""Joint-space mode: paths of joints, and the live stream, without a network."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from service_support import SLACK, lagging_joints

from gpcorrect_service import ServerSettings
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.metrics import Counters
from gpcorrect_service.protocol.answer import EstimateAnswer, JointsAnswer
from gpcorrect_service.protocol.messages import (
    CODECS,
    JSON,
    MSGPACK,
    Codec,
    CorrectJointsRequest,
    ErrorAnswer,
    JointState,
    codec_of,
)
from gpcorrect_service.server.estimator import Estimator
from gpcorrect_service.server.handlers import Corrections
from gpcorrect_service.server.models import Active
from gpcorrect_service.server.requests import Clock, Request, RequestParser, Response

NOW = 100.0
Q = ((0.1, 0.2, 0.05), (0.2, 0.2, 0.06), (0.3, 0.2, 0.07))
TIMES = (0.0, 0.1, 0.2)


def ask(body: CorrectJointsRequest | bytes, active: Active | None = None) -> Response:
    clock = Clock(monotonic=lambda: NOW, wall=lambda: 1e9)
    logger = open_logger(io.StringIO())
    active = active or Active(joints=lagging_joints())
    parser = RequestParser(active, ServerSettings(replica="r1"), logger, clock)
    payload = body if isinstance(body, bytes) else JSON.encode(body)
    return Corrections(parser).handlers()["correct_joints"](Request(payload, JSON.encoding("correct_joints"), b"", NOW))


def answer(body: CorrectJointsRequest) -> JointsAnswer:
    return JSON.decode(JointsAnswer, ask(body).payload)


def refusal(body: CorrectJointsRequest | bytes, active: Active | None = None) -> ErrorAnswer:
    return JSON.decode(ErrorAnswer, ask(body, active).payload)


def test_a_path_carries_its_slack() -> None:
    """Every row knows the rows before it: after a turn the joint stays where it was left."""
    turned = answer(CorrectJointsRequest(((0.0,) * 3, (0.1,) * 3, (0.1 - SLACK,) * 3), TIMES))
    np.testing.assert_allclose(turned.joints, [[0.0] * 3, [0.1 - SLACK] * 3, [0.1 - SLACK] * 3], atol=1e-12)
    assert turned.status == ["OK"] * 3


def test_a_session_begins_anew() -> None:
    """Where the session changes, the slack of before is forgotten."""
    rows = ((0.0,) * 3, (0.1,) * 3, (0.1,) * 3)
    assert answer(CorrectJointsRequest(rows, TIMES, sessions=(0, 0, 1))).joints[2] == [0.1] * 3


def test_missing_numbers_are_flagged_and_cost_nothing_else() -> None:
    """A row with a null is answered with nulls and MISSING; the rows after it are answered."""
    result = answer(CorrectJointsRequest((Q[0], (None, 0.2, 0.06), Q[2]), TIMES))
    assert result.status == ["OK", "MISSING", "OK"]
    assert result.joints[1] == [None] * 3


@pytest.mark.parametrize(
    ("body", "cause"),
    [
        (CorrectJointsRequest((), ()), "1 to 5000 rows"),
        (CorrectJointsRequest(Q, TIMES[:2]), "2 times"),
        (CorrectJointsRequest(Q, (0.0, 0.2, 0.1)), "do not increase"),
        (CorrectJointsRequest(Q, (0.0, 1e9, 2e18)), "seconds"),
        (CorrectJointsRequest(Q, TIMES, efforts=Q[:1]), "1 efforts"),
        (CorrectJointsRequest(Q, TIMES, sessions=(1,)), "1 sessions"),
        (CorrectJointsRequest(Q, TIMES, sessions=(0, 0, 2**63)), "sessions"),
        (CorrectJointsRequest(((0.1, 0.2),) * 3, TIMES), "knows 3 joints"),
        (CorrectJointsRequest(((0.1, 0.2, 50.0),) * 3, TIMES), "joint 3 is 50"),
        (CorrectJointsRequest(((170.0, 0.2, 0.05),) * 3, TIMES), "joint 1 is 170"),
        (b"{}", "q"),
    ],
)
def test_bad_paths_are_named(body: CorrectJointsRequest | bytes, cause: str) -> None:
    """Empty, torn, unordered, other joints, millimetres, degrees: BAD_INPUT with what came."""
    result = refusal(body)
    assert result.status == "BAD_INPUT"
    assert cause in result.cause


def test_without_a_joint_model() -> None:
    """A server of poses says that it holds no model for joints, and how to start one."""
    result = refusal(CorrectJointsRequest(Q, TIMES), Active())
    assert result.status == "NO_MODEL"
    assert "--joints" in result.next_step


@dataclass
class Stream:
    """An estimator with a clock that the test sets."""

    active: Active
    counters: Counters
    estimator: Estimator

    def send(self, stamp: float, q: Any, *, age: float = 0.0, codec: Codec = JSON, **more: Any) -> Any:
        state = JointState(stamp, tuple(q), **more)
        sample = Request(codec.encode(state), codec.encoding("joint_state"), b"", NOW - age)
        return self.decoded(self.estimator.estimate(sample))

    @staticmethod
    def decoded(answer: tuple[bytes, str] | None) -> EstimateAnswer | None:
        if answer is None:
            return None
        return codec_of(answer[1], "estimate").decode(EstimateAnswer, answer[0])

    def count(self, status: str) -> int:
        return self.counters.counts().get("estimate", {}).get(status, 0)


MakeStream = Callable[..., Stream]


@pytest.fixture
def stream() -> MakeStream:
    def make(**options: Any) -> Stream:
        active, counters = Active(joints=lagging_joints()), Counters()
        settings = ServerSettings(replica="r1", **options)
        parser = RequestParser(active, settings, open_logger(io.StringIO()), Clock(lambda: NOW))
        return Stream(active, counters, Estimator(parser, counters))

    return make


@pytest.mark.parametrize("codec", list(CODECS.values()), ids=list(CODECS))
def test_a_stream_answers_as_the_path(stream: MakeStream, codec: Codec) -> None:
    """Sample by sample the stream says what `correct_joints` says of the whole path, in the sample's encoding."""
    rng = np.random.default_rng(1)
    path = np.cumsum(0.03 * rng.standard_normal((40, 3)), axis=0)
    times = 1.0 + 0.001 * np.arange(40)
    whole = answer(CorrectJointsRequest(tuple(map(tuple, path.tolist())), tuple(times.tolist())))
    live = stream()
    got = [live.send(t, q, codec=codec) for t, q in zip(times.tolist(), path.tolist(), strict=True)]
    np.testing.assert_allclose([one.joints for one in got], whole.joints, atol=1e-12)
    assert {one.status for one in got} == {"OK"}


def test_a_session_or_another_clock_begins_the_stream_anew(stream: MakeStream) -> None:
    """After a homing, or when the robot's clock jumped back, the slack of before is forgotten."""
    for stamp, session in ((3.0, 1), (0.5, 0)):
        live = stream()
        live.send(1.0, [0.0] * 3)
        assert live.send(2.0, [0.1] * 3).joints == pytest.approx([0.1 - SLACK] * 3)
        assert live.send(stamp, [0.1] * 3, session=session).joints == pytest.approx([0.1] * 3)


@pytest.mark.parametrize("stamp", [0.0, -1.0, math.inf, 1.7e18, 2.0, 1.9])
def test_bad_stamps_are_refused_and_counted(stream: MakeStream, stamp: float) -> None:
    """Stamp 0, none, ns, duplicates and late samples get no estimate; the stream goes on as if they had not come."""
    live = stream()
    live.send(1.0, [0.0] * 3)
    live.send(2.0, [0.1] * 3)
    if math.isfinite(stamp):
        assert live.send(stamp, [0.5] * 3) is None
    else:
        assert live.send(stamp, [0.5] * 3, codec=MSGPACK) is None
    assert live.count("BAD_INPUT") == 1
    assert live.send(2.1, [0.1] * 3).joints == pytest.approx([0.1 - SLACK] * 3)


def test_a_session_beyond_64_bits_is_refused(stream: MakeStream) -> None:
    """JSON can hold a session that no answer could repeat: the sample is refused and counted."""
    live, codec = stream(), CODECS["json"]
    state = codec.encode(JointState(1.0, (0.0,) * 3)).replace(b'"session":0', b'"session":' + b"9" * 20)
    assert b"9" * 20 in state
    assert live.estimator.estimate(Request(state, codec.encoding("joint_state"), b"", NOW)) is None
    assert live.count("BAD_INPUT") == 1


def test_a_sample_with_an_unknown_field_is_refused(stream: MakeStream) -> None:
    """A misspelt effort would be none."""
    live, codec = stream(), CODECS["json"]
    state = codec.encode(JointState(1.0, (0.0,) * 3)).replace(b'"effort"', b'"effrot"')
    assert live.estimator.estimate(Request(state, codec.encoding("joint_state"), b"", NOW)) is None
    assert live.count("BAD_INPUT") == 1


def test_old_samples_are_answered_and_called_stale(stream: MakeStream) -> None:
    """A sample that waited too long still moves the slack; its estimate says that it is old."""
    live = stream()
    live.send(1.0, [0.0] * 3)
    assert live.send(2.0, [0.1] * 3, age=0.2).status == "STALE"
    assert live.send(2.1, [0.1 - SLACK] * 3).joints == pytest.approx([0.1 - SLACK] * 3)


def test_a_new_session_makes_nothing_fresh(stream: MakeStream) -> None:
    """What waited while the arm was homed is as old as it is: its session says nothing of its age."""
    live = stream()
    assert live.send(100.0, [0.0] * 3).status == "OK"
    assert live.send(99.5, [0.0] * 3, session=1).status == "STALE"
    assert live.send(100.02, [0.0] * 3, session=1).status == "OK"


def test_missing_numbers_and_efforts(stream: MakeStream) -> None:
    """A null joint, or an effort the model needs, is MISSING; efforts of another length are refused."""
    live = stream()
    assert live.send(1.0, [None, 0.0, 0.0]).status == "MISSING"
    assert live.send(1.1, [0.0] * 3, effort=(1.0, None, 1.0)).status == "OK"
    assert live.send(1.2, [0.0] * 3, effort=(1.0,)) is None
    needy = stream()
    needy.active.activate(lagging_joints(needs_effort=True))
    assert needy.send(1.0, [0.0] * 3).status == "MISSING"
    assert needy.send(1.1, [0.0] * 3, effort=(1.0, 1.0, 1.0)).status == "OK"


def test_the_rate_of_a_streamed_correction_is_bounded(stream: MakeStream) -> None:
    """A jump of the correction is passed on no faster than the operator allows, and said."""
    live = stream(stream_rate=0.1)
    live.send(1.0, [0.0] * 3)
    result = live.send(1.01, [0.1] * 3)
    assert result.joints == pytest.approx([0.1 - 0.001] * 3)
    assert result.status == "LIMITED"


def test_another_model_begins_anew(stream: MakeStream) -> None:
    """After an activation the stream answers with the new model, and says whose answer it is."""
    live = stream()
    live.send(1.0, [0.0] * 3)
    live.active.activate(lagging_joints(digest="feed"))
    result = live.send(2.0, [0.1] * 3)
    assert (result.joints, result.model_hash) == ([0.1] * 3, "feed")


@given(payload=st.binary(max_size=200))
def test_no_bytes_bring_the_stream_down(payload: bytes) -> None:
    """Whatever bytes come, the estimator answers, or refuses and counts."""
    active, counters = Active(joints=lagging_joints()), Counters()
    logger = open_logger(io.StringIO())
    estimator = Estimator(RequestParser(active, ServerSettings(), logger, Clock(lambda: NOW)), counters)
    for encoding in ("application/json", "application/msgpack", "zenoh/bytes", "text/plain"):
        estimator.estimate(Request(payload, encoding, b"", NOW))
    assert sum(counters.counts()["estimate"].values()) == 4
