"""What answers the keys: corrections; models and pausing, for operators; health and metrics, for monitors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict

from gpcorrect.calibration import Entry, ModelStore, commands_apart, last_measured
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import ArtifactError, DataError, GpCorrectError
from gpcorrect.types import FloatArray
from gpcorrect_service.ops.metrics import OPENMETRICS, Counters, Metrics
from gpcorrect_service.protocol import limits, messages, ros
from gpcorrect_service.protocol.answer import JointsAnswer, PathAnswer, PoseAnswer, pack
from gpcorrect_service.protocol.errors import ServiceError, bad_input
from gpcorrect_service.server.models import KINDS, JointModel, Model, load_next
from gpcorrect_service.server.queues import WorkerQueue
from gpcorrect_service.server.requests import Handler, Parsed, RequestParser, Response, plain_response

BESIDE_CDR = ("std", "interval95", "in_domain", "status", "reason", "flags")


class Corrections:
    """Answers requests about poses, paths, joints and their models, within the bounds of the parser's settings."""

    def __init__(self, parser: RequestParser) -> None:
        self._parser, self._active, self._settings = parser, parser.active, parser.settings
        self._bound = parser.settings.bound if parser.settings.bound.acts else None

    def handlers(self) -> dict[messages.Kind, Handler]:
        """Return which key is answered by what."""
        return self._parser.handlers(
            {
                "correct": self._correct,
                "correct_path": self._correct_path,
                "correct_joints": self._correct_joints,
                "model": self._model,
            }
        )

    def _correct(self, parsed: Parsed) -> Response:
        """Answer one desired pose, in the encoding in which it came."""
        request = parsed.request
        if request.encoding.startswith(ros.CDR_ENCODING):
            return self._correct_cdr(parsed)
        if request.encoding.startswith(ros.CALL_ENCODING):
            return self._correct_call(parsed)
        asked = parsed.codec.decode(messages.CorrectRequest, request.payload)
        model = self._active.pose_model()
        message = self._corrected(model, asked.pose, asked.twist)
        return self._response(parsed, model, message, message.status, outside=not message.in_domain)

    def _correct_cdr(self, parsed: Parsed) -> Response:
        model = self._active.pose_model()
        command, message = self._stamped(model, ros.read_pose(parsed.request.payload), None)
        # What a PoseStamped cannot carry travels beside it.
        beside = {**asdict(self._parser.meta(parsed, model)), **{name: getattr(message, name) for name in BESIDE_CDR}}
        return Response(
            ros.write_pose(command),
            ros.CDR_ENCODING,
            parsed.codec.encode(beside),
            message.status,
            rows=1,
            outside=not message.in_domain,
        )

    def _correct_call(self, parsed: Parsed) -> Response:
        asked, twist = ros.read_call(parsed.request.payload)
        model = self._active.pose_model()
        command, message = self._stamped(model, asked, twist)
        payload = ros.write_answer(command, message, model.hash)
        return Response(payload, ros.CALL_ENCODING, b"", message.status, rows=1, outside=not message.in_domain)

    def _stamped(
        self, model: Model, asked: ros.StampedPose, twist: messages.Numbers | None
    ) -> tuple[ros.StampedPose, PoseAnswer]:
        """Correct a pose of ROS, in whose frame it must be; the command has the same stamp."""
        taken, given = model.frames
        limits.check_frame(asked.frame_id, self._settings.frame or taken)
        message = self._corrected(model, asked.pose, twist)
        pose = (*message.position, *(message.quaternion or asked.pose[3:]))
        return replace(asked, pose=pose, frame_id=given or asked.frame_id), message

    def _correct_path(self, parsed: Parsed) -> Response:
        """Answer a timed path."""
        asked = parsed.codec.decode(messages.CorrectPathRequest, parsed.request.payload)
        model = self._active.pose_model()
        poses, times = limits.checked_path(asked.poses, asked.times, model.limit)
        answer = model.corrector.correct_path(poses, times)
        self._check(answer)
        message = pack(PathAnswer, self._bounded(model, poses, answer))
        quaternions: Any = message.quaternion or [None] * len(poses)
        for pose, position, quaternion in zip(poses, message.position, quaternions, strict=True):
            limits.check_command(position, quaternion, model.limit, partial(model.reference_position, pose))
        return self._rows(parsed, model, message)

    def _correct_joints(self, parsed: Parsed) -> Response:
        """Answer a timed path of joints; each request is a path of its own, at rest before its first row."""
        asked = parsed.codec.decode(messages.CorrectJointsRequest, parsed.request.payload)
        model = self._active.joint_model()
        n, types = len(asked.q), model.corrector.types
        if not 0 < n <= limits.LIMITS.rows:
            hint = "Cut longer paths where the robot rests."
            raise bad_input(f"a path has 1 to {limits.LIMITS.rows} rows, got {n}.", hint)
        for what, given in (("times", asked.times), ("efforts", asked.efforts), ("sessions", asked.sessions)):
            if given is not None and len(given) != n:
                raise bad_input(f"{n} rows of joints came with {len(given)} {what}.", f"Send one of {what} a row.")
        times, q = limits.check_times(asked.times), limits.checked_joints(asked.q, types)
        efforts = None if asked.efforts is None else limits.checked_rows(asked.efforts, len(types), "efforts")
        answer = model.corrector.correct_path(q, times, efforts, asked.sessions)
        self._check(answer)
        return self._rows(parsed, model, pack(JointsAnswer, answer))

    def _model(self, parsed: Parsed) -> Response:
        """Answer which model is active."""
        model = self._active.pose or self._active.joints or self._active.pose_model()
        info, rigid = dict(model.corrector.info()), getattr(model.corrector, "rigid", None)
        registration = None if rigid is None else rigid.to_dict()
        message = messages.ModelAnswer(
            model.id, model.hash, self._settings.arm, self._settings.replica, info, registration
        )
        return plain_response(parsed, message)

    def _corrected(self, model: Model, pose: messages.Numbers, twist: messages.Numbers | None) -> PoseAnswer:
        asked = limits.checked_pose(pose, model.limit)
        answer = model.corrector.correct(asked, limits.checked_twist(twist))
        self._check(answer)
        message = pack(PoseAnswer, self._bounded(model, asked, answer))
        reference = partial(model.reference_position, asked)
        limits.check_command(message.position, message.quaternion, model.limit, reference)
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

    def _rows(self, parsed: Parsed, model: Model | JointModel, message: PathAnswer | JointsAnswer) -> Response:
        """Return n answers, counted under the first status that is not OK."""
        status = next((status for status in message.status if status != "OK"), "OK")
        return self._response(parsed, model, message, status, len(message.flags), message.in_domain.count(False))

    def _response(
        self, parsed: Parsed, model: Model | JointModel, message: Struct, status: str, rows: int = 1, outside: int = 0
    ) -> Response:
        payload = parsed.codec.encode(message)
        beside = parsed.codec.encode(self._parser.meta(parsed, model))  # now: serving time holds that of the payload
        return Response(payload, parsed.codec.encoding(parsed.kind), beside, status, rows=rows, outside=outside)


