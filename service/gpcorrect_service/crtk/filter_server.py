"""The pre-filter as a process: `servo_cp` and `move_cp` in, `corrected/...` out; refusals on `error`."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, Full, Queue

from gpcorrect_service.crtk.bus import Bus
from gpcorrect_service.crtk.messages import Pose, Report, Text
from gpcorrect_service.crtk.prefilter import Prefilter
from gpcorrect_service.ops.logger import Logger
from gpcorrect_service.protocol.errors import ServiceError

__all__ = ["FilterServer"]

WAITING = 64  # chosen by hand: poses that may wait; a stream that is further behind loses its oldest
LOG_EVERY = 1000  # refusals between two lines about them in the log

Answer = Callable[[Pose], tuple[Pose, Report]]


class FilterServer:
    """Corrects one arm's commands until told to stop.

    Parameters
    ----------
    prefilter : Prefilter
    bus : Bus
    logger : Logger
        Where refusals are written, the first and every thousandth.
    """

    def __init__(self, prefilter: Prefilter, bus: Bus, logger: Logger) -> None:
        self._prefilter, self._bus, self._logger = prefilter, bus, logger
        self._waiting: Queue[tuple[str, Answer, Pose]] = Queue(WAITING)
        self._refused = 0
        bus.subscribe("operating_state", prefilter.robot_is)
        for name, answer in (("servo_cp", prefilter.servo), ("move_cp", prefilter.move)):
            bus.subscribe(name, self._queueing(f"corrected/{name}", answer), self._unreadable)

    def run(self, stop: threading.Event) -> None:
        """Answer until `stop`."""
        while not stop.is_set():
            try:
                out, answer, message = self._waiting.get(timeout=0.1)
            except Empty:
                continue
            self._answer(out, answer, message)

    def _answer(self, out: str, answer: Answer, message: Pose) -> None:
        try:
            command, report = answer(message)
        except ServiceError as error:
            self._refuse(message.stamp, error)
            return
        self._bus.publish(out, command)
        self._bus.publish("corrected/report", report)

    def _queueing(self, out: str, answer: Answer) -> Callable[[Pose], None]:
        def receive(message: Pose) -> None:
            # Where the queue is full the newest pose is the one that counts.
            while True:
                try:
                    self._waiting.put_nowait((out, answer, message))
                except Full:
                    with suppress(Empty):
                        self._waiting.get_nowait()
                else:
                    return

        return receive

    def _unreadable(self, error: ServiceError) -> None:
        self._refuse(0.0, error)

    def _refuse(self, stamp: float, error: ServiceError) -> None:
        self._bus.publish("error", Text(stamp, str(error)))
        if self._refused % LOG_EVERY == 0:
            self._logger.warning("pose refused", status=error.status, cause=error.message, refused=self._refused + 1)
        self._refused += 1
