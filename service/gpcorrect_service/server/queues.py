"""A bounded queue with its own threads: what keeps zenoh's callbacks from ever waiting."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

from gpcorrect_service.ops.logger import Logger

__all__ = ["WorkerQueue"]

T = TypeVar("T")


class WorkerQueue(Generic[T]):
    """Items enter from any thread without waiting and are worked on in order.

    Parameters
    ----------
    name : str
        For thread names and logs.
    work : callable
        What is done with an item, in a worker thread.
    overflow : callable
        What is done, in the caller's thread, with an item that finds the queue full or closing; must not wait.
    workers, capacity : int
        Threads, and items that may wait; threads that offer at the same instant may each pass the bound.
    logger : Logger
        Where a failing item is written.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[T], None],
        overflow: Callable[[T], None],
        *,
        workers: int,
        capacity: int,
        logger: Logger,
    ) -> None:
        self._name = name
        self._work = work
        self._overflow = overflow
        self._capacity = capacity
        self._logger = logger
        # SimpleQueue is C code without a lock in Python; queue.Queue costs 0.03 ms a query more.
        self._queue: SimpleQueue[T | None] = SimpleQueue()
        self._closing = threading.Event()
        self._hurry = threading.Event()
        self._threads = [threading.Thread(target=self._run, name=f"{name}-{i}", daemon=True) for i in range(workers)]

    def start(self) -> None:
        """Start the threads."""
        for thread in self._threads:
            thread.start()

    def offer(self, item: T) -> None:
        """Queue an item, or hand it to `overflow`; returns at once.

        Parameters
        ----------
        item
        """
        if self._closing.is_set() or self._queue.qsize() >= self._capacity:
            self._overflow(item)
        else:
            self._queue.put(item)

    @property
    def waiting(self) -> int:
        """How many items wait."""
        return self._queue.qsize()

    @property
    def alive(self) -> bool:
        """Whether every thread still runs."""
        return all(thread.is_alive() for thread in self._threads)

    def close(self) -> None:
        """Take nothing more; what waits is still worked on."""
        self._closing.set()
        for _ in self._threads:
            self._queue.put(None)

    def hurry(self) -> None:
        """Hand what still waits to `overflow` from now on, instead of working on it."""
        self._hurry.set()

    def join(self, until: float) -> bool:
        """Wait until a closed queue is empty; return whether it is.

        A thread that hangs inside `work` is left behind; it is a daemon and ends with the process.

        Parameters
        ----------
        until : float
            Instant on the monotonic clock, s, at which waiting ends.
        """
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))
        return not any(thread.is_alive() for thread in self._threads)

    def _run(self) -> None:
        # OpenMP keeps its thread count by thread, so the limit of the process does not reach here.
        with threadpool_limits(limits=1):
            while (item := self._queue.get()) is not None:
                self._handle(item)

    def _handle(self, item: T) -> None:
        try:
            (self._overflow if self._hurry.is_set() else self._work)(item)
        except Exception as error:
            self._logger.error("work failed", queue=self._name, exc_info=error)
