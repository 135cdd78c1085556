"""What planners see when a replica is killed, when one hangs, and when models change a hundred times under load.

Planners ask at 200 queries a second in all. A query counts as affected when it took more than `LATE` or failed.
"""

from __future__ import annotations

import argparse
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from service_bench import PATIENT, a_model, free_endpoint, process, serve_model, serve_store, typical_query
from support import print_load, print_table, save_results

from gpcorrect.calibration import FitSettings, ModelStore, fit_corrector, load, save
from gpcorrect.sim import debridement_log
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings, ServiceError
from gpcorrect_service.client.operator import Operator

RATE = 200.0
LATE = 0.05  # s: far above what a busy machine adds
HEAD = ("", "queries", "failed", "late", "slowest s", "affected for s")


@dataclass
class Heard:
    """Every query: when it was asked, how long it took, and how it ended."""

    when: list[float] = field(default_factory=list)
    took: list[float] = field(default_factory=list)
    failed: list[bool] = field(default_factory=list)

    def row(self, since: float) -> dict[str, float]:
        """Return the counts, and for how long after `since` queries were touched."""
        when, took = np.array(self.when), np.array(self.took)
        touched = (took > LATE) | np.array(self.failed)
        after = touched & (when + took >= since)
        span = float((when + took)[after].max() - since) if after.any() else 0.0
        return {
            "queries": float(len(took)),
            "failed": float(sum(self.failed)),
            "late": float(touched.sum()),
            "slowest_s": float(took.max()),
            "affected_s": span,
        }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="model file; without it a small one is fitted to simulated data")
    options.add_argument("--seconds", type=float, default=10.0)
    options.add_argument("--activations", type=int, default=100)
    given = options.parse_args()
    with a_model(given.model) as model:
        results: dict[str, Any] = {
            "replica killed": lost_replica(model, signal.SIGKILL, given.seconds),
            "replica hung": lost_replica(model, signal.SIGSTOP, given.seconds),
        }
        results[f"{given.activations} activations"], mixed = activations(model, given.activations)
    print_load()
    print_table(HEAD, [[name, *row.values()] for name, row in results.items()])
    print(f"\npaths answered by a mixture of two models: {mixed}")
    save_results("service_faults", {**results, "mixed": mixed})


def lost_replica(model: Path, blow: signal.Signals, seconds: float) -> dict[str, float]:
    """Lose the replica that answers, half-way through."""
    pose, twist = typical_query(model)
    ends = free_endpoint(), free_endpoint()
    settings = [ServerSettings(endpoint=end) for end in ends]
    heard = Heard()
    blows: list[float] = []
    with (
        process(serve_model, str(model), settings[0]),
        process(serve_model, str(model), settings[1]),
        CorrectionClient(ends, connect_timeout=PATIENT, timeout=1.0) as client,
    ):
        for _ in range(50):
            client.correct(pose, twist)
        victim = int(client.correct(pose, twist).meta.replica.rsplit("-", 1)[1])

        def strike() -> None:
            blows.append(time.perf_counter())
            os.kill(victim, blow)

        timer = threading.Timer(seconds / 2, strike)
        timer.start()
        ask_steadily(lambda: client.correct(pose, twist), seconds, heard)
        timer.join()
    return heard.row(blows[0])


def ask_steadily(ask: Callable[[], object], seconds: float, heard: Heard) -> None:
    began = time.perf_counter()
    for i in range(round(RATE * seconds)):
        while (now := time.perf_counter()) < began + i / RATE:
            time.sleep(began + i / RATE - now)
        note(ask, heard)


def note(ask: Callable[[], object], heard: Heard) -> None:
    asked, failed = time.perf_counter(), False
    try:
        ask()
    except ServiceError:
        failed = True
    heard.when.append(asked)
    heard.took.append(time.perf_counter() - asked)
    heard.failed.append(failed)


def activations(model: Path, count: int) -> tuple[dict[str, float], int]:
    """Change between two models while a planner asks paths as fast as it is answered; mixed answers are counted."""
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "other.gpc"
        save(fit_corrector(debridement_log(reaches=5), FitSettings(clean=False, inducing=60)), other)
        store = ModelStore(Path(folder) / "store")
        entries = [store.add(path, now=float(i), name=f"model{i}") for i, path in enumerate((model, other))]
        store.activate(entries[0])
        poses, times = path_of(model)
        expected = {entry.hash: load(store.path(entry)).correct_path(poses, times).position for entry in entries}
        end, heard, mixed, stop = free_endpoint(), Heard(), [0], threading.Event()

        def plan() -> None:
            with CorrectionClient(end, connect_timeout=PATIENT, path_timeout=PATIENT, pin=False) as client:
                while not stop.is_set():
                    note(lambda: mixed.__setitem__(0, mixed[0] + is_mixed(client, poses, times, expected)), heard)

        with process(serve_store, str(store.folder), ServerSettings(endpoint=end)):
            planner = threading.Thread(target=plan)
            planner.start()
            with Operator(ClientSettings((end,), connect_timeout=PATIENT)) as operator:
                began = time.perf_counter()
                for i in range(count):
                    operator.activate(entries[(i + 1) % 2].hash)
            stop.set()
            planner.join()
    return heard.row(began), mixed[0]


def path_of(model: Path) -> tuple[Any, Any]:
    queries = load(model).check_queries
    start, end = queries[0][:3], queries[1][:3]
    share = np.linspace(0.0, 1.0, 100)[:, None]
    positions = (1 - share) * start + share * end
    return np.hstack([positions, np.tile([1.0, 0.0, 0.0, 0.0], (100, 1))]), np.linspace(0.0, 2.0, 100)


def is_mixed(client: CorrectionClient, poses: Any, times: Any, expected: dict[str, Any]) -> bool:
    reply = client.correct_path(poses, times)
    return not np.allclose(reply.position, expected[reply.meta.model_hash], rtol=0, atol=1e-12)


if __name__ == "__main__":
    main()
