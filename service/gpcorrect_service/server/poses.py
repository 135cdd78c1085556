"""From a request's bytes to a reply's bytes; no network here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.types import Correction, FloatArray
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.bounds import CorrectionBound
from gpcorrect_service.protocol.cdr import CDR_ENCODING, CdrBeside, StampedPose, read_pose, write_pose
from gpcorrect_service.protocol.limits import check_answer, checked_path, checked_pose, checked_twist
from gpcorrect_service.server.answers import Answer, Request, plain_answer
from gpcorrect_service.server.models import Model, PathResult
from gpcorrect_service.server.requests import Reception

__all__ = ["BOUNDED", "Handlers", "first_trouble"]

BOUNDED = "cut to the bound that this server's operator set"


class Handlers:
    """Answers requests about poses, paths and their model.

    Parameters
    ----------
    reception : Reception
        Reads and refuses.
    bound : CorrectionBound
        What no correction may exceed; the model's own bounds hold as well.
    """

    def __init__(self, reception: Reception, bound: CorrectionBound | None = None) -> None:
        self._reception = reception
        self._active = reception.active
        self._bound = bound if bound is not None and bound.acts else None

    def correct(self, request: Request) -> Answer:
        """Answer one desired pose, in the encoding in which it came."""
        if request.encoding.startswith(CDR_ENCODING):
            return self._reception.answer("correct", request, lambda *beside: self._cdr(request, *beside), wire.JSON)
        return self._reception.answer("correct", request, lambda *beside: self._correct(request, *beside))

    def correct_path(self, request: Request) -> Answer:
        """Answer a timed path."""
        return self._reception.answer("correct_path", request, lambda *beside: self._correct_path(request, *beside))

    def model(self, request: Request) -> Answer:
        """Answer which model is active."""
        return self._reception.answer("model", request, self._describe)

    def _correct(self, request: Request, codec: wire.Codec, meta: wire.RequestMeta, started: float) -> Answer:
        asked = codec.decode(wire.CorrectRequest, request.payload)
        model = self._active.pose_model()
        answer, position, quaternion = self._ask(model, asked.pose, asked.twist)
        message = wire.CorrectAnswer(
            position,
            quaternion,
            wire.gaps(answer.std.tolist()),
            wire.gaps(answer.interval95.tolist()),
            bool(answer.in_domain),
            answer.status,
            answer.reason,
        )
        beside = self._reception.beside(codec, meta, started, model)
        return Answer(
            codec.encode(message),
            wire.NAMES[codec.name, "correct"],
            beside,
            answer.status,
            outside=not answer.in_domain,
        )

    def _cdr(self, request: Request, codec: wire.Codec, meta: wire.RequestMeta, started: float) -> Answer:
        asked = read_pose(request.payload)
        model = self._active.pose_model()
        answer, position, quaternion = self._ask(model, asked.pose, None)
        command = (*position, *(quaternion or asked.pose[3:]))
        wall, serving = self._reception.elapsed(started)
        beside = CdrBeside(
            meta.request_id,
            model.id,
            model.hash,
            self._reception.replica,
            wall,
            serving,
            wire.gaps(answer.std.tolist()),
            wire.gaps(answer.interval95.tolist()),
            bool(answer.in_domain),
            answer.status,
            answer.reason,
        )
        payload = write_pose(StampedPose(command, asked.sec, asked.nanosec, asked.frame_id))
        return Answer(payload, CDR_ENCODING, codec.encode(beside), answer.status, outside=not answer.in_domain)

    def _ask(
        self, model: Model, pose: Sequence[float], twist: Sequence[float] | None
    ) -> tuple[Correction, list[float], list[float] | None]:
        asked = checked_pose(pose, model.limit)
        answer = model.corrector.correct(asked, checked_twist(twist))
        if self._bound is not None:
            answer = self._bounded(self._bound, model, asked, answer)
        position: list[float] = answer.position.tolist()
        quaternion = None if answer.quaternion is None else answer.quaternion.tolist()
        check_answer(position, quaternion, model.limit)
        return answer, position, quaternion

    def _bounded(self, bound: CorrectionBound, model: Model, asked: FloatArray, answer: Correction) -> Correction:
        parts = [answer.position] if answer.quaternion is None else [answer.position, answer.quaternion]
        command, cut = bound.apply(model.reference(asked[None]), np.concatenate(parts)[None])
        if not cut[0]:
            return answer
        quaternion = None if answer.quaternion is None else command[0, 3:]
        reason = "; ".join(filter(None, (BOUNDED, answer.reason)))
        return Correction(
            command[0, :3], quaternion, answer.std, answer.interval95, answer.in_domain, "LIMITED", reason
        )

    def _correct_path(self, request: Request, codec: wire.Codec, meta: wire.RequestMeta, started: float) -> Answer:
        asked = codec.decode(wire.CorrectPathRequest, request.payload)
        model = self._active.pose_model()
        poses, times = checked_path(asked.poses, asked.times, model.limit)
        message = self._path_message(model, poses, model.corrector.correct_path(poses, times))
        for row, position in enumerate(message.positions):
            check_answer(position, message.quaternions[row] if message.quaternions else None, model.limit)
        beside = self._reception.beside(codec, meta, started, model)
        status = first_trouble(message.status)
        outside = len(message.in_domain) - sum(message.in_domain)
        name = wire.encoding_name(codec, "correct_path")
        return Answer(codec.encode(message), name, beside, status, rows=len(poses), outside=outside)

    def _path_message(self, model: Model, poses: FloatArray, answer: PathResult) -> wire.CorrectPathAnswer:
        positions, quaternions = answer.positions, answer.quaternions
        status, reason = list(answer.status), list(answer.reason)
        if self._bound is not None:
            whole = positions if quaternions is None else np.hstack([positions, quaternions])
            bounded, cut = self._bound.apply(model.reference(poses), whole)
            positions, quaternions = bounded[:, :3], (None if quaternions is None else bounded[:, 3:])
            for row in np.flatnonzero(cut):
                status[row], reason[row] = "LIMITED", "; ".join(filter(None, (BOUNDED, reason[row])))
        return wire.CorrectPathAnswer(
            positions=positions.tolist(),
            quaternions=None if quaternions is None else quaternions.tolist(),
            std=wire.gap_rows(answer.std),
            interval95=wire.gap_rows(answer.interval95),
            in_domain=np.asarray(answer.in_domain, dtype=bool).tolist(),
            status=status,
            reason=reason,
        )

    def _describe(self, codec: wire.Codec, meta: wire.RequestMeta, started: float) -> Answer:
        now = self._active.now
        model = now.pose or now.joints
        if model is None:
            model = self._active.pose_model()
        info = dict(model.corrector.info() if isinstance(model, Model) else model.info)
        message = wire.ModelAnswer(model.id, model.hash, self._reception.arm, self._reception.replica, info)
        return plain_answer(codec, "model", message)


def first_trouble(statuses: Sequence[str]) -> str:
    """Return the status that a whole path is counted under: the first that is not OK."""
    return next((status for status in statuses if status != "OK"), "OK")