class Admin:
    """Answers the operator, from a store of models if there is one; calls `changed` when another model answers.

    Queries under way end with the model they began with.
    """

    def __init__(
        self, parser: RequestParser, store: ModelStore | None, changed: Callable[[], None] = lambda: None
    ) -> None:
        self._parser, self._active, self._logger = parser, parser.active, parser.logger
        self._replica = parser.settings.replica
        self._store, self._changed = store, changed
        self._stored = store is not None and store.exists

    def handlers(self) -> dict[messages.Kind, Handler]:
        """Return which key is answered by what."""
        return self._parser.handlers(
            {"model/list": self._models, "admin/activate": self._activate, "admin/state": self._state}
        )

    def _models(self, parsed: Parsed) -> Response:
        """Answer which models there are."""
        held = (("pose", self._active.pose), ("joints", self._active.joints))
        serving = {kind: model.hash for kind, model in held if model is not None}
        entries, history = [], {}
        if self._store is not None:
            history = {kind: [entry.hash for entry in self._store.history(kind)] for kind in KINDS}
            entries = [_listed(self._store, e, active=serving.get(e.kind) == e.hash) for e in self._store.models()]
        return plain_response(parsed, messages.ModelListAnswer(self._replica, entries, history, serving))

    def _activate(self, parsed: Parsed) -> Response:
        """Load, verify and try a model of the store once, note it there, and answer with it from then on."""
        asked = parsed.codec.decode(messages.ActivateRequest, parsed.request.payload)
        if self._store is None:
            raise bad_input("this server has no model store.", "Start it with: gpcorrect serve --store FOLDER")
        entry = self._store.find(asked.model)
        with self._active.changing:
            before = self._active.of(entry.kind)
            try:
                model = load_next(self._store, entry, self._active, self._parser.settings.arm)
                self._store.activate(entry, verified=True, back=asked.back)
            except ArtifactError as error:
                raise bad_input(f"{error.message} The active model stays.", error.hint) from error
            except DataError:
                raise
            except GpCorrectError as error:
                # Nothing of the model is at fault: the disk is full, or may not be written.
                raise ServiceError("BUSY", error.message, hint=error.hint) from error
            self._active.activate(model)
            self._changed()
        old = before.hash if before else ""
        apart: tuple[float | None, float | None] = (None, None)
        if isinstance(before, Model) and isinstance(model, Model):
            found = commands_apart(before.corrector, model.corrector)
            apart = found["max_mm"], found["max_deg"]
        answer = messages.ActivateAnswer(model.id, model.hash, entry.kind, old, self._replica, *apart)
        self._logger.info(
            "activated",
            kind=entry.kind,
            model_id=model.id,
            model_hash=model.hash,
            before=old,
            apart_mm=answer.apart_mm,
            apart_deg=answer.apart_deg,
        )
        return plain_response(parsed, answer)

    def _state(self, parsed: Parsed) -> Response:
        """Pause, or go on; where there is a store, whoever starts from it later does so too."""
        asked = parsed.codec.decode(messages.StateRequest, parsed.request.payload)
        paused, stays = asked.state == "PAUSED", self._store is not None
        self._active.pause(paused)
        if self._store is not None:
            try:
                if self._stored and not self._store.exists:
                    raise DataError(f"the model store {self._store.folder} is gone.")
                self._store.pause(paused=paused)
            except GpCorrectError as error:  # the disk is full: what was asked holds here and now all the same
                stays = False
                self._logger.error("state not stored", cause=error.message)
        self._logger.warning("state set", asked=asked.state, state=self._active.state)
        return plain_response(parsed, messages.StateAnswer(self._active.state, self._replica, stays))


