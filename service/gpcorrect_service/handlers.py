"""From a request's bytes to a reply's bytes; no network here."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect_service import wire
from gpcorrect_service.answers import (
    Answer,
    Clock,
    Request,
    check_age,
    error_answer,
    internal_error,
    read_meta,
)
from gpcorrect_service.checks import check_answer, checked_path, checked_pose, checked_twist, position_limit
from gpcorrect_service.errors import ServiceError
from gpcorrect_service.journal import Journal
from gpcorrect_service.model import Model

__all__ = ["Handlers"]

Work = Callable[[Model, wire.Codec, bytes], tuple[msgspec.Struct, str]]


class Handlers:
    """Answers requests for one model; safe to call from several threads.

    Parameters
    ----------
    model : Model or None
        What is served; without it every correction is answered NO_MODEL.
    arm, replica : str
        Names that the answers carry.
    journal : Journal
        Where failures of the model are written.
    clock : Clock
        Where the time comes from.
    """

    def __init__(self, model: Model | None, *, arm: str, replica: str, journal: Journal, clock: Clock) -> None:
        self._model = model
        self._limit = position_limit(model.corrector.info()) if model else math.inf
        self._arm = arm
        self._replica = replica
        self._journal = journal
        self._clock = clock

    def correct(self, request: Request) -> Answer:
        """Answer one desired pose."""
        return self._answer("correct", request, self._correct)

    def correct_path(self, request: Request) -> Answer:
        """Answer a timed path."""
        return self._answer("correct_path", request, self._correct_path)

    def model(self, request: Request) -> Answer:
        """Answer which model is active."""
        return self._answer("model", request, self._describe)

    def _answer(self, kind: wire.Kind, request: Request, work: Work) -> Answer:
        started = self._clock.monotonic()
        codec, meta = wire.JSON, wire.RequestMeta()
        try:
            codec = wire.choose_codec(request.encoding, kind)
            meta = read_meta(codec, request.attachment)
            check_age(meta, started - request.arrived)
            model = self._active()
            message, status = work(model, codec, request.payload)
            beside = codec.encode(self._reply_meta(meta, model, started))
            return Answer(codec.encode(message), wire.encoding_name(codec, kind), beside, status)
        except ServiceError as error:
            if error.status == "INTERNAL":
                self._journal.error(
                    "unsafe command withheld", kind=kind, request_id=meta.request_id, cause=error.message
                )
            return error_answer(codec, error, self._replica, meta.request_id)
        except DataError as error:
            bad = ServiceError("BAD_INPUT", error.message, hint=error.hint)
            return error_answer(codec, bad, self._replica, meta.request_id)
        except Exception as error:  # noqa: BLE001 - whatever a model does, the planner gets a reply and the worker lives on
            self._journal.error("query failed inside", kind=kind, request_id=meta.request_id, exc_info=error)
            return error_answer(codec, internal_error(error), self._replica, meta.request_id)

    def _active(self) -> Model:
        if self._model is None:
            raise ServiceError(
                "NO_MODEL",
                "this server holds no model.",
                hint="Start it with a model file: gpcorrect serve MODEL",
            )
        return self._model

    def _reply_meta(self, meta: wire.RequestMeta, model: Model, started: float) -> wire.ReplyMeta:
        return wire.ReplyMeta(
            request_id=meta.request_id,
            model_id=model.id,
            model_hash=model.hash,
            replica=self._replica,
            served_at=self._clock.wall(),
            serving_seconds=self._clock.monotonic() - started,
        )

    def _correct(self, model: Model, codec: wire.Codec, payload: bytes) -> tuple[msgspec.Struct, str]:
        asked = codec.decode(wire.CorrectRequest, payload)
        answer = model.corrector.correct(checked_pose(asked.pose, self._limit), checked_twist(asked.twist))
        position = answer.position.tolist()
        quaternion = None if answer.quaternion is None else answer.quaternion.tolist()
        check_answer(position, quaternion, self._limit)
        message = wire.CorrectAnswer(
            position=position,
            quaternion=quaternion,
            std=gaps(answer.std.tolist()),
            interval95=gaps(answer.interval95.tolist()),
            in_domain=bool(answer.in_domain),
            status=answer.status,
            reason=answer.reason,
        )
        return message, answer.status

    def _correct_path(self, model: Model, codec: wire.Codec, payload: bytes) -> tuple[msgspec.Struct, str]:
        asked = codec.decode(wire.CorrectPathRequest, payload)
        answer = model.corrector.correct_path(*checked_path(asked.poses, asked.times, self._limit))
        positions = answer.positions.tolist()
        quaternions = None if answer.quaternions is None else answer.quaternions.tolist()
        for row, position in enumerate(positions):
            check_answer(position, None if quaternions is None else quaternions[row], self._limit)
        message = wire.CorrectPathAnswer(
            positions=positions,
            quaternions=quaternions,
            std=gap_rows(answer.std),
            interval95=gap_rows(answer.interval95),
            in_domain=np.asarray(answer.in_domain, dtype=bool).tolist(),
            status=list(answer.status),
            reason=list(answer.reason),
        )
        return message, first_trouble(answer.status)

    def _describe(self, model: Model, codec: wire.Codec, payload: bytes) -> tuple[msgspec.Struct, str]:
        info = dict(model.corrector.info())
        return wire.ModelAnswer(model.id, model.hash, self._arm, self._replica, info), "OK"


def gaps(numbers: list[float]) -> list[float | None]:
    """Numbers for the wire: None where there is none (JSON knows no NaN)."""
    return [number if math.isfinite(number) else None for number in numbers]


def gap_rows(numbers: FloatArray) -> list[list[float | None]]:
    """Rows `(n, k)` for the wire, see :func:`gaps`."""
    rows: list[Any] = numbers.tolist()
    return rows if np.isfinite(numbers).all() else [gaps(row) for row in rows]


def first_trouble(statuses: tuple[str, ...]) -> str:
    """Return the status that a whole path is counted under: the first that is not OK."""
    return next((status for status in statuses if status != "OK"), "OK")
