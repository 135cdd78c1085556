"""Where answers meet zenoh: a query waits as a job, is answered, refused or dropped, and always let go."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import zenoh

from gpcorrect_service.ops.logger import Logger
from gpcorrect_service.ops.metrics import Counters
from gpcorrect_service.protocol.codec import JSON
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import Kind
from gpcorrect_service.protocol.settings import ServerSettings
from gpcorrect_service.server.requests import Handler, Request, Response, refusal

__all__ = ["Dispatcher", "Job"]


class Job(msgspec.Struct, frozen=True, eq=False):
    """A query on its way through a queue: on which key, what answers it, when it arrived (s, monotonic)."""

    query: zenoh.Query
    kind: Kind
    handler: Handler
    arrived: float


class Dispatcher:
    """Answers jobs; used by worker threads only, for replying may wait for the network.

    Parameters
    ----------
    settings : ServerSettings
        Arm, replica name, and the queue's bound that a refusal quotes.
    counters : Counters
        Where answers are counted.
    logger : Logger
        Where replies that cannot be sent are written.
    monotonic : callable
        Clock, s.
    """

    def __init__(
        self, settings: ServerSettings, counters: Counters, logger: Logger, monotonic: Callable[[], float]
    ) -> None:
        self._settings = settings
        self._counters = counters
        self._logger = logger
        self._monotonic = monotonic

    def answer(self, job: Job) -> None:
        """Send what the job's handler returns.

        Parameters
        ----------
        job : Job
        """
        with job.query as query:
            self._send(query, job, job.handler(_request(query, job.arrived)))

    def refuse(self, job: Job) -> None:
        """Send BUSY.

        Parameters
        ----------
        job : Job
        """
        busy = ServiceError(
            "BUSY",
            f"{self._settings.queue_capacity} requests are waiting already, or the server is stopping.",
            hint="Ask again later, or add a replica.",
        )
        with job.query as query:
            self._send(query, job, refusal(_request(query, job.arrived), busy, self._settings.replica))

    def drop(self, job: Job) -> None:
        """Let the query go without an answer, so that its client does not wait for one.

        Parameters
        ----------
        job : Job
        """
        self._counters.add(job.kind, "DROPPED")
        with job.query:
            pass

    def _send(self, query: zenoh.Query, job: Job, response: Response) -> None:
        seconds = self._monotonic() - job.arrived
        self._counters.add(job.kind, response.status, seconds, response.rows, response.outside)
        try:
            if response.is_error:
                query.reply_err(response.payload, encoding=response.encoding)
            else:
                # A queryable answers on its own concrete key.
                key = f"{self._settings.arm}/{job.kind}"
                query.reply(key, response.payload, encoding=response.encoding, attachment=response.attachment)
        except zenoh.ZError as error:
            self._logger.warning("reply not sent", kind=job.kind, status=response.status, cause=str(error))


def _request(query: zenoh.Query, arrived: float) -> Request:
    """Copy a query's bytes; a query without an encoding asks in JSON, as people do."""
    payload, attachment = query.payload, query.attachment
    return Request(
        payload=payload.to_bytes() if payload is not None else b"",
        encoding=str(query.encoding) if query.encoding is not None else JSON.media_type,
        attachment=attachment.to_bytes() if attachment is not None else b"",
        arrived=arrived,
    )
