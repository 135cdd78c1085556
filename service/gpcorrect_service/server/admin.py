"""The operator's keys: list and activate models, pause and go on; and the monitor's: health and metrics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gpcorrect.calibration import Entry, ModelStore, last_measured, refuse_other_use
from gpcorrect.errors import ArtifactError, DataError, GpCorrectError
from gpcorrect_service.ops.metrics import OPENMETRICS, Counters, Metrics
from gpcorrect_service.protocol import messages
from gpcorrect_service.protocol.errors import ServiceError, bad_input
from gpcorrect_service.server.models import JointModel, Model, check_arm, load_joint_model, load_model
from gpcorrect_service.server.queues import WorkerQueue
from gpcorrect_service.server.requests import Handler, Parsed, RequestParser, Response, plain_response


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

    def handlers(self) -> dict[messages.Kind, Handler]:
        """Return which key is answered by what."""
        handler = self._parser.handler
        return {
            "model/list": handler("model/list", self._models),
            "admin/activate": handler("admin/activate", self._activate),
            "admin/state": handler("admin/state", self._state),
        }

    def _models(self, parsed: Parsed) -> Response:
        """Answer which models there are."""
        now = self._active.now
        serving = {kind: m.hash for kind, m in (("pose", now.pose), ("joints", now.joints)) if m is not None}
        entries, history = [], {}
        if self._store is not None:
            history = {kind: [entry.hash for entry in self._store.history(kind)] for kind in ("pose", "joints")}
            entries = [_listed(self._store, e, active=serving.get(e.kind) == e.hash) for e in self._store.models()]
        return plain_response(parsed, "model/list", messages.ModelListAnswer(self._replica, entries, history, serving))

    def _activate(self, parsed: Parsed) -> Response:
        """Load, verify and try a model of the store once, note it there, and answer with it from then on."""
        asked = parsed.codec.decode(messages.ActivateRequest, parsed.request.payload)
        if self._store is None:
            raise bad_input("this server has no model store.", "Start it with: gpcorrect serve --store FOLDER")
        entry = self._store.find(asked.model)
        now = self._active.now
        before = now.pose if entry.kind == "pose" else now.joints
        try:
            model = load_entry(self._store, entry)
            check_arm(self._parser.settings.arm, model, now.joints if entry.kind == "pose" else now.pose)
            if before is not None:
                refuse_other_use(model.id, model.corrector.info(), before.corrector.info())
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
        self._logger.info("activated", kind=entry.kind, model_id=model.id, model_hash=model.hash, before=old)
        message = messages.ActivateAnswer(model.id, model.hash, entry.kind, old, self._replica)
        return plain_response(parsed, "admin/activate", message)

    def _state(self, parsed: Parsed) -> Response:
        """Pause, or go on; where there is a store, whoever starts from it later does so too."""
        asked = parsed.codec.decode(messages.StateRequest, parsed.request.payload)
        paused, stays = asked.state == "PAUSED", self._store is not None
        self._active.pause(paused)
        if self._store is not None:
            try:
                self._store.pause(paused=paused)
            except GpCorrectError as error:  # the disk is full: what was asked holds here and now all the same
                stays = False
                self._logger.error("state not stored", cause=error.message)
        self._logger.warning("state set", asked=asked.state, state=self._active.state)
        return plain_response(parsed, "admin/state", messages.StateAnswer(self._active.state, self._replica, stays))


class Health:
    """Answers `health` and `metrics`; touches neither the models nor the queues it reports on, which a server fills."""

    def __init__(self, parser: RequestParser, counters: Counters, queues: Mapping[str, WorkerQueue[Any]]) -> None:
        self._parser, self._counters, self._queues = parser, counters, queues
        self._started = parser.clock.monotonic()
        self.metrics = Metrics(self.report, counters)

    def handlers(self) -> dict[messages.Kind, Handler]:
        """Return which key is answered by what; metrics are, whatever the request holds."""
        return {
            "health": self._parser.handler("health", lambda parsed: plain_response(parsed, "health", self.report())),
            "metrics": lambda _: Response(self.metrics.text, OPENMETRICS),
        }

    def report(self) -> messages.HealthAnswer:
        """Return the state of this moment; FAULT also when a worker is gone."""
        active = self._parser.active
        now = active.now
        queues = dict(self._queues)  # as they are now: while a server starts, more are added
        return messages.HealthAnswer(
            state=active.state if all(queue.alive for queue in queues.values()) else "FAULT",
            model_id=now.pose.id if now.pose else "",
            model_hash=now.pose.hash if now.pose else "",
            uptime=self._parser.clock.monotonic() - self._started,
            queued={name: queue.waiting for name, queue in queues.items()},
            counts=self._counters.counts(),
            joint_model_id=now.joints.id if now.joints else "",
            joint_model_hash=now.joints.hash if now.joints else "",
            arm=self._parser.settings.arm,
            replica=self._parser.settings.replica,
        )


def load_entry(store: ModelStore, entry: Entry) -> Model | JointModel:
    """Return a model of a store, verified and tried on its recorded check queries; ArtifactError if refused.

    Parameters
    ----------
    store : ModelStore
    entry : Entry
    """
    load = load_model if entry.kind == "pose" else load_joint_model
    return load(store.path(entry), entry.id, entry.hash)


def _listed(store: ModelStore, entry: Entry, *, active: bool) -> messages.ModelEntry:
    history = store.made(entry)
    measured = last_measured(history)
    errors = [messages.PartRmse(row.part, row.unit, row.rmse) for row in measured.corrected] if measured else []
    made = history[-1].date if history else ""
    return messages.ModelEntry(entry.id, entry.hash, entry.kind, entry.added, active, made, errors)
