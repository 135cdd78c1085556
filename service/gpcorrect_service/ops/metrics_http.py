"""Metrics over HTTP for Prometheus: one page, on this machine only."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import CollectorRegistry, make_wsgi_app

from gpcorrect_service.protocol.errors import EndpointError

HOST, PATH = "127.0.0.1", "/metrics"
NAMES = (HOST, "localhost")
"""Under which it may be asked; others are turned away, so that no page in a browser can read it under its own name."""
SILENT_SECONDS = 5.0
"""After which a connection that says nothing is closed: half of the shortest usual scrape interval; chosen by hand."""
MOST_CONNECTIONS = 32
"""At once; one more closes the oldest. A scrape takes milliseconds, and open files are the correction service's too:
chosen by hand."""


class _Server(ThreadingMixIn, WSGIServer):
    daemon_threads = True
    request_queue_size = 128  # connections that wait to be accepted; the base's 5 keep scrapers out for seconds

    def __init__(self, *given: Any) -> None:
        self._open: dict[socket.socket, None] = {}  # oldest first
        self._lock = threading.Lock()
        super().__init__(*given)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            self._open[request] = None
            oldest = next(iter(self._open)) if len(self._open) > MOST_CONNECTIONS else None
            if oldest is not None:
                del self._open[oldest]
                with suppress(OSError):  # it has just ended by itself
                    oldest.shutdown(socket.SHUT_RDWR)  # its thread reads the end, and closes it
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)


class _Handler(WSGIRequestHandler):
    timeout = SILENT_SECONDS

    def handle(self) -> None:
        with suppress(OSError):  # it said nothing in time, or went away: nobody is there to be answered
            super().handle()

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002  # the base's name
        """Say nothing: a scrape every few seconds is no event."""


@contextmanager
def metrics_over_http(port: int, registry: CollectorRegistry) -> Iterator[None]:
    """Answer `GET /metrics` on 127.0.0.1, in Prometheus' or OpenMetrics text as asked, until the block ends.

    Parameters
    ----------
    port : int
        To listen on.
    registry : CollectorRegistry
        Collected at each scrape.

    Raises
    ------
    EndpointError
        The port is taken, or may not be used.
    """
    try:
        server = make_server(HOST, port, _guarded(make_wsgi_app(registry)), _Server, _Handler)
    except OSError as error:
        raise EndpointError(
            f"http://{HOST}:{port}{PATH}",
            f"metrics cannot be served here ({error.strerror}).",
            hint="Give another --metrics-port: every server process needs its own.",
        ) from error
    thread = threading.Thread(target=server.serve_forever, name="metrics-http", daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def _guarded(metrics: Callable[..., Any]) -> Callable[..., Any]:
    """Return the application that turns away other names and other paths."""

    def _answer(environ: dict[str, Any], start: Callable[..., Any]) -> Any:
        name = environ.get("HTTP_HOST", HOST).rpartition(":")[0] or environ.get("HTTP_HOST", HOST)
        if name not in NAMES:
            start("403 Forbidden", [("Content-Type", "text/plain")])
            return [b"asked under a name that is not this machine's\n"]
        if environ["PATH_INFO"] != PATH:
            start("404 Not Found", [("Content-Type", "text/plain")])
            return [b"metrics are at /metrics\n"]
        return metrics(environ, start)

    return _answer
