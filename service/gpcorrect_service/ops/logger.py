"""The service's log: one JSON object a line on standard error."""

from __future__ import annotations

import sys
from typing import Any, Protocol, TextIO, cast

import structlog
from structlog.tracebacks import ExceptionDictTransformer

__all__ = ["Logger", "open_logger"]


class Logger(Protocol):
    """What the service writes to: an event, and the facts that belong to it."""

    def info(self, event: str, **facts: Any) -> Any:
        """Write what happens in ordinary service."""

    def warning(self, event: str, **facts: Any) -> Any:
        """Write what someone should look at."""

    def error(self, event: str, **facts: Any) -> Any:
        """Write what went wrong."""


def open_logger(stream: TextIO | None = None, **facts: Any) -> Logger:
    """Return a logger on `stream` (standard error) whose every line carries `facts`.

    structlog is not configured globally: a planner that serves from its own process keeps its own logging.
    """
    logger = structlog.wrap_logger(
        structlog.WriteLogger(stream or sys.stderr),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.ExceptionRenderer(ExceptionDictTransformer(show_locals=False)),
            structlog.processors.JSONRenderer(default=str),
        ],
    )
    return cast(Logger, logger.bind(**facts))
