"""Bounded queues with a thread of their own: what keeps zenoh's callbacks from waiting."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

from gpcorrect_service.ops.logger import Logger

T = TypeVar("T")


class WorkerQueue(Generic[T]):
    """Items enter from any thread and are worked on in order, in one of the queue's own; what fails is logged only.

    One answers fastest: corrections hold the interpreter, a second thread only trades places with the first (0.05 ms a
    query).

    Parameters
    ----------
    name : str, for the thread and logs
    work : callable, what is done with an item, in the worker thread
    overflow : callable
        What is done, in the caller's thread, with an item that finds the queue full or closing; must not wait.
    capacity : int, items that may wait
    logger : Logger
    at_once : callable
        Whether an item that finds nothing waiting and nothing under way is worked on by the thread that offers it:
        waking the worker takes longer than a short item does, and many times as long where other processes want the
        core. Beside the worker it would only trade the interpreter with it.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[T], None],
        overflow: Callable[[T], None],
        *,
        capacity: int,
        logger: Logger,
        at_once: Callable[[], bool] = lambda: False,
    ) -> None:
        self._name = name
        self._work = work
        self._overflow = overflow
        self._capacity = capacity
        self._logger = logger
        # SimpleQueue is C code without a lock in Python; queue.Queue costs 0.03 ms a query more.
        self._queue: SimpleQueue[T | None] = SimpleQueue()
        self._at_once = at_once
        self._working = threading.Lock()  # held by whichever thread works on an item
        self._entrance = threading.Lock()  # nothing comes in behind the end marker, where nobody would look
        self._closing = threading.Event()
        self._hurry = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def offer(self, item: T) -> None:
        """Queue an item, or hand it to `overflow`; returns at once, or when the item is done where that is allowed.

        Parameters
        ----------
        item
        """
        with self._entrance:
            waiting = self._queue.qsize()
            full = self._closing.is_set() or waiting >= self._capacity
            now = not full and waiting == 0 and self._at_once() and self._working.acquire(blocking=False)
            if not (full or now):
                self._queue.put(item)
        if full:
            self._overflow(item)
        elif now:
            try:
                self._handle(item)
            finally:
                self._working.release()

    @property
    def waiting(self) -> int:
        """How many items wait."""
        return self._queue.qsize()

    @property
    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Take nothing more; what waits is still worked on."""
        with self._entrance:
            self._closing.set()
            self._queue.put(None)

    def hurry(self) -> None:
        """Hand what still waits to `overflow` from now on, instead of working on it."""
        self._hurry.set()

    def join(self, until: float) -> bool:
        """Wait until a closed queue is empty; return whether it is.

        A thread that hangs inside `work` is left behind; it is a daemon and ends with the process.

        Parameters
        ----------
        until : float, instant on the monotonic clock, s, at which waiting ends
        """
        self._thread.join(max(0.0, until - time.monotonic()))
        if done := self._working.acquire(timeout=max(0.0, until - time.monotonic())):
            self._working.release()
        return done and not self.alive

    def _run(self) -> None:
        # OpenMP keeps its thread count by thread, so the limit of the process does not reach here.
        with threadpool_limits(limits=1):
            while (item := self._queue.get()) is not None:
                with self._working:
                    self._handle(item)

    def _handle(self, item: T) -> None:
        try:
            (self._overflow if self._hurry.is_set() else self._work)(item)
        except BaseException as error:  # SystemExit and panics of compiled code too: the worker stays
            self._logger.error("work failed", queue=self._name, exc_info=error)
