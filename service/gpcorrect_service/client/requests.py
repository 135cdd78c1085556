"""What both clients share: the session, the keys they ask, and questions that can read their answer."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

import msgspec
import zenoh
from numpy.typing import ArrayLike

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect_service.client.exchange import Exchange, Message, array, gaps, no_service, numbers
from gpcorrect_service.client.replies import CorrectionReply, JointsReply, PathReply
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.sessions import open_client
from gpcorrect_service.protocol.settings import DEFAULT_ENDPOINT, ClientSettings, OnFailure
from gpcorrect_service.protocol.wire_joints import CorrectJointsAnswer, CorrectJointsRequest, Row

__all__ = ["Call", "ClientBase", "Desk", "Line"]

S = TypeVar("S", bound=msgspec.Struct)
R = TypeVar("R")

SUSPICION_SECONDS = 10.0  # after which zenoh itself drops a server that hangs
# Another replica may do better with these; bad input is bad everywhere.
WORTH_A_RETRY = frozenset({"BUSY", "STALE", "NO_MODEL", "INTERNAL", "NO_SERVICE"})


class Line:
    """Two ways to ask one key: the nearest server, then every server.

    zenoh always sends to the same nearest server and does not leave one that hangs, hence the second way; while the
    nearest one is under suspicion, every server is asked at once.
    """

    def __init__(self, session: zenoh.Session, key: str, timeout: float) -> None:
        def declare(target: zenoh.QueryTarget) -> zenoh.Querier:
            return session.declare_querier(
                key,
                target=target,
                # Replies pass as they come; the default holds them back until every server has answered.
                consolidation=zenoh.ConsolidationMode.NONE,
                # A server that stopped reading must not stop the planner as well.
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=timeout / 2,
            )

        self._nearest, self._everyone = declare(zenoh.QueryTarget.BEST_MATCHING), declare(zenoh.QueryTarget.ALL)
        self._trusted_from = -math.inf
        self.timeout = timeout
        self.fresh = True

    @property
    def matched(self) -> bool:
        """Whether some server declares this key now."""
        status: Any = self._nearest.matching_status  # zenoh's stubs say bool; it is a MatchingStatus
        return bool(status.matching)

    def attempts(self) -> tuple[zenoh.Querier, zenoh.Querier]:
        """Return whom to ask first, and whom when that fails."""
        trusted = time.monotonic() >= self._trusted_from
        return (self._nearest if trusted else self._everyone), self._everyone

    def suspect(self) -> None:
        """Note that the nearest server kept silent: for a while it is not asked alone."""
        self._trusted_from = time.monotonic() + SUSPICION_SECONDS


class Call(msgspec.Struct, Generic[R], frozen=True, eq=False):
    """One question.

    Parameters
    ----------
    kind : str
        Which key is asked.
    message : Message
        What is sent.
    read : callable
        From zenoh's reply to the planner's; raises the server's refusal.
    fallback : callable or None
        From the failure to the answer that replaces it; None raises the failure.
    """

    kind: wire.Kind
    message: Message
    read: Callable[[zenoh.Reply], R]
    fallback: Callable[[ServiceError], R] | None = None

    def hear(self, reply: zenoh.Reply) -> R | ServiceError:
        """Return the answer in a reply, or the failure when another reply may be better.

        Raises
        ------
        ServiceError
            The failure is final.
        """
        try:
            return self.read(reply)
        except ServiceError as error:
            if error.status not in WORTH_A_RETRY:
                raise
            return error

    def rescue(self, error: ServiceError) -> R:
        """Return the fallback.

        Raises
        ------
        ServiceError
            The failure itself, where there is no fallback or the caller's own input is at fault.
        """
        if self.fallback is None or error.status == "BAD_INPUT":
            raise error
        return self.fallback(error)


class Desk:
    """Writes a client's questions and holds its session, which opens with the first of them.

    Parameters
    ----------
    settings : ClientSettings
        Whom to ask.
    encoding : str
        "msgpack" or "json".
    on_failure : str
        "raise" or "identity".
    """

    def __init__(self, settings: ClientSettings, encoding: str, on_failure: OnFailure) -> None:
        if on_failure not in ("raise", "identity"):
            raise DataError(f"on_failure must be 'raise' or 'identity', got {on_failure!r}.")
        self.settings = settings
        self._exchange = Exchange(encoding)
        self._identity = on_failure == "identity"
        self._stack = ExitStack()
        self._session: zenoh.Session | None = None
        self._lines: dict[wire.Kind, Line] = {}
        self._lock = threading.Lock()
        self._closed = False

    def open_line(self, kind: wire.Kind) -> Line | None:
        """Return the way to ask `kind` if it has been used before."""
        return self._lines.get(kind)

    def line(self, kind: wire.Kind) -> Line:
        """Return the way to ask `kind`; connects at the first use.

        Raises
        ------
        ServiceError
            NO_SERVICE: the client was closed, or its configuration demands a connection that there is not.
        """
        with self._lock:
            if self._closed:
                raise ServiceError("NO_SERVICE", "this client was closed.", hint="Open another one.")
            if self._session is None:
                self._session = self._stack.enter_context(open_client(self.settings))
            if kind not in self._lines:
                self._lines[kind] = Line(self._session, f"{self.settings.arm}/{kind}", self._timeout(kind))
            return self._lines[kind]

    def close(self) -> None:
        """Close the session."""
        with self._lock:
            self._closed = True
            self._lines.clear()
            self._session = None
            # A server that hangs does not say goodbye: zenoh gives up on it after its own while, and so is it closed.
            with suppress(zenoh.ZError):
                self._stack.close()

    def patience(self, line: Line) -> float:
        """Return how long, s, to wait for a server to appear: only the first question may wait longer."""
        first, line.fresh = line.fresh, False
        return self.settings.connect_timeout if first else min(self.settings.connect_timeout, line.timeout)

    def silence(self) -> ServiceError:
        """Return the error of a query that nobody answered."""
        return no_service(settings=self.settings)

    def correct(self, pose: ArrayLike, twist: ArrayLike | None) -> Call[CorrectionReply]:
        """Return the question what to command instead of `pose`."""
        asked = tuple(numbers(pose, "pose"))
        body = wire.CorrectRequest(asked, None if twist is None else tuple(numbers(twist, "twist")))

        def read(reply: zenoh.Reply) -> CorrectionReply:
            answer, beside = self._exchange.read(reply, wire.CorrectAnswer)
            return CorrectionReply.received(answer, self._exchange.read_meta(beside))

        fallback = (lambda error: CorrectionReply.identity(asked, error)) if self._identity else None
        return Call("correct", self._message("correct", body), read, fallback)

    def correct_path(self, poses: ArrayLike, times: ArrayLike) -> Call[PathReply]:
        """Return the question what to command instead of a path."""
        asked = tuple(numbers(poses, "poses"))
        body = wire.CorrectPathRequest(asked, tuple(numbers(times, "times")))

        def read(reply: zenoh.Reply) -> PathReply:
            answer, beside = self._exchange.read(reply, wire.CorrectPathAnswer)
            return PathReply.received(answer, self._exchange.read_meta(beside))

        fallback = (lambda error: PathReply.identity(asked, error)) if self._identity else None
        return Call("correct_path", self._message("correct_path", body), read, fallback)

    def correct_joints(
        self, q: ArrayLike, times: ArrayLike, efforts: ArrayLike | None, sessions: Sequence[int] | None
    ) -> Call[JointsReply]:
        """Return the question what true joints belong to a path of joints."""
        joints = array(q, "joints", 2)
        body = CorrectJointsRequest(
            _gap_rows(joints),
            tuple(numbers(times, "times")),
            None if efforts is None else _gap_rows(array(efforts, "efforts", 2)),
            None if sessions is None else tuple(int(one) for one in sessions),
        )

        def read(reply: zenoh.Reply) -> JointsReply:
            answer, beside = self._exchange.read(reply, CorrectJointsAnswer)
            return JointsReply.received(answer, self._exchange.read_meta(beside))

        fallback = (lambda error: JointsReply.identity(joints, error)) if self._identity else None
        return Call("correct_joints", self._message("correct_joints", body), read, fallback)

    def metrics(self) -> Call[str]:
        """Return the question for the server's numbers."""
        return Call("metrics", self._message("metrics", None), self._exchange.read_text)

    def model(self) -> Call[wire.ModelAnswer]:
        """Return the question which model is active."""
        return self._plain("model", wire.ModelAnswer)

    def health(self) -> Call[wire.HealthAnswer]:
        """Return the question how the server is."""
        return self._plain("health", wire.HealthAnswer)

    def _plain(self, kind: wire.Kind, form: type[S]) -> Call[S]:
        return Call(kind, self._message(kind, None), lambda reply: self._exchange.read(reply, form)[0])

    def _message(self, kind: wire.Kind, body: msgspec.Struct | None) -> Message:
        return self._exchange.message(kind, body, deadline=self._timeout(kind) / 2)

    def _timeout(self, kind: wire.Kind) -> float:
        return self.settings.path_timeout if kind in ("correct_path", "correct_joints") else self.settings.timeout


def _gap_rows(values: FloatArray) -> tuple[Row, ...]:
    return tuple(tuple(gaps(row)) for row in values.tolist())


class ClientBase:
    """What makes a client, waiting or awaited.

    Connects with the first question, and again by itself when a server comes back.

    Parameters
    ----------
    endpoint : str or sequence of str
        Addresses of the servers; with several, the retry reaches all of them.
    arm, namespace : str
        Second and first part of the keys that the server answers on.
    encoding : str
        "msgpack" (faster) or "json".
    timeout : float
        Seconds for one answer, the one retry included.
    on_failure : str
        "raise", or "identity": hand the desired pose back uncorrected, with `fallback="identity"` and the
        failure as status. Bad input raises either way.
    path_timeout, connect_timeout : float
        Seconds for a path, and for a server to appear before the first question.
    config_file : path, optional
        A zenoh JSON5 configuration instead of `endpoint`.

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
    ) -> None:
        endpoints = (endpoint,) if isinstance(endpoint, str) else tuple(endpoint)
        settings = ClientSettings(endpoints, arm, namespace, timeout, path_timeout, connect_timeout, config_file)
        self._desk = Desk(settings, encoding, on_failure)
