"""How a server is: the state that its `health` key tells, and the numbers under its `metrics` key."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gpcorrect_service.ops.metrics import OPENMETRICS, Tally, exposition
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.server.active import Active
from gpcorrect_service.server.answers import Answer, Request, error_answer, plain_answer, read_meta
from gpcorrect_service.server.queues import Lane

__all__ = ["Health"]


class Health:
    """Answers `health` and `metrics`; touches neither the models nor the queues it reports on.

    Parameters
    ----------
    active : Active
        The active models.
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
        active: Active,
        *,
        arm: str,
        replica: str,
        tally: Tally,
        lanes: Mapping[str, Lane[Any]],
        monotonic: Callable[[], float],
    ) -> None:
        self._active = active
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
        return plain_answer(codec, "health", self.report())

    def metrics(self, request: Request) -> Answer:
        """Answer the numbers of this moment as OpenMetrics text, whatever the request says."""
        return Answer(exposition(self.report(), self._tally), OPENMETRICS, b"", "OK")

    def report(self) -> wire.HealthAnswer:
        """Return the state of this moment."""
        now = self._active.now
        return wire.HealthAnswer(
            state=self._state(),
            arm=self._arm,
            replica=self._replica,
            model_id=now.pose.id if now.pose else "",
            model_hash=now.pose.hash if now.pose else "",
            uptime=self._monotonic() - self._started,
            queued={name: lane.waiting for name, lane in self._lanes.items()},
            counts=self._tally.counts(),
            joint_model_id=now.joints.id if now.joints else "",
            joint_model_hash=now.joints.hash if now.joints else "",
        )

    def _state(self) -> str:
        """Return the state of :class:`Active`, or FAULT when a worker is gone."""
        return self._active.state if all(lane.alive for lane in self._lanes.values()) else "FAULT"
