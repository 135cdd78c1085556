"""The operator's keys: list and activate models of the server's store, pause and go on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gpcorrect.errors import ArtifactError, DataError, GpCorrectError
from gpcorrect.model_store import Entry, ModelStore
from gpcorrect_service.ops.logger import Journal
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.wire_admin import (
    ActivateAnswer,
    ActivateRequest,
    ModelEntry,
    ModelListAnswer,
    StateAnswer,
    StateRequest,
)
from gpcorrect_service.server.answers import Answer, Request, plain_answer
from gpcorrect_service.server.models import JointModel, Model, load_joint_model, load_model
from gpcorrect_service.server.requests import Reception

__all__ = ["Admin", "load_entry"]


class Admin:
    """Answers the operator; queries under way end with the model they began with.

    Parameters
    ----------
    reception : Reception
        Reads and refuses.
    store : ModelStore or None
        Where models are; without it none can be activated.
    journal : Journal
        Where every change is written.
    """

    def __init__(self, reception: Reception, store: ModelStore | None, journal: Journal) -> None:
        self._reception = reception
        self._store = store
        self._journal = journal

    def models(self, request: Request) -> Answer:
        """Answer which models there are."""
        return self._reception.answer("model/list", request, lambda codec, *_: self._list(codec))

    def activate(self, request: Request) -> Answer:
        """Load, verify and try a model of the store, note it there, and answer with it from then on."""
        return self._reception.answer("admin/activate", request, lambda codec, *_: self._activate(request, codec))

    def state(self, request: Request) -> Answer:
        """Pause, or go on."""
        return self._reception.answer("admin/state", request, lambda codec, *_: self._set_state(request, codec))

    def _list(self, codec: wire.Codec) -> Answer:
        now = self._reception.active.now
        serving = {k: m.hash for k, m in (("pose", now.pose), ("joints", now.joints)) if m is not None}
        entries, history = [], {}
        if self._store is not None:
            history = {kind: [entry.hash for entry in self._store.history(kind)] for kind in ("pose", "joints")}
            entries = [
                ModelEntry(e.id, e.hash, e.kind, e.added, serving.get(e.kind) == e.hash) for e in self._store.models()
            ]
        message = ModelListAnswer(self._reception.replica, entries, history, serving)
        return plain_answer(codec, "model/list", message)

    def _activate(self, request: Request, codec: wire.Codec) -> Answer:
        asked = codec.decode(ActivateRequest, request.payload)
        if self._store is None:
            raise ServiceError(
                "BAD_INPUT", "this server has no model store.", hint="Start it with: gpcorrect serve --store FOLDER"
            )
        entry = self._store.find(asked.model)
        now = self._reception.active.now
        before = now.pose if entry.kind == "pose" else now.joints
        try:
            model = load_entry(self._store, entry)
            _check_fits(model, before)
            self._store.activate(entry)
        except ArtifactError as error:
            raise ServiceError("BAD_INPUT", f"{error.message} The active model stays.", hint=error.hint) from error
        except DataError:
            raise
        except GpCorrectError as error:
            # Nothing of the model is at fault: the disk is full, or may not be written.
            raise ServiceError("BUSY", error.message, hint=error.hint) from error
        self._reception.active.activate(model)
        old = before.hash if before else ""
        self._journal.info("activated", kind=entry.kind, model_id=model.id, model_hash=model.hash, before=old)
        return plain_answer(
            codec, "admin/activate", ActivateAnswer(model.id, model.hash, entry.kind, old, self._reception.replica)
        )

    def _set_state(self, request: Request, codec: wire.Codec) -> Answer:
        asked = codec.decode(StateRequest, request.payload)
        active = self._reception.active
        active.pause(asked.state == "PAUSED")
        self._journal.warning("state set", asked=asked.state, state=active.state)
        return plain_answer(codec, "admin/state", StateAnswer(active.state, self._reception.replica))


def load_entry(store: ModelStore, entry: Entry) -> Model | JointModel:
    """Return a model of a store, read whole, verified and tried on its recorded check queries.

    Raises
    ------
    ArtifactError
        The file is refused, or is not the one that was added.
    """
    read = load_model if entry.kind == "pose" else load_joint_model
    model = read(store.path(entry), entry.id)
    if model.hash != entry.hash:
        raise ArtifactError(
            f"model file {store.path(entry)} is refused: it is not the file that was added under this hash.",
            hint="Add it again: gpcorrect models add",
        )
    return model


def _check_fits(model: Model | JointModel, before: Model | JointModel | None) -> None:
    """Refuse a model that says it was learned on another arm, or answers in other frames, than the one it follows."""
    if before is None:
        return
    new, old = _info(model), _info(before)
    for what in ("arm", "frames", "types"):
        one, other = old.get(what), new.get(what)
        if one and other and one != other:
            raise ArtifactError(
                f"model {model.id} has {what} {other}, the active model {one}.",
                hint="Activate a model of this arm; another arm has its own server.",
            )


def _info(model: Model | JointModel) -> Mapping[str, Any]:
    return model.corrector.info() if isinstance(model, Model) else {**model.info, "types": model.types}
