"""Where answers meet zenoh: a query waits as a parcel, is answered, refused or dropped, and always let go."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import zenoh

from gpcorrect_service.ops.logger import Journal
from gpcorrect_service.ops.metrics import Tally
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.settings import ServerSettings
from gpcorrect_service.server.answers import Answer, Request, busy_error, refusal

__all__ = ["Handler", "Parcel", "Post"]

Handler = Callable[[Request], Answer]


class Parcel(msgspec.Struct, frozen=True, eq=False):
    """A query on its way through a queue: on which key, who answers it, when it arrived (s, monotonic)."""

    query: zenoh.Query
    kind: wire.Kind
    handler: Handler
    arrived: float


class Post:
    """Answers parcels; used by worker threads only, for replying may wait for the network.

    Parameters
    ----------
    settings : ServerSettings
        Arm, replica name, and the queue's bound that a refusal quotes.
    tally : Tally
        Where answers are counted.
    journal : Journal
        Where replies that cannot be sent are written.
    monotonic : callable
        Clock, s.
    """

    def __init__(
        self, settings: ServerSettings, tally: Tally, journal: Journal, monotonic: Callable[[], float]
    ) -> None:
        self._settings = settings
        self._tally = tally
        self._journal = journal
        self._monotonic = monotonic
        self._keys: dict[wire.Kind, str] = {kind: f"{settings.arm}/{kind}" for kind in wire.KINDS}

    def key(self, kind: wire.Kind) -> str:
        """Return the key of `kind` inside the namespace."""
        return self._keys[kind]

    def answer(self, parcel: Parcel) -> None:
        """Send what the parcel's handler says."""
        with parcel.query as query:
            self._send(query, parcel, parcel.handler(_request(query, parcel.arrived)))

    def refuse(self, parcel: Parcel) -> None:
        """Send BUSY."""
        busy = busy_error(self._settings.queue_capacity)
        with parcel.query as query:
            request = _request(query, parcel.arrived)
            self._send(query, parcel, refusal(request, busy, self._settings.replica))

    def drop(self, parcel: Parcel) -> None:
        """Let the query go without an answer, so that its client does not wait for one."""
        self._tally.add(parcel.kind, "DROPPED")
        with parcel.query:
            pass

    def _send(self, query: zenoh.Query, parcel: Parcel, answer: Answer) -> None:
        kind = parcel.kind
        self._tally.add(kind, answer.status, self._monotonic() - parcel.arrived, answer.rows, answer.outside)
        try:
            if answer.is_error:
                query.reply_err(answer.payload, encoding=answer.encoding)
            else:
                query.reply(self._keys[kind], answer.payload, encoding=answer.encoding, attachment=answer.attachment)
        except zenoh.ZError as error:
            self._journal.warning("reply not sent", kind=kind, status=answer.status, cause=str(error))


def _request(query: zenoh.Query, arrived: float) -> Request:
    """Copy a query's bytes; a query without an encoding asks in JSON, as people do."""
    payload, attachment = query.payload, query.attachment
    return Request(
        payload=payload.to_bytes() if payload is not None else b"",
        encoding=str(query.encoding) if query.encoding is not None else wire.JSON.media_type,
        attachment=attachment.to_bytes() if attachment is not None else b"",
        arrived=arrived,
    )
