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


@pytest.mark.parametrize("back", [0.13, 0.3, 0.9, 2.0, 60.0, 4000.0])
@pytest.mark.parametrize("every", [0.001, 0.01, 0.1])
def test_a_clock_that_is_set_back_is_believed_after_a_second(back: float, every: float) -> None:
    """Stamps that go back, by a step of NTP or by an hour, are late for a second and no longer."""
    clock, rng = StreamClock(), np.random.default_rng(0)
    times = np.arange(0.0, 6.0, every)
    late = [clock.delay(5000.0 + t - (back if t > 2.0 else 0.0), t + rng.uniform(0.0, 0.01)) for t in times]
    after = np.array(late)[times > 2.0]
    assert min(after[: int(0.9 / every)]) > back - 0.02
    assert max(after[int(1.3 / every) :]) < 0.025


def test_a_backlog_is_never_taken_for_a_clock_that_was_set() -> None:
    """What was held up comes in order: late by the same for a minute, draining, or after a straggler, it is late."""
    full, draining, stopped = StreamClock(), StreamClock(), StreamClock()
    for clock in (full, draining, stopped):
        for t in STEADY:
            clock.delay(5000.0 + t, t)
    assert min(full.delay(5000.0 + t, t + 0.5) for t in np.arange(2.0, 62.0, 0.01)) > 0.4
    # From here on messages overtake each other: a batch of four comes turned around.
    turned = [t + 0.01 * k for t in np.arange(2.0, 8.0, 0.04) for k in (3, 2, 1, 0)]
    lags = 3.0 - 0.5 * (np.array(turned) - 2.0)
    late = [draining.delay(5000.0 + t, t + lag) for t, lag in zip(turned, lags, strict=True)]
    assert np.all(np.array(late) > lags - 0.05)
    assert stopped.delay(5001.89, 2.0) == pytest.approx(0.1, abs=0.02)
    assert min(stopped.delay(5002.0 + t, 7.0 + 0.5 * t) for t in np.arange(0.0, 5.0, 0.01)) > 2.0


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


@pytest.mark.parametrize("back", [0.3, 0.9, 2.0])
def test_a_robots_clock_that_is_set_back_costs_a_second_of_estimates(back: float) -> None:
    """Where the robot's clock is stepped back, samples that seem to have come already get none, and all are OK soon."""
    now = [10.0]
    parser = RequestParser(
        Active(None, lagging_joints()), ServerSettings(), open_logger(io.StringIO()), Clock(lambda: now[0])
    )
    estimator = Estimator(parser, Counters())

    def status(stamp: float) -> str | None:
        payload = MSGPACK.encode(JointState(float(stamp), (0.0, 0.0, 0.1)))
        answered = estimator.estimate(Request(payload, MSGPACK.encoding("joint_state"), b"", now[0]))
        return None if answered is None else MSGPACK.decode(EstimateAnswer, answered[0]).status

    said: list[str | None] = []
    for t in np.arange(0.0, 5.0, 0.005):
        now[0] = 10.0 + t
        said.append(status(1.8e9 + t - (back if t > 2.0 else 0.0)))
    assert set(said[:400]) == {"OK"}
    assert "OK" not in said[401:590]
    assert set(said[620:]) == {"OK"}


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
