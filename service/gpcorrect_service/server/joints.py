"""`correct_joints`: a timed path of joints in, corrected joints and their spread out."""

from __future__ import annotations

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.limits import MAX_PATH_POSES, bad_input, check_times
from gpcorrect_service.protocol.wire_joints import CorrectJointsAnswer, CorrectJointsRequest, Row
from gpcorrect_service.server.answers import Answer, Request
from gpcorrect_service.server.models import JointModel, JointStreamLike
from gpcorrect_service.server.poses import first_trouble
from gpcorrect_service.server.requests import Reception

__all__ = ["JointHandlers", "checked_joints"]

# No arm inserts 2 m, and 20 rad are over three turns: such numbers are millimetres and degrees.
MOST = {"P": (2.0, "metres, not millimetres"), "R": (20.0, "radians, not degrees")}


class JointHandlers:
    """Answers requests about joints.

    Parameters
    ----------
    reception : Reception
        Reads and refuses.
    """

    def __init__(self, reception: Reception) -> None:
        self._reception = reception

    def correct_joints(self, request: Request) -> Answer:
        """Answer a timed path of joints; each request is a path of its own, at rest before its first row."""
        return self._reception.answer("correct_joints", request, lambda *beside: self._correct(request, *beside))

    def _correct(self, request: Request, codec: wire.Codec, meta: wire.RequestMeta, started: float) -> Answer:
        asked = codec.decode(CorrectJointsRequest, request.payload)
        model = self._reception.active.joint_model()
        _check_lengths(asked)
        q = checked_joints(asked.q, model.types, "joints")
        efforts = None if asked.efforts is None else _rows(asked.efforts, len(model.types), "efforts")
        estimate, std = _along(model, asked, q, efforts)
        status = ["OK" if np.isfinite(row).all() else "MISSING" for row in estimate]
        message = CorrectJointsAnswer(wire.gap_rows(estimate), wire.gap_rows(std), status)
        beside = self._reception.beside(codec, meta, started, model)
        name = wire.encoding_name(codec, "correct_joints")
        return Answer(codec.encode(message), name, beside, first_trouble(status), rows=len(q))


def checked_joints(rows: tuple[Row, ...], types: str, what: str) -> FloatArray:
    """Return joints `(n, d)`, NaN where null.

    Raises
    ------
    ServiceError
        BAD_INPUT: other joints than the model's, or numbers that cannot be radians and metres.
    """
    q = _rows(rows, len(types), what)
    for joint, kind in enumerate(types):
        most, unit = MOST[kind]
        worst = float(np.nanmax(np.abs(q[:, joint]), initial=0.0))
        if worst > most:
            raise bad_input(f"joint {joint + 1} is {worst:.4g} in the {what}.", f"Send {unit}.")
    return q


def _along(
    model: JointModel, asked: CorrectJointsRequest, q: FloatArray, efforts: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    stream = model.stream()
    estimate, std = np.empty(q.shape), np.empty(q.shape)
    for i, time in enumerate(asked.times):
        if asked.sessions is not None and i and asked.sessions[i] != asked.sessions[i - 1]:
            stream.reset()
        estimate[i], std[i] = _one(stream, i, time, q[i], None if efforts is None else efforts[i])
    return estimate, std


def _one(
    stream: JointStreamLike, row: int, time: float, q: FloatArray, effort: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    try:
        answer = stream.estimate(time, q, effort)
    except DataError as error:
        raise DataError(f"row {row} of the joints: {error.message}", hint=error.hint) from error
    return answer.q, answer.std


def _check_lengths(asked: CorrectJointsRequest) -> None:
    n = len(asked.q)
    if not 0 < n <= MAX_PATH_POSES:
        raise bad_input(f"a path has 1 to {MAX_PATH_POSES} rows, got {n}.", "Cut longer paths where the robot rests.")
    for what, given in (("times", asked.times), ("efforts", asked.efforts), ("sessions", asked.sessions)):
        if given is not None and len(given) != n:
            raise bad_input(f"{n} rows of joints came with {len(given)} {what}.", f"Send one of {what} a row.")
    if not np.isfinite(asked.times).all():
        raise bad_input("the times hold a number that is not finite.", "Send seconds.")
    check_times(np.array(asked.times))


def _rows(rows: tuple[Row, ...], dof: int, what: str) -> FloatArray:
    """Return rows `(n, dof)`, NaN where null or infinite."""
    wrong = next((len(row) for row in rows if len(row) != dof), None)
    if wrong is not None:
        raise bad_input(f"the model knows {dof} joints, a row of the {what} has {wrong}.", "Send all joints in order.")
    values = np.array(rows, dtype=np.float64)
    return np.where(np.isfinite(values), values, np.nan)
