"""What a server counts, and how monitors read it: OpenMetrics text."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import accumulate
from typing import Any, get_args

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.openmetrics.exposition import CONTENT_TYPE_LATEST, generate_latest

from gpcorrect_service.protocol.messages import HealthAnswer, State

OPENMETRICS = str(CONTENT_TYPE_LATEST)
# s from a query's arrival to its answer: a correction takes about 0.1 ms, a long path some 10 ms.
LATENCY_BOUNDS = (5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0)


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

    def add(self, kind: str, status: str, seconds: float = 0.0, rows: int = 1, outside: int = 0) -> None:
        """Count one answer.

        Parameters
        ----------
        kind, status : str
            Its key, and how it ended.
        seconds : float
            That it took.
        rows, outside : int
            Poses, and how many of them were out of domain.
        """
        with self._lock:
            key = self._keys.get(kind)
            if key is None:
                key = self._keys[kind] = _Key()
            key.statuses[status] += 1
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


class _Collector:
    """What the health answer says at each scrape, and the counters."""

    def __init__(self, report: Callable[[], HealthAnswer], counters: Counters) -> None:
        self._report = report
        self._counters = counters

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


def metrics_of(report: Callable[[], HealthAnswer], counters: Counters) -> CollectorRegistry:
    """Return a server's metrics, collected anew whenever they are asked for.

    Parameters
    ----------
    report : callable
        Gives the health answer of the moment.
    counters : Counters
    """
    registry = CollectorRegistry()
    registry.register(_Collector(report, counters))
    return registry


def exposition(registry: CollectorRegistry) -> bytes:
    """Return the OpenMetrics text of this moment.

    Parameters
    ----------
    registry : CollectorRegistry
        From :func:`metrics_of`.
    """
    text: bytes = generate_latest(registry)  # type: ignore[no-untyped-call]
    return text
