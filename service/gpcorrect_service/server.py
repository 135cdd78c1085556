"""The server: zenoh callback -> bounded queue -> worker -> reply."""

from __future__ import annotations

import gc
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType, TracebackType
from typing import Self

import zenoh
from threadpoolctl import threadpool_limits

from gpcorrect_service import wire
from gpcorrect_service.answers import Clock
from gpcorrect_service.config import ServerSettings
from gpcorrect_service.handlers import Handlers
from gpcorrect_service.health import Health, Tally
from gpcorrect_service.journal import Journal, open_journal
from gpcorrect_service.model import Corrector, Model, load_model
from gpcorrect_service.post import Handler, Parcel, Post
from gpcorrect_service.transport import open_server
from gpcorrect_service.workers import Lane

__all__ = ["Server", "run", "serve"]

REFUSALS = 4096  # BUSY answers that may wait to be sent; beyond it queries end without one
LAST_MOMENT = 0.2  # s: handing a full queue to the refusals takes a millisecond


class Server:
    """Serves one corrector for one arm; a context manager.

    Queries enter through zenoh's callbacks, which only queue them. Every key has its own queue and thread,
    so a long path does not delay a single pose and `health` answers while the others are flooded; refusals
    are sent by a thread of their own. A stopped server is not started again.

    Parameters
    ----------
    corrector : Corrector, Model or None
        What is served; None answers NO_MODEL.
    settings : ServerSettings
        Address, names and bounds.
    journal : Journal, optional
        Where the server logs; standard error by default.
    clock : Clock, optional
        Where the time comes from.
    """

    def __init__(
        self,
        corrector: Corrector | Model | None,
        settings: ServerSettings | None = None,
        *,
        journal: Journal | None = None,
        clock: Clock | None = None,
    ) -> None:
        given = settings or ServerSettings()
        # Named here and not with the settings, which may have been written in another process.
        self.settings = replace(given, replica=given.replica or f"{socket.gethostname()}-{os.getpid()}")
        self.model = corrector if isinstance(corrector, Model) or corrector is None else Model(corrector)
        self._clock = clock or Clock()
        self._journal = journal or open_journal(arm=self.settings.arm, replica=self.settings.replica)
        self._tally = Tally()
        self._lanes: dict[str, Lane[Parcel]] = {}
        self._post = Post(self.settings, self._tally, self._journal)
        self._refusals = Lane(
            "refusals",
            self._post.refuse,
            self._post.drop,
            workers=1,
            capacity=REFUSALS,
            journal=self._journal,
        )
        self._queryables = ExitStack()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Listen, and answer from now on.

        Raises
        ------
        EndpointError
            The address is taken or cannot be used.
        """
        with ExitStack() as stack:
            stack.enter_context(threadpool_limits(limits=1))
            session = stack.enter_context(open_server(self.settings))
            self._open_lanes()
            stack.callback(self._drain)
            self._declare(session)
            self._stack = stack.pop_all()
        self._journal.info("serving", endpoint=self.settings.endpoint, **self._identity())

    def stop(self) -> None:
        """Take no more queries, answer those that wait (at most `drain_seconds`), and close."""
        self._queryables.close()
        self._stack.close()
        self._journal.info("stopped", counts=self._tally.counts())

    def _drain(self) -> None:
        """Let the workers finish; hand what they cannot finish in time to the refusals; end those last."""
        until = time.monotonic() + self.settings.drain_seconds
        lanes = self._lanes.values()
        for lane in lanes:
            lane.seal()
        in_time = [lane.join(until) for lane in lanes]
        for lane in lanes:
            lane.hurry()
        ended = [lane.join(until + LAST_MOMENT) for lane in lanes]
        self._refusals.seal()
        self._refusals.join(until + 2 * LAST_MOMENT)
        if not all(in_time):
            self._journal.warning("did not finish in time", hanging=ended.count(False))

    def _identity(self) -> dict[str, str]:
        return {"model_id": self.model.id, "model_hash": self.model.hash} if self.model else {"model_id": ""}

    def _open_lanes(self) -> None:
        s, full = self.settings, self._refusals.offer
        for name in wire.KINDS:
            workers = s.workers if name == "correct" else 1
            self._lanes[name] = Lane(
                name,
                self._post.answer,
                full,
                workers=workers,
                capacity=s.queue_capacity,
                journal=self._journal,
            )
        for lane in (self._refusals, *self._lanes.values()):
            lane.start()

    def _declare(self, session: zenoh.Session) -> None:
        s = self.settings
        names = {"arm": s.arm, "replica": s.replica}
        handlers = Handlers(self.model, journal=self._journal, clock=self._clock, **names)
        health = Health(self.model, tally=self._tally, lanes=self._lanes, monotonic=self._clock.monotonic, **names)
        answers: dict[wire.Kind, Handler] = {
            "correct": handlers.correct,
            "correct_path": handlers.correct_path,
            "model": handlers.model,
            "health": health.answer,
        }
        for kind, handler in answers.items():
            # A direct callback runs on zenoh's thread: it only queues, and saves a change of threads.
            callback = zenoh.handlers.Callback(self._receiver(kind, handler), indirect=False)
            self._queryables.enter_context(session.declare_queryable(self._post.key(kind), callback, complete=True))

    def _receiver(self, kind: wire.Kind, handler: Handler) -> Callable[[zenoh.Query], None]:
        offer, monotonic = self._lanes[kind].offer, self._clock.monotonic

        def receive(query: zenoh.Query) -> None:
            offer(Parcel(query, kind, handler, monotonic()))

        return receive


def serve(
    model_path: str | Path,
    settings: ServerSettings | None = None,
    stop_event: threading.Event | None = None,
    on_ready: Callable[[Server], None] | None = None,
) -> None:
    """Serve a model file until told to stop: the whole life of a service process.

    Parameters
    ----------
    model_path : path
        What `gpcorrect fit` wrote.
    settings : ServerSettings, optional
        Address, names and bounds.
    stop_event : threading.Event, optional
        Ends the service when set. Without it SIGTERM and SIGINT do, which needs the main thread.
    on_ready : callable, optional
        Called once queries are answered.

    Raises
    ------
    ArtifactError
        The model file is refused.
    EndpointError
        The address is taken or cannot be used.
    """
    run(load_model(model_path), settings, stop_event, on_ready)


def run(
    corrector: Corrector | Model | None,
    settings: ServerSettings | None = None,
    stop_event: threading.Event | None = None,
    on_ready: Callable[[Server], None] | None = None,
) -> None:
    """Serve a corrector that is already loaded; see :func:`serve`."""
    # What the process has loaded by now it keeps: the collector need not walk through it while a planner waits.
    gc.collect()
    gc.freeze()
    with _stop_signal(stop_event) as stop, Server(corrector, settings) as server:
        if on_ready is not None:
            on_ready(server)
        stop.wait()


@contextmanager
def _stop_signal(given: threading.Event | None) -> Iterator[threading.Event]:
    """Give the event that ends the service; without a given one the usual signals set it."""
    stop = given or threading.Event()
    if given is not None:
        yield stop
        return

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, on_signal) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
