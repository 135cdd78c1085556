"""The planner's clients: ask one server, retry once with all of them, and never fail in silence."""

from __future__ import annotations

import asyncio
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from typing import Any, Generic, Literal, Self, TypeVar

import zenoh
from numpy.typing import ArrayLike

from gpcorrect_service.client.connection import POLL_SECONDS, Querier
from gpcorrect_service.client.replies import PinnedModels, Reply
from gpcorrect_service.client.requests import Question, RequestBuilder
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import HealthAnswer, Kind, ModelAnswer
from gpcorrect_service.protocol.sessions import PROCESS, open_client, require_own_process
from gpcorrect_service.protocol.settings import DEFAULT_ENDPOINT, ClientSettings, OnFailure

# Replies of one query that may wait to be read: more than there are replicas, so that zenoh's thread never
# waits. A RingChannel would not do: it is gone, with what it holds, when the last reply overtakes the reader.
WAITING_REPLIES = 64

R = TypeVar("R")
ReplyOf = TypeVar("ReplyOf")
TextOf = TypeVar("TextOf")
ModelOf = TypeVar("ModelOf")
HealthOf = TypeVar("HealthOf")


class ClientBase(ABC, Generic[ReplyOf, TextOf, ModelOf, HealthOf]):
    """What makes a client, blocking or asynchronous: its session, its questions, and how a server is asked.

    A conversation is a coroutine for both, so that it is written once; those of the blocking client never pause.

    Connects with the first question, and again by itself when a server comes back.

    Parameters
    ----------
    endpoint : str or sequence of str, addresses of the servers; with several, the retry reaches all of them
    arm, namespace : str, second and first part of the keys that the server answers on
    encoding : str, "msgpack" (faster) or "json"
    timeout : float, seconds for one answer, the one retry included
    on_failure : str
        "raise", or "identity": answer with the registered pose, nothing learned in it, with `fallback="identity"` and
        the failure as status; so the command jumps by the learned part and no more. Raises where no server has answered
        before, and bad input raises either way.
    path_timeout, connect_timeout : float, seconds for a path, and for a server to appear before the first question
    config_file : path, optional, a zenoh JSON5 configuration instead of `endpoint`
    model_hash : str
        SHA-256 of the model that must answer; empty takes the one that answers first. Answers of another are refused as
        OTHER_MODEL until :meth:`change_model` is called: commands of two models may lie millimetres apart.
    pin : bool, whether that is so; without it every answer is taken, and `Reply.meta` says whose it is

    Raises
    ------
    DataError, EndpointError
        A setting that cannot be.
    """

    def __init__(
        self,
        endpoint: str | Sequence[str] = DEFAULT_ENDPOINT,
        arm: str = "arm1",
        namespace: str = "gpcorrect",
        encoding: Literal["msgpack", "json"] = "msgpack",
        timeout: float = 0.5,
        on_failure: OnFailure = "raise",
        *,
        path_timeout: float = 10.0,
        connect_timeout: float = 3.0,
        config_file: Path | None = None,
        model_hash: str = "",
        pin: bool = True,
    ) -> None:
        endpoints = (endpoint,) if isinstance(endpoint, str) else tuple(endpoint)
        self._settings = ClientSettings(endpoints, arm, namespace, timeout, path_timeout, connect_timeout, config_file)
        self._build = RequestBuilder(self._settings, encoding, on_failure, PinnedModels(model_hash, hold=pin))
        self._stack = ExitStack()
        self._session: zenoh.Session | None = None
        self._queriers: dict[Kind, Querier] = {}
        self._asked: set[Kind] = set()
        self._lock = threading.Lock()
        self._closed = False

    def correct(self, pose: ArrayLike, twist: ArrayLike | None = None) -> ReplyOf:
        """Return what to command so that the robot reaches `pose`.

        Parameters
        ----------
        pose : (7,) or (3,) array
            Desired position (m) and unit quaternion wxyz, in the frame that the model was trained in.
        twist : (6,) array, optional, desired velocity there, m/s and rad/s

        Raises
        ------
        ServiceError
            With the status of the failure; except for BAD_INPUT only when `on_failure` is "raise".
        """
        answer: ReplyOf = self._ask(lambda: self._build.correct(pose, twist))
        return answer

    def correct_path(self, poses: ArrayLike, times: ArrayLike) -> ReplyOf:
        """Return what to command so that the robot follows a path, velocities along it; raises as :meth:`correct`.

        Parameters
        ----------
        poses : (n, 7) or (n, 3) array, as for :meth:`correct`
        times : (n,) array, seconds, strictly increasing
        """
        answer: ReplyOf = self._ask(lambda: self._build.correct_path(poses, times))
        return answer

    def correct_joints(
        self, q: ArrayLike, times: ArrayLike, efforts: ArrayLike | None = None, sessions: Sequence[int] | None = None
    ) -> ReplyOf:
        """Return the true joints of a path of reported ones, or what to command, by the model's direction.

        Parameters
        ----------
        q, efforts : (n, d) arrays, rad or m, NaN where missing; efforts, as logged, for models that look at them
        times : (n,) array, seconds, strictly increasing
        sessions : n int, optional, where the number changes, the arm was homed or moved by hand
        """
        answer: ReplyOf = self._ask(lambda: self._build.correct_joints(q, times, efforts, sessions))
        return answer

    def metrics(self) -> TextOf:
        """Return the server's numbers as OpenMetrics text; raises whatever `on_failure` says, as the next two do."""
        answer: TextOf = self._ask(self._build.metrics)
        return answer

    def model(self) -> ModelOf:
        """Return which model is active and what it says of itself."""
        answer: ModelOf = self._ask(lambda: self._build.plain("model", ModelAnswer))
        return answer

    def health(self) -> HealthOf:
        """Return the server's state, queues and counts."""
        answer: HealthOf = self._ask(lambda: self._build.plain("health", HealthAnswer))
        return answer

    @abstractmethod
    def _ask(self, ask: Callable[[], Question[Any]]) -> Any:
        """Make a question, and return its answer or what waits for it."""

    @abstractmethod
    async def _connected(self, kind: Kind) -> Querier:
        """Do what :meth:`_querier` does."""

    @abstractmethod
    async def _pause(self) -> None:
        """Let `POLL_SECONDS` pass."""

    @abstractmethod
    async def _attempt(self, querier: Querier, target: zenoh.Querier, question: Question[R]) -> R | ServiceError:
        """Return the first answer without waiting for others, or the failure that says most."""

    async def _conversation(self, ask: Callable[[], Question[R]]) -> R:
        """Ask, and then for the registration that a fallback may need."""
        question = ask()
        try:
            answer, asked = await self._ask_servers(question)
            if (registration := self._build.registration()) is not None:
                with suppress(ServiceError):
                    await self._ask_registration(registration, time.monotonic() + question.patience / 2)
            question.require_wanted(time.monotonic() - asked)  # last thing: nothing that waits comes behind it
        except ServiceError as error:
            return question.rescue(error)
        return answer

    async def _ask_registration(self, registration: Question[None], until: float) -> None:
        """Ask where that key is answered; once it is waited for, and not so long that the answer in hand is stale."""
        querier = self._queriers.get(registration.kind) or await self._connected(registration.kind)
        if querier.fresh:
            querier.fresh = False
            await self._await_server(querier, until)
        if querier.matched:
            await self._ask_servers(registration)

    async def _ask_servers(self, question: Question[R]) -> tuple[R, float]:
        """Return the answer, and when it was asked for, s of the monotonic clock."""
        require_own_process()
        querier = self._queriers.get(question.kind) or await self._connected(question.kind)
        asked = question.begun
        if querier.fresh:  # only the first question waits for a server to appear
            querier.fresh = False
            await self._await_server(querier, time.monotonic() + self._settings.connect_timeout)
            asked = time.monotonic()
        answer = await self._attempt(querier, querier.first, question)
        if isinstance(answer, ServiceError):
            # Asked only now: looking at who matches costs a tenth of a query.
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
            await self._pause()

    def change_model(self, model_hash: str = "") -> None:
        """Take another model from the next answer on: where the robot rests, for the command may step.

        Parameters
        ----------
        model_hash : str, SHA-256 of the model that must answer; empty takes the one that answers first
        """
        self._build.pinned.change(model_hash)

    def _querier(self, kind: Kind) -> Querier:
        """Return the way to ask a key; connects at the first use, which may wait for the network."""
        with self._lock:
            if self._closed:
                raise ServiceError("NO_SERVICE", "this client was closed.", hint="Open another one.")
            fresh = kind not in self._asked
            self._asked.add(kind)
            if self._session is None:
                self._session = self._stack.enter_context(open_client(self._settings))
                PROCESS.holders.add(self)
            if kind not in self._queriers:
                key, timeout = f"{self._settings.arm}/{kind}", self._settings.timeout_of(kind)
                self._queriers[kind] = Querier(self._session, key, self._settings, timeout, fresh=fresh)
            return self._queriers[kind]

    def _close(self) -> None:
        if PROCESS.forked:  # closing would wait for threads that are not here
            return
        with self._lock:
            self._closed = True
            queriers = list(self._queriers.values())
            self._queriers.clear()  # first: threads that go on asking find none
            for querier in queriers:
                querier.close()
            self._session = None
            # A server that hangs does not say goodbye: zenoh gives up on it after its own while, and so is it closed.
            with suppress(zenoh.ZError):
                self._stack.close()


