"""A full queue, an expired request, a stop in the middle: the model waits for a gate, so nothing is timed."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest
from service_support import PATIENT, POSE, ServerProcess, ask_bare, server_process, stranger, wait_for

from gpcorrect_service import CorrectionClient, ServiceError
from gpcorrect_service.protocol.messages import JSON, CorrectRequest, ErrorAnswer, RequestMeta

REQUEST = JSON.encode(CorrectRequest(tuple(POSE)))


class Askers:
    """Threads that each ask one correction; keeps the status that each got."""

    def __init__(self, client: CorrectionClient) -> None:
        self._client = client
        self._statuses: list[str] = []
        self._threads: list[threading.Thread] = []

    def ask(self, count: int) -> None:
        """Start `count` questions."""
        threads = [threading.Thread(target=self._ask, daemon=True) for _ in range(count)]
        self._threads += threads
        for thread in threads:
            thread.start()

    def _ask(self) -> None:
        try:
            self._statuses.append(self._client.correct(POSE).status)
        except ServiceError as error:
            self._statuses.append(error.status)

    def statuses(self) -> list[str]:
        """Return how all of them ended."""
        for thread in self._threads:
            thread.join(2 * PATIENT)
        return sorted(self._statuses)


@dataclass(frozen=True)
class Stuck:
    """A server whose worker is inside the model, with requests in its queue."""

    server: ServerProcess
    client: CorrectionClient
    askers: Askers

    def counted(self, status: str) -> int:
        """Return how many corrections the server says ended so."""
        return self.client.health().counts.get("correct", {}).get(status, 0)


@contextmanager
def stuck_server(waiting: int, timeout: float = PATIENT, **settings: Any) -> Iterator[Stuck]:
    with (
        server_process("gated", **settings) as server,
        server.client() as client,
        server.client(timeout=timeout) as planner,
    ):
        askers = Askers(planner)
        askers.ask(1)
        assert server.entered.wait(PATIENT)
        askers.ask(waiting)
        wait_for(lambda: client.health().queued["correct"] == waiting)
        yield Stuck(server, client, askers)


def test_full_queue_is_busy_and_the_rest_still_answers() -> None:
    """With the worker stuck and the queue full, one more hears BUSY; health, model and paths answer."""
    with stuck_server(3, queue_capacity=3) as stuck:
        late = Askers(stuck.client)
        late.ask(5)
        assert late.statuses() == ["BUSY"] * 5
        health = stuck.client.health()
        assert (health.state, health.queued["correct"]) == ("ENABLED", 3)
        assert stuck.client.model().id == "gated-model"
        assert stuck.client.correct_path([POSE, POSE], [0.0, 0.1]).status == ("OK", "OK")
        stuck.server.gate.set()
        assert stuck.askers.statuses() == ["OK"] * 4
        assert (stuck.counted("OK"), stuck.counted("BUSY")) == (
            4,
            10,
        )  # each BUSY was asked twice: nearest, then all


def test_busy_is_an_error_where_no_registration_is_known() -> None:
    """A planner that chose identity, and was never answered, gets no pose in the tracker's frame: it is told BUSY."""
    with (
        stuck_server(1, queue_capacity=1) as stuck,
        stuck.server.client(on_failure="identity") as client,
        pytest.raises(ServiceError, match="BUSY"),
    ):
        client.correct(POSE)


def test_a_request_that_waited_too_long_is_stale() -> None:
    """What expires in the queue is answered STALE when its turn comes, and the model is not asked."""
    with stuck_server(1) as stuck, stranger(stuck.server.endpoint) as session:
        replies: list[Any] = []
        attachment = JSON.encode(RequestMeta(request_id="old", deadline=0.01))
        arguments = (session, "gpcorrect/arm1/correct", REQUEST, "application/json", attachment)
        asker = threading.Thread(target=lambda: replies.extend(ask_bare(*arguments)), daemon=True)
        asker.start()
        wait_for(lambda: stuck.client.health().queued["correct"] == 2)
        time.sleep(0.02)
        stuck.server.gate.set()
        asker.join(PATIENT)
        result = JSON.decode(ErrorAnswer, replies[0].err.payload.to_bytes())
        assert (result.status, result.request_id) == ("STALE", "old")
        assert stuck.askers.statuses() == ["OK", "OK"]
        assert stuck.counted("OK") == 2


def test_a_hung_server_is_no_service_within_the_time() -> None:
    """A server that never answers costs the planner its timeout, not its life; what it asked expires."""
    with stuck_server(0) as stuck, stuck.server.client(timeout=0.2, on_failure="identity") as client:
        client.health()
        with pytest.raises(ServiceError, match="NO_SERVICE"):
            client.correct(POSE)
        stuck.server.gate.set()
        wait_for(lambda: stuck.counted("STALE") == 2)


def test_sigterm_answers_what_waits() -> None:
    """After SIGTERM no new query is taken, those that wait are answered, and the process ends well."""
    with stuck_server(3, drain_seconds=PATIENT) as stuck, stranger(stuck.server.endpoint) as session:
        querier = session.declare_querier("gpcorrect/arm1/correct")
        wait_for(lambda: querier.matching_status.matching)
        stuck.server.process.terminate()
        wait_for(lambda: not querier.matching_status.matching)
        stuck.server.gate.set()
        assert stuck.askers.statuses() == ["OK"] * 4
        assert stuck.server.exit_status() == 0


def test_sigterm_does_not_wait_for_a_hung_model() -> None:
    """A model that hangs cannot keep the process: it ends by itself, and nobody gets OK."""
    with stuck_server(3, timeout=2.0, drain_seconds=0.1) as stuck:
        stuck.server.process.terminate()
        assert stuck.server.exit_status() == 0
        assert set(stuck.askers.statuses()) <= {"BUSY", "NO_SERVICE"}
