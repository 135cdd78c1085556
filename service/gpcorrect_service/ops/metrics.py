"""What a server counts, and how monitors read it: OpenMetrics text, over zenoh and over HTTP on this machine only."""

from __future__ import annotations

import socket
import threading
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import accumulate
from socketserver import ThreadingMixIn
from typing import Any, get_args
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import CollectorRegistry, make_wsgi_app
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.openmetrics.exposition import CONTENT_TYPE_LATEST, generate_latest

from gpcorrect_service.protocol.errors import EndpointError
from gpcorrect_service.protocol.messages import HealthAnswer, State

OPENMETRICS = str(CONTENT_TYPE_LATEST)
# s from a query's arrival to its answer: a correction takes about 0.1 ms, a long path some 10 ms.
LATENCY_BOUNDS = (5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0)
HOST, PATH = "127.0.0.1", "/metrics"
NAMES = (HOST, "localhost")
"""Under which it may be asked; others are turned away, so that no page in a browser can read it under its own name."""
SILENT_SECONDS = 5.0
"""After which a connection that says nothing is closed: half of the shortest usual scrape interval; chosen by hand."""
MOST_CONNECTIONS = 32
"""At once; one more closes the oldest. A scrape takes milliseconds, and open files are the correction service's too:
chosen by hand."""


class _Key:
    """What is counted of one key."""

    def __init__(self) -> None:
        self.statuses: Counter[str] = Counter()
        self.latencies = [0] * (len(LATENCY_BOUNDS) + 1)
        self.seconds = 0.0
        self.poses = self.outside = 0


class Counters:
    """Counts answers by key and status, how long they took, and how many poses were out of domain; from any thread.

    Own counters and not the library's: one lock a query instead of one a number; they are handed over when asked for.
    """

    def __init__(self) -> None:
        self._keys: dict[str, _Key] = {}
        self._lock = threading.Lock()

    def add(self, kind: str, status: str, seconds: float | None, rows: int = 0, outside: int = 0) -> None:
        """Count one answer, or what became of a query without one.

        Parameters
        ----------
        kind, status : str
        seconds : float or None, how long it took; None for a query that was never answered
        rows, outside : int, poses that were answered, and how many of them were out of domain; none in a refusal
        """
        with self._lock:
            key = self._keys.get(kind)
            if key is None:
                key = self._keys[kind] = _Key()
            key.statuses[status] += 1
            if seconds is not None:
                key.latencies[bisect_left(LATENCY_BOUNDS, seconds)] += 1
                key.seconds += seconds
            key.poses += rows
            key.outside += outside

    def counts(self) -> dict[str, dict[str, int]]:
        """Return the counts so far, as `{"correct": {"OK": 12, "BUSY": 3}}`."""
        with self._lock:
            return {kind: dict(key.statuses) for kind, key in self._keys.items()}

    def families(self) -> Iterator[Any]:
        """Yield the counts as metric families."""
        answers = CounterMetricFamily("gpcorrect_answers", "Answers by key and status.", labels=["key", "status"])
        latency = HistogramMetricFamily(
            "gpcorrect_latency_seconds", "From a query's arrival to its answer.", labels=["key"], unit="seconds"
        )
        poses = CounterMetricFamily("gpcorrect_poses", "Poses and samples answered.", labels=["key"])
        outside = CounterMetricFamily("gpcorrect_out_of_domain", "Poses outside the training.", labels=["key"])
        bounds = [*(f"{bound:g}" for bound in LATENCY_BOUNDS), "+Inf"]
        with self._lock:
            for kind, key in self._keys.items():
                for status, count in key.statuses.items():
                    answers.add_metric([kind, status], count)
                buckets = list(zip(bounds, accumulate(key.latencies), strict=True))
                latency.add_metric([kind], buckets, sum_value=key.seconds)
                poses.add_metric([kind], key.poses)
                outside.add_metric([kind], key.outside)
        yield from (answers, latency, poses, outside)


class Metrics(CollectorRegistry):
    """A server's metrics, collected anew whenever they are asked for: what its health answer says, and its counters.

    Parameters
    ----------
    report : callable, gives the health answer of the moment
    counters : Counters
    """

    def __init__(self, report: Callable[[], HealthAnswer], counters: Counters) -> None:
        super().__init__()
        self._report, self._counters = report, counters

    def collect(self) -> Iterator[Any]:
        """Yield all metric families."""
        report = self._report()
        state = GaugeMetricFamily("gpcorrect_state", "1 for the state the server is in.", labels=["state"])
        for name in get_args(State):
            state.add_metric([name], float(report.state == name))
        queued = GaugeMetricFamily("gpcorrect_queued", "Requests that wait.", labels=["key"])
        for name, count in report.queued.items():
            queued.add_metric([name], count)
        labels = ["arm", "replica", "model_id", "model_hash", "joint_model_id", "joint_model_hash"]
        info = GaugeMetricFamily("gpcorrect_model", "1; its labels name what is served.", labels=labels)
        info.add_metric([getattr(report, label) for label in labels], 1.0)
        yield from (state, queued, info)
        yield GaugeMetricFamily("gpcorrect_uptime_seconds", "Since the start.", value=report.uptime, unit="seconds")
        yield from self._counters.families()

    @property
    def text(self) -> bytes:
        """The OpenMetrics text of this moment."""
        text: bytes = generate_latest(self)  # type: ignore[no-untyped-call]
        return text


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
    port : int, to listen on; EndpointError where it is taken, or may not be used
    registry : CollectorRegistry, collected at each scrape
    """
    try:
        server = make_server(HOST, port, _guarded(make_wsgi_app(registry)), _Server, _Handler)
    except OSError as error:
        cause = f"metrics cannot be served here ({error.strerror})."
        hint = "Give another --metrics-port: every server process needs its own."
        raise EndpointError(f"http://{HOST}:{port}{PATH}", cause, hint=hint) from error
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
