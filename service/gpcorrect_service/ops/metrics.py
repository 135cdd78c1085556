"""What a server counts, and how monitors read it: OpenMetrics text."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from itertools import accumulate
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.openmetrics.exposition import CONTENT_TYPE_LATEST, generate_latest

from gpcorrect_service.protocol.messages import HealthAnswer

__all__ = ["OPENMETRICS", "Counters", "exposition"]

OPENMETRICS = str(CONTENT_TYPE_LATEST)
# s from a query's arrival to its answer: a correction takes about 0.1 ms, a long path some 10 ms.
LATENCY_BOUNDS = (5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0)
STATES = ("DISABLED", "ENABLED", "PAUSED", "FAULT")


class _Latency:
    """A histogram: how many answers took how long."""

    def __init__(self) -> None:
        self.counts = [0] * (len(LATENCY_BOUNDS) + 1)
        self.total = 0.0

    def add(self, seconds: float) -> None:
        self.counts[bisect_left(LATENCY_BOUNDS, seconds)] += 1
        self.total += seconds


class Counters:
    """Counts answers by key and status, how long they took, and how many poses were out of domain; from any thread.

    Own counters and not the library's: one lock a query instead of one a number; they are handed over when asked for.
    """

    def __init__(self) -> None:
        self._counts: dict[str, Counter[str]] = {}
        self._latency: dict[str, _Latency] = {}
        self._poses: dict[str, int] = {}
        self._outside: dict[str, int] = {}
        self._lock = threading.Lock()

    def add(self, kind: str, status: str, seconds: float = 0.0, rows: int = 1, outside: int = 0) -> None:
        """Count one answer that took `seconds`, to a number of poses of which some were `outside` the domain."""
        with self._lock:
            if kind not in self._counts:
                self._counts[kind], self._latency[kind] = Counter(), _Latency()
                self._poses[kind] = self._outside[kind] = 0
            self._counts[kind][status] += 1
            self._latency[kind].add(seconds)
            self._poses[kind] += rows
            self._outside[kind] += outside

    def counts(self) -> dict[str, dict[str, int]]:
        """Return the counts so far, as `{"correct": {"OK": 12, "BUSY": 3}}`."""
        with self._lock:
            return {kind: dict(counts) for kind, counts in self._counts.items()}

    def families(self) -> Iterator[Any]:
        """Yield the counts as metric families."""
        with self._lock:
            answers = CounterMetricFamily("gpcorrect_answers", "Answers by key and status.", labels=["key", "status"])
            for kind, counts in self._counts.items():
                for status, count in counts.items():
                    answers.add_metric([kind, status], count)
            latency = HistogramMetricFamily(
                "gpcorrect_latency_seconds", "From a query's arrival to its answer.", labels=["key"], unit="seconds"
            )
            for kind, histogram in self._latency.items():
                bounds = [*(f"{bound:g}" for bound in LATENCY_BOUNDS), "+Inf"]
                buckets = list(zip(bounds, accumulate(histogram.counts), strict=True))
                latency.add_metric([kind], buckets, sum_value=histogram.total)
            poses = CounterMetricFamily("gpcorrect_poses", "Poses and samples answered.", labels=["key"])
            outside = CounterMetricFamily("gpcorrect_out_of_domain", "Poses outside the training.", labels=["key"])
            for kind, count in self._poses.items():
                poses.add_metric([kind], count)
                outside.add_metric([kind], self._outside[kind])
        yield from (answers, latency, poses, outside)


class _Collector:
    """One scrape: what the health answer says, and the counters."""

    def __init__(self, report: HealthAnswer, counters: Counters) -> None:
        self._report = report
        self._counters = counters

    def collect(self) -> Iterator[Any]:
        """Yield all metric families."""
        report = self._report
        state = GaugeMetricFamily("gpcorrect_state", "1 for the state the server is in.", labels=["state"])
        for name in STATES:
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


def exposition(report: HealthAnswer, counters: Counters) -> bytes:
    """Return the OpenMetrics text of this moment."""
    registry = CollectorRegistry()
    registry.register(_Collector(report, counters))
    text: bytes = generate_latest(registry)  # type: ignore[no-untyped-call]
    return text
