"""What a store says anew is done by every server of it: whichever of them the operator told, and whichever hung."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from gpcorrect.calibration import ModelStore
from gpcorrect.errors import GpCorrectError
from gpcorrect_service.ops.logger import Logger
from gpcorrect_service.server.models import KINDS, Active, load_next


class StoreWatch:
    """Pauses, goes on and activates as the store says since the last look.

    What was active there at first is left alone: the server may have been started with a model of its own.

    Parameters
    ----------
    store : ModelStore
    """

    def __init__(self, store: ModelStore) -> None:
        self.store = store
        self._paused = False
        self._seen = {kind: entry.hash for kind in KINDS if (entry := store.active(kind)) is not None}

    def look(self, active: Active, arm: str, logger: Logger, changed: Callable[[], None]) -> None:
        """Do what the store says since the last look; one that is gone, or cannot be read, says nothing new.

        Parameters
        ----------
        active : Active
        arm : str, as in :func:`gpcorrect_service.server.models.check_arm`
        logger : Logger
        changed : callable, called when another model answers
        """
        with suppress(GpCorrectError):
            if not self.store.exists:
                return
            paused = self.store.paused
            if paused != self._paused:
                self._paused = paused
                active.pause(paused)
                logger.warning("state of the store", state=active.state)
            for kind in KINDS:
                self._follow(kind, active, arm, logger, changed)

    def _follow(self, kind: str, active: Active, arm: str, logger: Logger, changed: Callable[[], None]) -> None:
        """Answer with the store's model of a kind where another one was activated there; a bad one is tried once."""
        with active.changing:
            entry = self.store.active(kind)
            if entry is None or entry.hash == self._seen.get(kind):
                return
            self._seen[kind] = entry.hash
            before = active.of(kind)
            if before is not None and before.hash == entry.hash:
                return
            try:
                model = load_next(self.store, entry, active, arm)
            except GpCorrectError as error:
                logger.error("model of the store refused", kind=kind, model_id=entry.id, cause=error.message)
                return
            active.activate(model)
            changed()
        old = before.hash if before else ""
        logger.info("activated in the store", kind=kind, model_id=model.id, model_hash=model.hash, before=old)
