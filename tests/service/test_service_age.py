"""Nothing old is answered as if it were new: ages by one's own clock, whatever another one shows."""

from __future__ import annotations

import io
from types import SimpleNamespace

import numpy as np
import pytest
from service_support import lagging_joints

from gpcorrect_service import ClientSettings, ServerSettings
from gpcorrect_service.client.requests import RequestBuilder
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.metrics import Counters
from gpcorrect_service.protocol.answer import EstimateAnswer
from gpcorrect_service.protocol.bounds import StreamClock
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import MSGPACK, JointState
from gpcorrect_service.server.estimator import Estimator
from gpcorrect_service.server.models import Active
from gpcorrect_service.server.requests import Clock, Request, RequestParser

STEADY = 0.01 * np.arange(200)  # s


@pytest.mark.parametrize("offset", [-3600.0, 0.0, 1.8e9])
def test_where_a_clock_was_set_to_plays_no_part(offset: float) -> None:
    """A message that was held up for a while is late by that while, however far apart the clocks are."""
    clock = StreamClock()
    for t in STEADY:
        clock.delay(offset + t + 4000.0, t + 0.002)
    assert clock.delay(offset + 4002.0, 7.0) == pytest.approx(4.998, abs=0.01)
    assert clock.age(offset + 4002.0, 7.0) == pytest.approx(4.998, abs=0.01)


def test_a_clock_that_drifts_is_followed() -> None:
    """A quartz that is off by 100 in a million for an hour makes no message late."""
    clock = StreamClock()
    late = [clock.delay((1 - 1e-4) * t, t) for t in np.arange(0.0, 3600.0, 0.1)]
    assert max(late) < 0.001


def test_a_clock_that_is_set_back_is_believed_after_a_second() -> None:
    """Stamps of long ago are messages that were held up, until they go on coming for a second."""
    clock = StreamClock()
    for t in STEADY:
        clock.delay(5000.0 + t, t)
    late = [clock.delay(1000.0 + t, 2.0 + t) for t in STEADY]
    assert min(late[:100]) > 1.0
    assert late[-1] == pytest.approx(0.0, abs=0.01)


def test_estimates_of_samples_that_waited_in_a_socket_are_stale() -> None:
    """A server that was stopped for five seconds says STALE of all that came in meanwhile, and OK of what is new."""
    now = [10.0]
    clock = Clock(lambda: now[0])
    parser = RequestParser(Active(None, lagging_joints()), ServerSettings(), open_logger(io.StringIO()), clock)
    estimator = Estimator(parser, Counters())

    def status(stamp: float) -> str:
        payload = MSGPACK.encode(JointState(float(stamp), (0.0, 0.0, 0.1)))
        answered = estimator.estimate(Request(payload, MSGPACK.encoding("joint_state"), b"", now[0]))
        assert answered is not None
        return MSGPACK.decode(EstimateAnswer, answered[0]).status

    for t in STEADY:
        now[0] = 10.0 + t
        assert status(1.8e9 + t) == "OK"
    now[0] = 17.0
    assert {status(1.8e9 + t) for t in np.arange(2.01, 6.9, 0.05)} == {"STALE"}
    assert status(1.8e9 + 7.0) == "OK"


def test_only_the_newest_of_old_samples_is_answered() -> None:
    """Of samples that waited, those that others wait behind are counted, and the last one is answered."""
    now, counters = [10.0], Counters()
    parser = RequestParser(
        Active(None, lagging_joints()), ServerSettings(), open_logger(io.StringIO()), Clock(lambda: now[0])
    )
    estimator = Estimator(parser, counters)

    def sent(stamp: float, *, newest: bool) -> bool:
        payload = MSGPACK.encode(JointState(stamp, (0.0, 0.0, 0.1)))
        sample = Request(payload, MSGPACK.encoding("joint_state"), b"", now[0])
        return estimator.estimate(sample, newest=newest) is not None

    assert sent(100.0, newest=False)
    now[0] += 0.1
    assert not sent(100.06, newest=False)
    assert sent(100.08, newest=True)
    assert sent(100.1, newest=False)
    assert counters.counts()["estimate"] == {"OK": 3, "SKIPPED": 1}


def test_a_reply_of_long_ago_is_not_taken() -> None:
    """A planner that was stopped finds a reply in its socket when it goes on; it is STALE and not the answer."""
    question = RequestBuilder(ClientSettings(timeout=0.5), "json").correct([0.1, 0.0, -0.1, 1, 0, 0, 0], None)
    late = question.answer(SimpleNamespace(ok="never read"), 5.0)  # type: ignore[arg-type]
    assert isinstance(late, ServiceError)
    assert late.status == "STALE"
