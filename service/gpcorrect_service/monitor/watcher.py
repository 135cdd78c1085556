"""Listens to every arm of a namespace, and asks its servers how they are; sends nothing else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import Self

import zenoh

from gpcorrect.errors import DataError
from gpcorrect_service.crtk.bus import BusSettings, check_place, open_session, read_message
from gpcorrect_service.crtk.messages import TOPICS, Topic
from gpcorrect_service.monitor.board import Board
from gpcorrect_service.protocol.errors import EndpointError, ServiceError
from gpcorrect_service.protocol.messages import MSGPACK, HealthAnswer

WATCHED = (
    "measured_cp", "setpoint_cp", "tracker_cp", "servo_cp", "operating_state", "heartbeat", "error", "corrected/report",
    "view",
)  # fmt: skip
ASK_EVERY = 1.0  # chosen by hand: s between questions to the servers
ANSWER_WITHIN = 0.5  # chosen by hand: s
CONNECT_AGAIN = 2.0  # chosen by hand: s between tries to reach an address that does not answer


class Watcher:
    """Keeps a board up to date until closed; a context manager.

    Every address has its own session, which is opened again and again until somebody answers there.

    Parameters
    ----------
    board : Board
    places : sequence of BusSettings, addresses or configurations of robots and of servers, in the board's namespace

    Raises
    ------
    DataError
        On entering: a configuration file cannot be read or is not a client's, or a certificate is not valid.
    """

    def __init__(self, board: Board, places: Sequence[BusSettings]) -> None:
        self._board, self._places = board, places
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._watch, args=(place,), daemon=True) for place in places]

    def __enter__(self) -> Self:
        for place in self._places:
            check_place(place)
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join(5.0)

    def _watch(self, place: BusSettings) -> None:
        settings = replace(place, patience=CONNECT_AGAIN)
        while not self._stop.is_set():
            try:
                session = open_session(settings)
            except (EndpointError, DataError):  # nobody is there yet, or certificates expired meanwhile
                self._stop.wait(CONNECT_AGAIN)
                continue
            with ExitStack() as stack:
                stack.enter_context(session)
                for name in WATCHED:
                    key = f"{self._board.namespace}/*/{name}"
                    callback = zenoh.handlers.Callback(self._receiver(TOPICS[name], place.where), indirect=False)
                    stack.enter_context(session.declare_subscriber(key, callback))
                while not self._stop.wait(ASK_EVERY):
                    with suppress(zenoh.ZError):  # the link is down: asked again
                        self._ask(session)

    def _receiver(self, what: Topic, way: str) -> Callable[[zenoh.Sample], None]:
        depth = what.name.count("/") + 2

        def _receive(sample: zenoh.Sample) -> None:
            arm = str(sample.key_expr).split("/")[-depth]
            try:
                message = read_message(sample.payload.to_bytes(), str(sample.encoding), what)
            except ServiceError as error:
                self._board.unreadable(arm, what.name, error.message)
                return
            self._board.received(arm, what.name, message, time.monotonic(), way)

        return _receive

    def _ask(self, session: zenoh.Session) -> None:
        """Ask every server of every arm how it is."""
        began = time.monotonic()
        replies = session.get(
            f"{self._board.namespace}/*/health",
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=ANSWER_WITHIN,
            encoding=MSGPACK.encoding("health"),
        )
        for reply in replies:
            if reply.ok is None:
                continue
            seconds = time.monotonic() - began
            try:
                answer = MSGPACK.decode(HealthAnswer, reply.ok.payload.to_bytes())
            except ServiceError:
                continue
            self._board.replica(answer.arm, answer, seconds, time.monotonic())
