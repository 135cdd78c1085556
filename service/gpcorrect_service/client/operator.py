"""The operator's client: asks every server of an arm, and tells what each one said."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeVar

import msgspec
import zenoh

from gpcorrect_service.client.exchange import Exchange, Message, no_service
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.sessions import open_client
from gpcorrect_service.protocol.settings import DEFAULT_ENDPOINT, ClientSettings
from gpcorrect_service.protocol.wire_admin import (
    ActivateAnswer,
    ActivateRequest,
    ModelListAnswer,
    StateAnswer,
    StateRequest,
)

__all__ = ["Operator"]

POLL_SECONDS = 0.01
S = TypeVar("S", bound=msgspec.Struct)


class Operator:
    """Lists and activates models, pauses and goes on, at every server of an arm at once; a context manager.

    Parameters
    ----------
    settings : ClientSettings
        Whom to ask.
    patience : float
        Seconds for a server to load and try a model.
    """

    def __init__(self, settings: ClientSettings | None = None, *, patience: float = 30.0) -> None:
        self._settings = settings or ClientSettings((DEFAULT_ENDPOINT,))
        self._patience = patience
        self._exchange = Exchange("json")
        self._session = open_client(self._settings)

    @classmethod
    def at(
        cls, endpoint: str, arm: str = "arm1", namespace: str = "gpcorrect", config_file: Path | None = None
    ) -> Self:
        """Return the operator of the servers at one address."""
        return cls(ClientSettings((endpoint,), arm, namespace, config_file=config_file))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        with suppress(zenoh.ZError):  # a server that hangs does not say goodbye
            self._session.close()  # type: ignore[no-untyped-call]

    def models(self) -> list[ModelListAnswer]:
        """Return the models of every server's store.

        Raises
        ------
        ServiceError
            NO_SERVICE: nobody answered; or the refusal of a server.
        """
        return self._ask("model/list", None, ModelListAnswer)

    def activate(self, model: str) -> list[ActivateAnswer]:
        """Make every server answer with a model of its store, named or by the beginning of its hash; raises so too."""
        return self._ask("admin/activate", ActivateRequest(model), ActivateAnswer)

    def set_state(self, state: Literal["ENABLED", "PAUSED"]) -> list[StateAnswer]:
        """Pause every server, or let it go on; raises as :meth:`models`."""
        return self._ask("admin/state", StateRequest(state), StateAnswer)

    def _ask(self, kind: wire.Kind, body: msgspec.Struct | None, form: type[S]) -> list[S]:
        """Return what every server answered; the first refusal is raised when all have spoken."""
        querier = self._session.declare_querier(
            f"{self._settings.arm}/{kind}",
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=self._patience,
        )
        with querier:
            self._await_server(querier)
            answers, refusals = self._collect(querier, self._exchange.message(kind, body, self._patience), form)
        if refusals:
            raise refusals[0]
        if not answers:
            raise no_service(settings=self._settings)
        return answers

    def _collect(self, querier: zenoh.Querier, message: Message, form: type[S]) -> tuple[list[S], list[ServiceError]]:
        answers: list[S] = []
        refusals: list[ServiceError] = []
        replies = querier.get(payload=message.payload, encoding=message.encoding, attachment=message.attachment)
        for reply in replies:
            try:
                answers.append(self._exchange.read(reply, form)[0])
            except ServiceError as error:
                refusals.append(error)
        return answers, refusals

    def _await_server(self, querier: zenoh.Querier) -> None:
        until = time.monotonic() + self._settings.connect_timeout
        while not _matches(querier):
            if time.monotonic() > until:
                raise no_service(settings=self._settings)
            time.sleep(POLL_SECONDS)


def _matches(querier: zenoh.Querier) -> bool:
    status = querier.matching_status
    return bool(getattr(status, "matching", status))
