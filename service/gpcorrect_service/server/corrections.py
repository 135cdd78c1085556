"""The keys that correct: one pose, a path, joints; and which model does it. From parsed requests to responses."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from msgspec.structs import asdict

from gpcorrect.correction import Correction, Reason
from gpcorrect.types import FloatArray
from gpcorrect_service.protocol import cdr, limits, messages
from gpcorrect_service.protocol.answer import JointsAnswer, PathAnswer, PoseAnswer, pack
from gpcorrect_service.protocol.errors import bad_input
from gpcorrect_service.server.models import JointModel, Model
from gpcorrect_service.server.requests import Handler, Parsed, RequestParser, Response, plain_response

BESIDE_CDR = ("std", "interval95", "in_domain", "status", "reason", "flags")


class Corrections:
    """Answers requests about poses, paths, joints and their models, within the bounds of the parser's settings."""

    def __init__(self, parser: RequestParser) -> None:
        self._parser, self._active, self._settings = parser, parser.active, parser.settings
        self._bound = parser.settings.bound if parser.settings.bound.acts else None

    def handlers(self) -> dict[messages.Kind, Handler]:
        """Return which key is answered by what."""
        handler = self._parser.handler
        return {
            "correct": handler("correct", self._correct),
            "correct_path": handler("correct_path", self._correct_path),
            "correct_joints": handler("correct_joints", self._correct_joints),
            "model": handler("model", self._model),
        }

    def _correct(self, parsed: Parsed) -> Response:
        """Answer one desired pose, in the encoding in which it came."""
        request, codec = parsed.request, parsed.codec
        if request.encoding.startswith(cdr.CDR_ENCODING):
            return self._correct_cdr(parsed)
        if request.encoding.startswith(cdr.CALL_ENCODING):
            return self._correct_call(parsed)
        asked = codec.decode(messages.CorrectRequest, request.payload)
        model = self._active.pose_model()
        message = self._corrected(model, asked.pose, asked.twist)
        return Response(
            codec.encode(message),
            codec.encoding("correct"),
            codec.encode(self._parser.meta(parsed, model)),
            message.status,
            outside=not message.in_domain,
        )

    def _correct_cdr(self, parsed: Parsed) -> Response:
        model = self._active.pose_model()
        command, message = self._stamped(model, cdr.read_pose(parsed.request.payload), None)
        # What a PoseStamped cannot carry travels beside it.
        beside = {**asdict(self._parser.meta(parsed, model)), **{name: getattr(message, name) for name in BESIDE_CDR}}
        return Response(
            cdr.write_pose(command),
            cdr.CDR_ENCODING,
            parsed.codec.encode(beside),
            message.status,
            outside=not message.in_domain,
        )

    def _correct_call(self, parsed: Parsed) -> Response:
        asked, twist = cdr.read_call(parsed.request.payload)
        model = self._active.pose_model()
        command, message = self._stamped(model, asked, twist)
        payload = cdr.write_answer(command, message, model.hash)
        return Response(payload, cdr.CALL_ENCODING, b"", message.status, outside=not message.in_domain)

    def _stamped(
        self, model: Model, asked: cdr.StampedPose, twist: messages.Numbers | None
    ) -> tuple[cdr.StampedPose, PoseAnswer]:
        """Correct a pose of ROS, in whose frame it must be; the command has the same stamp."""
        taken, given = model.frames
        limits.check_frame(asked.frame_id, self._settings.frame or taken)
        message = self._corrected(model, asked.pose, twist)
        quaternion: Any = message.quaternion or asked.pose[3:]
        return replace(asked, pose=(*message.position, *quaternion), frame_id=given or asked.frame_id), message  # type: ignore[misc]  # a pose's

    def _correct_path(self, parsed: Parsed) -> Response:
        """Answer a timed path."""
        asked = parsed.codec.decode(messages.CorrectPathRequest, parsed.request.payload)
        model = self._active.pose_model()
        poses, times = limits.checked_path(asked.poses, asked.times, model.limit)
        answer = model.corrector.correct_path(poses, times)
        self._check(answer)
        message = pack(PathAnswer, self._bounded(model, poses, answer))
        positions: Any = message.position
        quaternions: Any = message.quaternion or [None] * len(poses)
        for pose, position, quaternion in zip(poses, positions, quaternions, strict=True):
            limits.check_command(position, quaternion, model.limit, partial(model.reference_position, pose))
        return self._rows(parsed, "correct_path", model, message)

    def _correct_joints(self, parsed: Parsed) -> Response:
        """Answer a timed path of joints; each request is a path of its own, at rest before its first row."""
        asked = parsed.codec.decode(messages.CorrectJointsRequest, parsed.request.payload)
        model = self._active.joint_model()
        n, types = len(asked.q), model.corrector.types
        if not 0 < n <= limits.LIMITS.rows:
            raise bad_input(
                f"a path has 1 to {limits.LIMITS.rows} rows, got {n}.", "Cut longer paths where the robot rests."
            )
        for what, given in (("times", asked.times), ("efforts", asked.efforts), ("sessions", asked.sessions)):
            if given is not None and len(given) != n:
                raise bad_input(f"{n} rows of joints came with {len(given)} {what}.", f"Send one of {what} a row.")
        times, q = limits.check_times(asked.times), limits.checked_joints(asked.q, types)
        efforts = None if asked.efforts is None else limits.checked_rows(asked.efforts, len(types), "efforts")
        answer = model.corrector.correct_path(q, times, efforts, asked.sessions)
        self._check(answer)
        message = pack(JointsAnswer, answer)
        return self._rows(parsed, "correct_joints", model, message)

    def _model(self, parsed: Parsed) -> Response:
        """Answer which model is active."""
        now = self._active.now
        model = now.pose or now.joints or self._active.pose_model()
        info, rigid = dict(model.corrector.info()), getattr(model.corrector, "rigid", None)
        registration = None if rigid is None else rigid.to_dict()
        message = messages.ModelAnswer(
            model.id, model.hash, self._settings.arm, self._settings.replica, info, registration
        )
        return plain_response(parsed, "model", message)

    def _corrected(self, model: Model, pose: messages.Numbers, twist: messages.Numbers | None) -> PoseAnswer:
        asked = limits.checked_pose(pose, model.limit)
        answer = model.corrector.correct(asked, limits.checked_twist(twist))
        self._check(answer)
        message = pack(PoseAnswer, self._bounded(model, asked, answer))
        position: Any = message.position
        quaternion: Any = message.quaternion
        limits.check_command(position, quaternion, model.limit, partial(model.reference_position, asked))
        return message

    def _check(self, answer: Correction) -> None:
        if self._settings.strict:
            limits.check_inside(answer)

    def _bounded(self, model: Model, asked: FloatArray, answer: Correction) -> Correction:
        """Cut one answer, or each of n, to the operator's bound."""
        if self._bound is None:
            return answer
        parts = [part for part in (answer.position, answer.quaternion) if part is not None]
        command, cut = self._bound.apply(
            model.reference(np.atleast_2d(asked)), np.atleast_2d(np.concatenate(parts, axis=-1))
        )
        if not cut.any():
            return answer
        if asked.ndim == 1:
            command, cut = command[0], cut[0]
        quaternion = None if answer.quaternion is None else command[..., 3:]
        return replace(answer, position=command[..., :3], quaternion=quaternion).because(Reason.BOUNDED, cut)

    def _rows(
        self, parsed: Parsed, kind: messages.Kind, model: Model | JointModel, message: PathAnswer | JointsAnswer
    ) -> Response:
        """Return n answers, counted under the first status that is not OK."""
        return Response(
            parsed.codec.encode(message),
            parsed.codec.encoding(kind),
            parsed.codec.encode(self._parser.meta(parsed, model)),
            next((status for status in message.status if status != "OK"), "OK"),
            rows=len(message.flags),
            outside=message.in_domain.count(False),
        )
