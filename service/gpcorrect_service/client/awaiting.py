"""The client for planners on asyncio: the same conversation without a thread that waits."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from types import TracebackType
from typing import Self, TypeVar

import zenoh
from numpy.typing import ArrayLike

from gpcorrect_service.client.replies import CorrectionReply, JointsReply, PathReply
from gpcorrect_service.client.requests import Call, ClientBase, Line
from gpcorrect_service.client.waiting import POLL_SECONDS
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.wire import HealthAnswer, ModelAnswer

__all__ = ["AsyncCorrectionClient"]

R = TypeVar("R")


class AsyncCorrectionClient(ClientBase):
    """:class:`gpcorrect_service.CorrectionClient` for asyncio: same parameters, same answers, awaited.

    zenoh's own thread hands replies to the event loop; no call takes a thread of its own.
    """

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """See :meth:`gpcorrect_service.CorrectionClient.close`."""
        await asyncio.to_thread(self._desk.close)

    async def correct(self, pose: ArrayLike, twist: ArrayLike | None = None) -> CorrectionReply:
        """See :meth:`gpcorrect_service.CorrectionClient.correct`."""
        return await self._ask(self._desk.correct(pose, twist))

    async def correct_path(self, poses: ArrayLike, times: ArrayLike) -> PathReply:
        """See :meth:`gpcorrect_service.CorrectionClient.correct_path`."""
        return await self._ask(self._desk.correct_path(poses, times))

    async def correct_joints(
        self,
        q: ArrayLike,
        times: ArrayLike,
        efforts: ArrayLike | None = None,
        sessions: Sequence[int] | None = None,
    ) -> JointsReply:
        """See :meth:`gpcorrect_service.CorrectionClient.correct_joints`."""
        return await self._ask(self._desk.correct_joints(q, times, efforts, sessions))

    async def metrics(self) -> str:
        """See :meth:`gpcorrect_service.CorrectionClient.metrics`."""
        return await self._ask(self._desk.metrics())

    async def model(self) -> ModelAnswer:
        """See :meth:`gpcorrect_service.CorrectionClient.model`."""
        return await self._ask(self._desk.model())

    async def health(self) -> HealthAnswer:
        """See :meth:`gpcorrect_service.CorrectionClient.health`."""
        return await self._ask(self._desk.health())

    async def _ask(self, call: Call[R]) -> R:
        try:
            return await self._ask_servers(call)
        except ServiceError as error:
            return call.rescue(error)

    async def _ask_servers(self, call: Call[R]) -> R:
        # Connecting may wait for the network, which the event loop must not.
        line = self._desk.open_line(call.kind)
        if line is None:
            line = await asyncio.to_thread(self._desk.line, call.kind)
        if line.fresh:
            await self._await_server(line)
        first, second = line.attempts()
        answer = await self._attempt(first, call)
        if isinstance(answer, ServiceError):
            if not line.matched:
                await self._await_server(line)
            elif answer.status == "NO_SERVICE":
                line.suspect()
            answer = await self._attempt(second, call)
        if isinstance(answer, ServiceError):
            raise answer
        return answer

    async def _await_server(self, line: Line) -> None:
        loop = asyncio.get_running_loop()
        until = loop.time() + self._desk.patience(line)
        while not line.matched:
            if loop.time() > until:
                raise self._desk.silence()
            await asyncio.sleep(POLL_SECONDS)

    async def _attempt(self, querier: zenoh.Querier, call: Call[R]) -> R | ServiceError:
        """Return the first answer without waiting for others."""
        failure = None
        inbox = self._send(querier, call)
        while (reply := await inbox.get()) is not None:
            answer = call.hear(reply)
            if not isinstance(answer, ServiceError):
                return answer
            failure = answer
        return failure or self._desk.silence()

    def _send(self, querier: zenoh.Querier, call: Call[R]) -> asyncio.Queue[zenoh.Reply | None]:
        """Return where replies arrive; None comes after the last, at the latest when time is over."""
        loop, message = asyncio.get_running_loop(), call.message
        inbox: asyncio.Queue[zenoh.Reply | None] = asyncio.Queue()

        def deliver(reply: zenoh.Reply | None) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(inbox.put_nowait, reply)

        try:
            querier.get(
                zenoh.handlers.Callback(deliver, lambda: deliver(None), indirect=False),
                payload=message.payload,
                encoding=message.encoding,
                attachment=message.attachment,
            )
        except zenoh.ZError as error:
            raise self._desk.silence() from error
        return inbox
