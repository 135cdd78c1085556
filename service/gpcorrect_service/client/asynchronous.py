"""The client for planners on asyncio: the same conversation without a thread that waits."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, Self, TypeVar

import zenoh

from gpcorrect_service.client.connection import POLL_SECONDS, ClientBase, Querier
from gpcorrect_service.client.replies import Reply
from gpcorrect_service.client.requests import Question
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import HealthAnswer, ModelAnswer
from gpcorrect_service.protocol.process import require_own_process

R = TypeVar("R")


class AsyncCorrectionClient(
    ClientBase[
        Coroutine[Any, Any, Reply],
        Coroutine[Any, Any, str],
        Coroutine[Any, Any, ModelAnswer],
        Coroutine[Any, Any, HealthAnswer],
    ]
):
    """:class:`gpcorrect_service.CorrectionClient` for asyncio: same parameters, same answers, awaited.

    zenoh's own thread hands replies to the event loop; no call takes a thread of its own.
    """

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """See :meth:`gpcorrect_service.CorrectionClient.close`."""
        await asyncio.to_thread(self._close)

    async def _ask(self, ask: Callable[[], Question[R]]) -> R:
        question = ask()
        try:
            answer, asked = await self._ask_servers(question)
            if (registration := self._build.registration()) is not None:
                with suppress(ServiceError):
                    await self._ask_servers(registration)
            question.require_wanted(time.monotonic() - asked)  # last thing: nothing that waits comes behind it
        except ServiceError as error:
            return question.rescue(error)
        return answer

    async def _ask_servers(self, question: Question[R]) -> tuple[R, float]:
        """Return the answer, and when it was asked for, s of the monotonic clock."""
        require_own_process()
        # Connecting may wait for the network, which the event loop must not.
        querier = self._queriers.get(question.kind)
        if querier is None:
            querier = await asyncio.to_thread(self._querier, question.kind)
        asked = question.begun
        if querier.fresh:  # only the first question waits for a server to appear
            querier.fresh = False
            await self._await_server(querier, time.monotonic() + self._settings.connect_timeout)
            asked = time.monotonic()
        answer = await self._attempt(querier, querier.first, question)
        if isinstance(answer, ServiceError):
            if not querier.matched:
                await self._await_server(querier, asked + question.patience)
            elif answer.status in ("NO_SERVICE", "OTHER_MODEL"):
                querier.suspect()
            answer = await self._attempt(querier, querier.everyone, question)
        if isinstance(answer, ServiceError):
            raise answer
        return answer, asked

    async def _await_server(self, querier: Querier, until: float) -> None:
        while not querier.matched:
            if time.monotonic() > until:
                raise querier.silence()
            await asyncio.sleep(POLL_SECONDS)

    async def _attempt(self, querier: Querier, target: zenoh.Querier, question: Question[R]) -> R | ServiceError:
        """Return the first answer without waiting for others; None comes after the last, at the end of the time."""
        loop = asyncio.get_running_loop()
        inbox: asyncio.Queue[zenoh.Reply | None] = asyncio.Queue()

        def _deliver(reply: zenoh.Reply | None) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(inbox.put_nowait, reply)

        asked = time.monotonic()
        querier.ask(target, zenoh.handlers.Callback(_deliver, lambda: _deliver(None), indirect=False), question)
        failure = None
        while (reply := await inbox.get()) is not None:
            answer = question.answer(reply, time.monotonic() - asked)
            if not isinstance(answer, ServiceError):
                return answer
            if failure is None or failure.status == "NO_SERVICE":  # what a server says is more than another's silence
                failure = answer
        return failure or querier.silence()
