"""How a request is read, refused and answered, whatever it asks."""

from __future__ import annotations

from collections.abc import Callable

from gpcorrect.errors import DataError
from gpcorrect_service.ops.logger import Journal
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.server.active import Active
from gpcorrect_service.server.answers import (
    Answer,
    Clock,
    Request,
    check_age,
    error_answer,
    internal_error,
    read_meta,
)
from gpcorrect_service.server.models import JointModel, Model

__all__ = ["Reception", "Work"]

CORRECTIONS: frozenset[wire.Kind] = frozenset({"correct", "correct_path", "correct_joints"})
# From the codec, what travels beside the request, and when work began (s, monotonic) to the answer.
Work = Callable[[wire.Codec, wire.RequestMeta, float], Answer]


class Reception:
    """What every handler shares: how a request is read, refused and answered; safe to use from several threads.

    Parameters
    ----------
    active : Active
        The models, and whether they may answer.
    arm, replica : str
        Names that the answers carry.
    journal : Journal
        Where failures of the model are written.
    clock : Clock
        Where the time comes from.
    """

    def __init__(self, active: Active, *, arm: str, replica: str, journal: Journal, clock: Clock) -> None:
        self.active = active
        self.arm = arm
        self.replica = replica
        self._journal = journal
        self._clock = clock

    def answer(self, kind: wire.Kind, request: Request, work: Work, codec: wire.Codec | None = None) -> Answer:
        """Return what `work` answers, or the refusal; `codec` where the encoding alone does not tell it."""
        started = self._clock.monotonic()
        chosen, meta = codec or wire.JSON, wire.RequestMeta()
        try:
            chosen = codec or wire.choose_codec(request.encoding, kind)
            meta = read_meta(chosen, request.attachment)
            check_age(meta, started - request.arrived)
            answer = work(chosen, meta, started)
            if kind in CORRECTIONS:
                self.active.answered()
            return answer
        except ServiceError as error:
            if error.status == "INTERNAL":
                self._failed(kind)
                self._journal.error(
                    "unsafe command withheld", kind=kind, request_id=meta.request_id, cause=error.message
                )
            return error_answer(chosen, error, self.replica, meta.request_id)
        except DataError as error:
            bad = ServiceError("BAD_INPUT", error.message, hint=error.hint)
            return error_answer(chosen, bad, self.replica, meta.request_id)
        except Exception as error:  # noqa: BLE001 - whatever a model does, the planner gets a reply and the worker lives on
            self._failed(kind)
            self._journal.error("query failed inside", kind=kind, request_id=meta.request_id, exc_info=error)
            return error_answer(chosen, internal_error(error), self.replica, meta.request_id)

    def beside(
        self,
        codec: wire.Codec,
        meta: wire.RequestMeta,
        started: float,
        model: Model | JointModel,
    ) -> bytes:
        """Return what travels beside an answer."""
        now, serving = self._clock.wall(), self._clock.monotonic() - started
        return codec.encode(wire.ReplyMeta(meta.request_id, model.id, model.hash, self.replica, now, serving))

    def _failed(self, kind: wire.Kind) -> None:
        if kind in CORRECTIONS:
            self.active.failed()

    def elapsed(self, started: float) -> tuple[float, float]:
        """Return the date, s since 1970, and the seconds since `started`."""
        return self._clock.wall(), self._clock.monotonic() - started
