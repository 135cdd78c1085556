"""The bounded queue: nobody who offers waits, everything offered is handled once."""

from __future__ import annotations

import errno
import io
import json
import os
import threading
import time

import pytest
from service_support import PATIENT

from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.server.queues import WorkerQueue


class Works:
    """Notes what was worked on and what overflowed; works only while its gate is open."""

    def __init__(self, *, capacity: int = 3, log: io.StringIO | None = None, at_once: bool = False) -> None:
        self.gate, self.began = threading.Event(), threading.Semaphore(0)
        self.done: list[int] = []
        self.threads: dict[int, int] = {}
        self.refused: list[int] = []
        self.error: BaseException = ValueError("a bad item")
        self.log = log or io.StringIO()
        self.queue: WorkerQueue[int] = WorkerQueue(
            "test",
            self.work,
            self.refused.append,
            capacity=capacity,
            logger=open_logger(self.log),
            at_once=lambda: at_once,
        )
        self.queue.start()

    def work(self, item: int) -> None:
        """Note an item once the gate is open; fail on negative ones."""
        self.began.release()
        if item < 0:
            raise self.error
        self.gate.wait(PATIENT)
        self.threads[item] = threading.get_ident()
        self.done.append(item)

    def end(self, seconds: float = PATIENT) -> bool:
        """Close the queue and wait; whether it emptied in time."""
        self.queue.close()
        ended = self.queue.join(time.monotonic() + seconds)
        self.queue.hurry()
        return ended


def test_every_item_is_handled_exactly_once() -> None:
    """What is offered is worked on or refused, once; capacity plus the one at work are taken at most."""
    works = Works(capacity=4)
    works.queue.offer(0)
    assert works.began.acquire(timeout=PATIENT)
    for item in range(1, 50):
        works.queue.offer(item)
    assert works.refused == list(range(5, 50))
    works.gate.set()
    assert works.end()
    assert sorted(works.done + works.refused) == list(range(50))


def test_what_is_offered_while_the_queue_closes_is_refused_and_not_left_behind() -> None:
    """An item that passed the look at the closing queue was put behind its end marker, where nobody looks."""
    works = Works()
    works.gate.set()
    inside, go_on = threading.Event(), threading.Event()

    def at_once() -> bool:  # asked between the look and the entry
        inside.set()
        go_on.wait(0.2)
        return False

    works.queue._at_once = at_once
    offering = threading.Thread(target=works.queue.offer, args=(7,))
    offering.start()
    assert inside.wait(PATIENT)
    works.queue.close()
    go_on.set()
    offering.join(PATIENT)
    assert works.queue.join(time.monotonic() + PATIENT)
    assert works.done + works.refused == [7]


@pytest.mark.parametrize(
    "error", [ValueError("a bad item"), SystemExit(1), KeyboardInterrupt(), BaseException("a panic of compiled code")]
)
def test_a_failing_item_leaves_the_worker_alive(error: BaseException) -> None:
    """Whatever the work raises is logged, and the next item is worked on."""
    works = Works()
    works.error = error
    works.gate.set()
    works.queue.offer(-1)
    works.queue.offer(7)
    assert works.end()
    assert works.done == [7]
    assert json.loads(works.log.getvalue())["exception"][0]["exc_type"] == type(error).__name__


class FullDisk(io.StringIO):
    """Finds no room for anything."""

    def write(self, text: str) -> int:
        """Refuse."""
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_under_the_log_leaves_the_worker_alive() -> None:
    """A failing item whose log line cannot be written is lost with it, and the next item is worked on."""
    works = Works(log=FullDisk())
    works.gate.set()
    works.queue.offer(-1)
    works.queue.offer(7)
    assert works.end()
    assert works.done == [7]


def test_a_closed_queue_takes_nothing_and_finishes() -> None:
    """Once closed, offers are refused and what waited is still worked on."""
    works = Works()
    for item in range(3):
        works.queue.offer(item)
    works.queue.close()
    works.queue.offer(99)
    works.gate.set()
    assert works.queue.join(time.monotonic() + PATIENT)
    assert (works.done, works.refused) == ([0, 1, 2], [99])


def test_hurry_refuses_what_waits() -> None:
    """A queue that is hurried hands over what waits instead of working on it."""
    works = Works()
    works.queue.offer(0)
    assert works.began.acquire(timeout=PATIENT)
    works.queue.offer(1)
    works.queue.offer(2)
    assert not works.end(seconds=0.0)
    works.gate.set()
    assert works.queue.join(time.monotonic() + PATIENT)
    assert (works.done, works.refused) == ([0], [1, 2])


def test_an_item_that_finds_nothing_waiting_is_done_by_who_offers_it() -> None:
    works = Works(at_once=True)
    works.gate.set()
    works.queue.offer(0)
    assert works.threads == {0: threading.get_ident()}
    works.queue.offer(-1)  # fails, and is logged
    works.queue.offer(1)
    assert works.done == [0, 1]
    assert works.end()


def test_while_one_is_at_work_those_who_offer_do_not_wait() -> None:
    """Be it who offered or the worker: one works at a time, and what is offered meanwhile is left to the worker."""
    works = Works(at_once=True, capacity=2)
    first = threading.Thread(target=works.queue.offer, args=(0,))
    first.start()
    assert works.began.acquire(timeout=PATIENT)
    works.queue.offer(1)
    until = time.monotonic() + PATIENT
    while works.queue.waiting and time.monotonic() < until:
        time.sleep(0.001)  # the worker has taken it, and waits for the first to end
    for item in (2, 3, 4):
        works.queue.offer(item)
    assert works.refused == [4]
    assert not works.began.acquire(blocking=False)
    works.queue.close()
    assert not works.queue.join(time.monotonic())
    works.gate.set()
    assert works.queue.join(time.monotonic() + PATIENT)
    assert works.done == [0, 1, 2, 3]
    assert works.threads[0] == first.ident
    assert first.ident not in (works.threads[item] for item in (1, 2, 3))
    first.join()


def test_nothing_is_done_at_once_beside_the_worker() -> None:
    """It would trade the interpreter with the worker, query by query."""
    at_once = False
    works = Works()
    works.queue._at_once = lambda: at_once
    works.queue.offer(0)
    assert works.began.acquire(timeout=PATIENT)
    at_once = True
    works.queue.offer(1)  # nothing waits, and the worker works
    assert works.queue.waiting == 1
    works.gate.set()
    assert works.end()
    assert threading.get_ident() not in works.threads.values()
