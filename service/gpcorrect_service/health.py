"""How a server is: counts of what it answered, and the state that its `health` key tells."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from gpcorrect_service import wire
from gpcorrect_service.answers import Answer, Request, error_answer, read_meta
from gpcorrect_service.errors import ServiceError
from gpcorrect_service.model import Model
from gpcorrect_service.workers import Lane

__all__ = ["Health", "Tally"]


class Tally:
    """Counts answers by key and status, from any thread."""

    def __init__(self) -> None:
        self._counts: dict[str, Counter[str]] = {}
        self._lock = threading.Lock()

    def add(self, kind: str, status: str) -> None:
        """Count one answer."""
        with self._lock:
            self._counts.setdefault(kind, Counter())[status] += 1

    def counts(self) -> dict[str, dict[str, int]]:
        """Return the counts so far, as `{"correct": {"OK": 12, "BUSY": 3}}`."""
        with self._lock:
            return {kind: dict(counts) for kind, counts in self._counts.items()}


class Health:
    """Answers the `health` key; touches neither the model nor the queues it reports on.

    Parameters
    ----------
    model : Model or None
        The active model.
    arm, replica : str
        Names that the answer carries.
    tally : Tally
        What was answered.
    lanes : mapping of name to Lane
        The queues; filled by the server before the first query.
    monotonic : callable
        Clock, s.
    """

    def __init__(
        self,
        model: Model | None,
        *,
        arm: str,
        replica: str,
        tally: Tally,
        lanes: Mapping[str, Lane[Any]],
        monotonic: Callable[[], float],
    ) -> None:
        self._model = model
        self._arm = arm
        self._replica = replica
        self._tally = tally
        self._lanes = lanes
        self._monotonic = monotonic
        self._started = monotonic()

    def answer(self, request: Request) -> Answer:
        """Answer how the server is."""
        codec = wire.JSON
        try:
            codec = wire.choose_codec(request.encoding, "health")
            read_meta(codec, request.attachment)
        except ServiceError as error:
            return error_answer(codec, error, self._replica)
        report = self.report()
        return Answer(codec.encode(report), wire.encoding_name(codec, "health"), b"", "OK")

    def report(self) -> wire.HealthAnswer:
        """Return the state of this moment."""
        return wire.HealthAnswer(
            state=self._state(),
            arm=self._arm,
            replica=self._replica,
            model_id=self._model.id if self._model else "",
            model_hash=self._model.hash if self._model else "",
            uptime=self._monotonic() - self._started,
            queued={name: lane.waiting for name, lane in self._lanes.items()},
            counts=self._tally.counts(),
        )

    def _state(self) -> str:
        """Return the CRTK state: FAULT when a worker is gone, DISABLED without a model, ENABLED otherwise."""
        if not all(lane.alive for lane in self._lanes.values()):
            return "FAULT"
        return "ENABLED" if self._model else "DISABLED"
