"""The service's log: one JSON object a line on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol, TextIO, cast

import structlog
from structlog.tracebacks import ExceptionDictTransformer


class Logger(Protocol):
    """What the service writes to: an event, and the facts that belong to it."""

    info: Callable[..., Any]
    warning: Callable[..., Any]
    error: Callable[..., Any]


class _Unfailing:
    """A stream that may be full, or gone: what cannot be written is lost, and whoever logs goes on."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> None:
        with suppress(OSError):
            self._stream.write(text)

    def flush(self) -> None:
        with suppress(OSError):
            self._stream.flush()


def open_logger(stream: TextIO | None = None, **facts: Any) -> Logger:
    """Return a logger whose every line carries some facts.

    A line that cannot be written (a full disk) is lost: no query and no worker ends for its log.
    structlog is not configured globally: a planner that serves from its own process keeps its own logging.

    Parameters
    ----------
    stream : TextIO, optional, standard error by default
    **facts
        Ready for JSON.
    """
    logger = structlog.wrap_logger(
        structlog.WriteLogger(cast(TextIO, _Unfailing(stream or sys.stderr))),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.ExceptionRenderer(ExceptionDictTransformer(show_locals=False)),
            structlog.processors.JSONRenderer(default=str),
        ],
    )
    return cast(Logger, logger.bind(**facts))
