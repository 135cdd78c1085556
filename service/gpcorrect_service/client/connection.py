"""A client's session and its keys: who is asked first, who next, and how long a server is waited for."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

import zenoh
from numpy.typing import ArrayLike

from gpcorrect_service.client.pinned import PinnedModels
from gpcorrect_service.client.requests import Question, RequestBuilder, no_service
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import HealthAnswer, Kind, ModelAnswer
from gpcorrect_service.protocol.process import immortal_in_children, is_forked
from gpcorrect_service.protocol.sessions import open_client
from gpcorrect_service.protocol.settings import DEFAULT_ENDPOINT, ClientSettings, OnFailure

POLL_SECONDS = 0.002  # chosen by hand: between looks at whether a server has appeared
SUSPICION_SECONDS = 10.0  # after which zenoh itself drops a server that hangs (its lease)


def matched(querier: zenoh.Querier) -> bool:
    """Whether some server declares a querier's key now.

    Parameters
    ----------
    querier : zenoh.Querier
    """
    status: Any = querier.matching_status  # zenoh's stubs say bool; it is a MatchingStatus
    return bool(status.matching)


def _undeclared(querier: zenoh.Querier) -> bool:
    """Undeclare a querier, unless another thread sends a question with it just now: then zenoh has it "borrowed"."""
    try:
        querier.undeclare()  # type: ignore[no-untyped-call]
    except RuntimeError:
        return False
    return True


class Querier:
    """Two ways to ask one key: the nearest server, then every server.

    zenoh always sends to the same nearest server and does not leave one that hangs, hence the second way; while the
    nearest one is under suspicion, every server is asked at once.

    Parameters
    ----------
    session : zenoh.Session
    key : str
    settings : ClientSettings
    timeout : float
        Seconds for one answer, the retry included.
    fresh : bool
        Whether nothing was asked of this key before: that question may wait for a server.
    """

    def __init__(
        self, session: zenoh.Session, key: str, settings: ClientSettings, timeout: float, *, fresh: bool
    ) -> None:
        self._nearest, self.everyone = (
            session.declare_querier(
                key,
                target=target,
                # Replies pass as they come; the default holds them back until every server has answered.
                consolidation=zenoh.ConsolidationMode.NONE,
                # A server that stopped reading must not stop the planner as well.
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=timeout / 2,
            )
            for target in (zenoh.QueryTarget.BEST_MATCHING, zenoh.QueryTarget.ALL)
        )
        self._settings = settings
        self._trusted_from = -math.inf
        self.fresh = fresh

    @property
    def matched(self) -> bool:
        """Whether some server declares this key now; none does once the client was closed, in whichever thread."""
        try:
            return matched(self._nearest)
        except (zenoh.ZError, RuntimeError):  # RuntimeError: "already mutably borrowed", by the thread that closes it
            return False

    @property
    def first(self) -> zenoh.Querier:
        """Whom to ask first."""
        return self._nearest if time.monotonic() >= self._trusted_from else self.everyone

    def suspect(self) -> None:
        """Note that the nearest server is silent or has another model: for a while it is not asked alone."""
        self._trusted_from = time.monotonic() + SUSPICION_SECONDS

    def ask(self, querier: zenoh.Querier, handler: Any, question: Question[Any]) -> Any:
        """Send a question; return what zenoh makes of the handler. NO_SERVICE where the session is closed.

        Parameters
        ----------
        querier : zenoh.Querier
            :attr:`first` or :attr:`everyone`.
        handler
            zenoh's, for the replies.
        question : Question
        """
        try:
            return querier.get(
                handler, payload=question.payload, encoding=question.encoding, attachment=question.attachment
            )
        except (zenoh.ZError, RuntimeError) as error:  # as in `matched`
            raise self.silence() from error

    def close(self) -> None:
        """Take the key back, while its session is open.

        A zenoh querier that is freed after its session was closed leaves the session's shared memory mapped, and the
        traceback of an error holds on to one until Python collects it.
        """
        for one in (self._nearest, self.everyone):
            with suppress(zenoh.ZError):
                while not _undeclared(one):
                    time.sleep(POLL_SECONDS)

    def silence(self) -> ServiceError:
        """Return the error of a query that nobody answered."""
        return no_service(settings=self._settings)


ReplyOf = TypeVar("ReplyOf")
TextOf = TypeVar("TextOf")
ModelOf = TypeVar("ModelOf")
HealthOf = TypeVar("HealthOf")


class ClientBase(Generic[ReplyOf, TextOf, ModelOf, HealthOf]):
    """What makes a client, blocking or asynchronous.

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
        "raise", or "identity": answer with the registered pose, nothing learned in it, with `fallback="identity"` and
        the failure as status; so the command jumps by the learned part and no more. Raises where no server has answered
        before, and bad input raises either way.
    path_timeout, connect_timeout : float
        Seconds for a path, and for a server to appear before the first question.
    config_file : path, optional
        A zenoh JSON5 configuration instead of `endpoint`.
    model_hash : str
        SHA-256 of the model that must answer; empty takes the one that answers first. Answers of another are refused as
        OTHER_MODEL until :meth:`change_model` is called: commands of two models may lie millimetres apart.
    pin : bool
        Whether that is so; without it every answer is taken, and `Reply.meta` says whose it is.

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
        twist : (6,) array, optional
            Desired velocity there, m/s and rad/s.

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
        poses : (n, 7) or (n, 3) array
            As for :meth:`correct`.
        times : (n,) array
            Seconds, strictly increasing.
        """
        answer: ReplyOf = self._ask(lambda: self._build.correct_path(poses, times))
        return answer

    def correct_joints(
        self, q: ArrayLike, times: ArrayLike, efforts: ArrayLike | None = None, sessions: Sequence[int] | None = None
    ) -> ReplyOf:
        """Return the true joints of a path of reported ones, or what to command, by the model's direction.

        Parameters
        ----------
        q, efforts : (n, d) arrays
            rad or m, NaN where missing; efforts, as logged, for models that look at them.
        times : (n,) array
            Seconds, strictly increasing.
        sessions : n int, optional
            Where the number changes, the arm was homed or moved by hand.
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

    def _ask(self, ask: Callable[[], Question[Any]]) -> Any:
        """Make a question, and return its answer or what waits for it."""
        raise NotImplementedError

    def change_model(self, model_hash: str = "") -> None:
        """Take another model from the next answer on: where the robot rests, for the command may step.

        Parameters
        ----------
        model_hash : str
            SHA-256 of the model that must answer; empty takes the one that answers first.
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
                immortal_in_children(self)
            if kind not in self._queriers:
                key, timeout = f"{self._settings.arm}/{kind}", self._settings.timeout_of(kind)
                self._queriers[kind] = Querier(self._session, key, self._settings, timeout, fresh=fresh)
            return self._queriers[kind]

    def _close(self) -> None:
        if is_forked():  # closing would wait for threads that are not here
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