class CorrectionClient(ClientBase[Reply, str, ModelAnswer, HealthAnswer], AbstractContextManager["CorrectionClient"]):
    """Asks a correction server from a planner; a context manager, safe to use from several threads.

    Questions and parameters: see :class:`gpcorrect_service.client.clients.ClientBase`.
    """

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; questions after that are answered NO_SERVICE."""
        self._close()

    def _ask(self, ask: Callable[[], Question[R]]) -> R:
        conversation = self._conversation(ask)
        try:
            conversation.send(None)
        except StopIteration as end:
            answer: R = end.value
            return answer
        raise AssertionError("a conversation that blocks does not pause")

    async def _connected(self, kind: Kind) -> Querier:
        return self._querier(kind)

    async def _pause(self) -> None:
        time.sleep(POLL_SECONDS)  # runs in no event loop

    async def _attempt(self, querier: Querier, target: zenoh.Querier, question: Question[R]) -> R | ServiceError:
        """See :class:`ClientBase`; the channel closes when the time is over."""
        failure, asked = None, time.monotonic()
        for reply in querier.ask(target, zenoh.handlers.FifoChannel(WAITING_REPLIES), question):
            answer = question.answer(reply, time.monotonic() - asked)
            if not isinstance(answer, ServiceError):
                return answer
            failure = _graver(failure, answer)
        return failure or querier.silence()


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

    def _ask(self, ask: Callable[[], Question[R]]) -> Coroutine[Any, Any, R]:
        return self._conversation(ask)

    async def _connected(self, kind: Kind) -> Querier:
        # Connecting may wait for the network, which the event loop must not.
        return await asyncio.to_thread(self._querier, kind)

    async def _pause(self) -> None:
        await asyncio.sleep(POLL_SECONDS)

    async def _attempt(self, querier: Querier, target: zenoh.Querier, question: Question[R]) -> R | ServiceError:
        """See :class:`ClientBase`; None comes after the last reply, at the end of the time."""
        loop = asyncio.get_running_loop()
        inbox: asyncio.Queue[zenoh.Reply | None] = asyncio.Queue()

        def _deliver(reply: zenoh.Reply | None) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(inbox.put_nowait, reply)

        failure, asked = None, time.monotonic()
        querier.ask(target, zenoh.handlers.Callback(_deliver, lambda: _deliver(None), indirect=False), question)
        while (reply := await inbox.get()) is not None:
            answer = question.answer(reply, time.monotonic() - asked)
            if not isinstance(answer, ServiceError):
                return answer
            failure = _graver(failure, answer)
        return failure or querier.silence()


def _graver(failure: ServiceError | None, other: ServiceError) -> ServiceError:
    """Return which failure to tell of: what a server says is more than another's silence."""
    return other if failure is None or failure.status == "NO_SERVICE" else failure