class Health:
    """Answers `health` and `metrics`; touches neither the models nor the queues it reports on, which a server fills."""

    def __init__(self, parser: RequestParser, counters: Counters, queues: Mapping[str, WorkerQueue[Any]]) -> None:
        self._parser, self._counters, self._queues = parser, counters, queues
        self._started = parser.clock.monotonic()
        self.metrics = Metrics(self.report, counters)

    def handlers(self) -> dict[messages.Kind, Handler]:
        """Return which key is answered by what; metrics are, whatever the request holds."""
        health = self._parser.handlers({"health": lambda parsed: plain_response(parsed, self.report())})
        return {**health, "metrics": lambda _: Response(self.metrics.text, OPENMETRICS)}

    def report(self) -> messages.HealthAnswer:
        """Return the state of this moment; FAULT also when a worker is gone."""
        active = self._parser.active
        pose, joints = active.pose, active.joints
        queues = dict(self._queues)  # as they are now: while a server starts, more are added
        return messages.HealthAnswer(
            state=active.state if all(queue.alive for queue in queues.values()) else "FAULT",
            model_id=pose.id if pose else "",
            model_hash=pose.hash if pose else "",
            uptime=self._parser.clock.monotonic() - self._started,
            queued={name: queue.waiting for name, queue in queues.items()},
            counts=self._counters.counts(),
            joint_model_id=joints.id if joints else "",
            joint_model_hash=joints.hash if joints else "",
            arm=self._parser.settings.arm,
            replica=self._parser.settings.replica,
        )


def _listed(store: ModelStore, entry: Entry, *, active: bool) -> messages.ModelEntry:
    history = store.made(entry)
    measured = last_measured(history)
    errors = [messages.PartRmse(row.part, row.unit, row.rmse) for row in measured.corrected] if measured else []
    made = history[-1].date if history else ""
    return messages.ModelEntry(entry.id, entry.hash, entry.kind, entry.added, active, made, errors)
