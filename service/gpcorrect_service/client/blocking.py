"""The planner's client: ask one server, retry once with all of them, and never fail in silence."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Self, TypeVar

import zenoh

from gpcorrect_service.client.connection import POLL_SECONDS, ClientBase, Querier
from gpcorrect_service.client.replies import Reply
from gpcorrect_service.client.requests import Question
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import HealthAnswer, ModelAnswer
from gpcorrect_service.protocol.process import require_own_process

# Replies of one query that may wait to be read: more than there are replicas, so that zenoh's thread never
# waits. A RingChannel would not do: it is gone, with what it holds, when the last reply overtakes the reader.
WAITING_REPLIES = 64

R = TypeVar("R")


class CorrectionClient(ClientBase[Reply, str, ModelAnswer, HealthAnswer]):
    """Asks a correction server from a planner; a context manager, safe to use from several threads.

    Questions and parameters: see :class:`gpcorrect_service.client.connection.ClientBase`.
    """

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; questions after that are answered NO_SERVICE."""
        self._close()

    def _ask(self, ask: Callable[[], Question[R]]) -> R:
        question = ask()
        try:
            answer, asked = self._ask_servers(question)
            if (registration := self._build.registration()) is not None:
                with suppress(ServiceError):
                    self._ask_servers(registration)
            question.require_wanted(time.monotonic() - asked)  # last thing: nothing that waits comes behind it
        except ServiceError as error:
            return question.rescue(error)
        return answer

    def _ask_servers(self, question: Question[R]) -> tuple[R, float]:
        """Return the answer, and when it was asked for, s of the monotonic clock."""
        require_own_process()
        querier = self._queriers.get(question.kind) or self._querier(question.kind)
        asked = question.begun
        if querier.fresh:  # only the first question waits for a server to appear
            querier.fresh = False
            self._await_server(querier, time.monotonic() + self._settings.connect_timeout)
            asked = time.monotonic()
        answer = self._attempt(querier, querier.first, question)
        if isinstance(answer, ServiceError):
            # Asked only now: looking at who matches costs a tenth of a query.
            if not querier.matched:
                self._await_server(querier, asked + question.patience)
            elif answer.status in ("NO_SERVICE", "OTHER_MODEL"):
                querier.suspect()
            answer = self._attempt(querier, querier.everyone, question)
        if isinstance(answer, ServiceError):
            raise answer
        return answer, asked

    def _await_server(self, querier: Querier, until: float) -> None:
        while not querier.matched:
            if time.monotonic() > until:
                raise querier.silence()
            time.sleep(POLL_SECONDS)

    def _attempt(self, querier: Querier, target: zenoh.Querier, question: Question[R]) -> R | ServiceError:
        """Return the first answer without waiting for others; the channel closes when the time is over."""
        failure, asked = None, time.monotonic()
        for reply in querier.ask(target, zenoh.handlers.FifoChannel(WAITING_REPLIES), question):
            answer = question.answer(reply, time.monotonic() - asked)
            if not isinstance(answer, ServiceError):
                return answer
            if failure is None or failure.status == "NO_SERVICE":  # what a server says is more than another's silence
                failure = answer
        return failure or querier.silence()
