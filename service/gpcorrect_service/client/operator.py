"""The operator's client: asks every server of an arm, and returns what each one answered."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, suppress
from typing import Literal, TypeVar

import msgspec
import zenoh

from gpcorrect_service.client.connection import POLL_SECONDS, matched
from gpcorrect_service.client.requests import RequestBuilder, no_service
from gpcorrect_service.protocol import messages
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.sessions import LIVE_KEYS, open_client, require_own_process
from gpcorrect_service.protocol.settings import ClientSettings

S = TypeVar("S", messages.ModelListAnswer, messages.ActivateAnswer, messages.StateAnswer)


class Operator(AbstractContextManager["Operator"]):
    """Lists and activates models, pauses and goes on, at every server of an arm at once; a context manager.

    Parameters
    ----------
    settings : ClientSettings
    patience : float, seconds for a server to load and try a model
    """

    def __init__(self, settings: ClientSettings, *, patience: float = 30.0) -> None:
        self._settings, self._patience = settings, patience
        self._build = RequestBuilder(settings, "json")
        self._session = open_client(settings)

    def __exit__(self, *_: object) -> None:
        with suppress(zenoh.ZError):  # a server that hangs does not say goodbye
            self._session.close()  # type: ignore[no-untyped-call]

    def models(self) -> list[messages.ModelListAnswer]:
        """Return the models of every server's store; NO_SERVICE where nobody answered, or the refusal of a server."""
        return self._ask("model/list", messages.ModelListAnswer)

    def activate(self, model: str, *, back: bool = False) -> list[messages.ActivateAnswer]:
        """Make every server answer with a model of its store.

        Parameters
        ----------
        model : str, its name, or the beginning of its hash
        back : bool, whether it is the one before, for which the present one is given up

        Raises
        ------
        ServiceError
            As :meth:`models`; NO_SERVICE also where a server that lives did not answer; OTHER_MODEL: its name means
            different models in the stores of different servers.
        """
        answers = self._ask("admin/activate", messages.ActivateAnswer, messages.ActivateRequest(model, back))
        if len({answer.hash for answer in answers}) > 1:
            found = ", ".join(f"{answer.replica} has {answer.hash[:12]}" for answer in answers)
            cause = f"{model} names different models in the servers' stores, and each activated its own: {found}."
            hint = "Activate one that all stores hold, by its hash: gpcorrect models list"
            raise ServiceError("OTHER_MODEL", cause, hint=hint)
        return answers

    def set_state(self, state: Literal["ENABLED", "PAUSED"]) -> list[messages.StateAnswer]:
        """Pause every server, or let it go on; raises as :meth:`activate`.

        Parameters
        ----------
        state : str
        """
        return self._ask("admin/state", messages.StateAnswer, messages.StateRequest(state))

    def _ask(self, kind: messages.Kind, form: type[S], body: msgspec.Struct | None = None) -> list[S]:
        """Return what every server answered; the first refusal, or silence, is raised when all have answered."""
        require_own_process()
        question = self._build.plain(kind, form, body, self._patience)
        answers: list[S] = []
        refusals: list[ServiceError] = []
        unheard = no_service(settings=self._settings)
        with self._session.declare_querier(
            f"{self._settings.arm}/{kind}",
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=self._patience,
        ) as querier:
            until = time.monotonic() + self._settings.connect_timeout
            while not matched(querier):
                if time.monotonic() > until:
                    raise unheard
                time.sleep(POLL_SECONDS)
            # The names of the servers that show that they live.
            tokens = self._session.liveliness().get(f"{self._settings.arm}/{LIVE_KEYS}", timeout=self._settings.timeout)
            living = {str(token.ok.key_expr).split("/")[-3] for token in tokens if token.ok is not None}
            for reply in querier.get(
                payload=question.payload, encoding=question.encoding, attachment=question.attachment
            ):
                try:
                    answers.append(question.read(reply))
                except ServiceError as error:
                    if error.status == "NO_SERVICE":  # zenoh's own word that a server did not answer in time
                        unheard = error
                    else:
                        refusals.append(error)
        if refusals:
            first, others = refusals[0], ", ".join(answer.replica for answer in answers)
            more = f" {len(refusals)} of {len(refusals) + len(answers)} servers refused; {others} did it."
            cause = first.message + (more if others else "")
            raise ServiceError(first.status, cause, hint=first.hint, request_id=first.request_id)
        if not answers:
            raise unheard
        answered = {answer.replica for answer in answers}
        if kind != "model/list" and (silent := sorted(living - answered)):
            raise ServiceError(
                "NO_SERVICE",
                f"{', '.join(silent)} did not answer, and may go on as before when it does; "
                f"{', '.join(sorted(answered))} answered.",
                hint="Is that process stopped, or very busy? End it, or ask again.",
            )
        return answers
