"""A client's way to ask a key: the nearest server first, then every server."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from typing import Any

import zenoh

from gpcorrect_service.client.requests import Question, no_service
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.settings import ClientSettings

POLL_SECONDS = 0.002  # chosen by hand: between looks at whether a server has appeared
SUSPICION_SECONDS = 10.0  # after which zenoh itself drops a server that hangs (its lease)


def matched(querier: zenoh.Querier) -> bool:
    """Whether some server declares a querier's key now.

    Parameters
    ----------
    querier : zenoh.Querier
    """
    status: Any = querier.matching_status  # zenoh's stubs say bool; it is a MatchingStatus
    return bool(status.matching)


class Querier:
    """Two ways to ask one key: the nearest server, then every server.

    zenoh always sends to the same nearest server and does not leave one that hangs, hence the second way; while the
    nearest one is under suspicion, every server is asked at once.

    Parameters
    ----------
    session : zenoh.Session
    key : str
    settings : ClientSettings
    timeout : float, seconds for one answer, the retry included
    fresh : bool, whether nothing was asked of this key before: that question may wait for a server
    """

    def __init__(
        self, session: zenoh.Session, key: str, settings: ClientSettings, timeout: float, *, fresh: bool
    ) -> None:
        self._nearest, self.everyone = (
            session.declare_querier(
                key,
                target=target,
                # Replies pass as they come; the default holds them back until every server has answered.
                consolidation=zenoh.ConsolidationMode.NONE,
                # A server that stopped reading must not stop the planner as well.
                congestion_control=zenoh.CongestionControl.DROP,
                timeout=timeout / 2,
            )
            for target in (zenoh.QueryTarget.BEST_MATCHING, zenoh.QueryTarget.ALL)
        )
        self._settings = settings
        self._trusted_from = -math.inf
        self.fresh = fresh

    @property
    def matched(self) -> bool:
        """Whether some server declares this key now; none does once the client was closed, in whichever thread."""
        try:
            return matched(self._nearest)
        except (zenoh.ZError, RuntimeError):  # RuntimeError: "already mutably borrowed", by the thread that closes it
            return False

    @property
    def first(self) -> zenoh.Querier:
        """Whom to ask first."""
        return self._nearest if time.monotonic() >= self._trusted_from else self.everyone

    def suspect(self) -> None:
        """Note that the nearest server is silent or has another model: for a while it is not asked alone."""
        self._trusted_from = time.monotonic() + SUSPICION_SECONDS

    def ask(self, querier: zenoh.Querier, handler: Any, question: Question[Any]) -> Any:
        """Send a question; return what zenoh makes of the handler. NO_SERVICE where the session is closed.

        Parameters
        ----------
        querier : zenoh.Querier, :attr:`first` or :attr:`everyone`
        handler
            zenoh's, for the replies.
        question : Question
        """
        try:
            return querier.get(
                handler, payload=question.payload, encoding=question.encoding, attachment=question.attachment
            )
        except (zenoh.ZError, RuntimeError) as error:  # as in `matched`
            raise self.silence() from error

    def close(self) -> None:
        """Take the key back, while its session is open.

        A zenoh querier that is freed after its session was closed leaves the session's shared memory mapped, and the
        traceback of an error holds on to one until Python collects it.
        """
        for one in (self._nearest, self.everyone):
            with suppress(zenoh.ZError):
                while True:
                    try:
                        one.undeclare()  # type: ignore[no-untyped-call]
                        break
                    except RuntimeError:  # "borrowed": another thread sends a question with it just now
                        time.sleep(POLL_SECONDS)

    def silence(self) -> ServiceError:
        """Return the error of a query that nobody answered."""
        return no_service(settings=self._settings)
