"""A service under mixed traffic for long: whether memory, threads or open files grow.

Planners ask poses, paths, nonsense and health; clients come and go; models change. The short form is ten minutes
(the default), `--minutes` says otherwise. Growth is what the last third of the run has over the second third: the
first third warms up allocators and caches.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from service_bench import PATIENT, a_model, free_endpoint, process, serve_store, typical_query
from support import print_table, save_results

from gpcorrect.calibration import ModelStore
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings, ServiceError
from gpcorrect_service.client.operator import Operator

PLANNERS = 3
SAMPLE_SECONDS = 1.0
RECONNECT_EVERY = 500  # queries of a planner
ACTIVATE_EVERY = 10.0  # s
HEAD = ("", "second third", "last third", "growth %")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="model file; without it a small one is fitted to simulated data")
    options.add_argument("--minutes", type=float, default=10.0)
    given = options.parse_args()
    counts: Counter[str] = Counter()
    with a_model(given.model) as model, tempfile.TemporaryDirectory() as folder:
        store = ModelStore(Path(folder) / "store")
        entry = store.add(model, now=0.0)
        store.activate(entry)
        end = free_endpoint()
        with process(serve_store, str(store.folder), ServerSettings(endpoint=end)) as server:
            samples = soak(server.pid, end, model, entry.hash, 60.0 * given.minutes, counts)
    rows = grown(samples)
    print(f"{sum(counts.values())} queries in {given.minutes:g} minutes: {dict(counts)}\n")
    print_table(HEAD, [[name, *row] for name, row in rows.items()])
    save_results("soak", {"minutes": given.minutes, "counts": dict(counts), "growth": rows})


def soak(pid: int, end: str, model: Path, digest: str, seconds: float, counts: Counter[str]) -> list[dict[str, float]]:
    stop = threading.Event()
    arguments = (end, model, stop, counts)
    threads = [threading.Thread(target=plan, args=(seed, *arguments)) for seed in range(PLANNERS)]
    threads.append(threading.Thread(target=operate, args=(end, digest, stop, counts)))
    for thread in threads:
        thread.start()
    samples, until = [], time.monotonic() + seconds
    while time.monotonic() < until:
        samples.append(state_of(pid))
        time.sleep(SAMPLE_SECONDS)
    stop.set()
    for thread in threads:
        thread.join()
    return samples


def plan(seed: int, end: str, model: Path, stop: threading.Event, counts: Counter[str]) -> None:
    """Ask mixed questions, with a new connection now and then."""
    rng = np.random.default_rng(seed)
    pose, twist = typical_query(model)
    path = np.tile(pose, (50, 1))
    while not stop.is_set():
        with CorrectionClient(end, connect_timeout=PATIENT, timeout=PATIENT, pin=False) as client:
            questions = (
                lambda: client.correct(pose, twist),
                lambda: client.correct(pose[:3]),
                lambda: client.correct([np.nan] * 7),
                lambda: client.correct_path(path, 0.01 * np.arange(50)),
                lambda: client.correct_path(path, np.zeros(50)),
                client.health,
                client.metrics,
            )
            for _ in range(RECONNECT_EVERY):
                if stop.is_set():
                    return
                try:
                    questions[rng.integers(len(questions))]()
                    counts["answered"] += 1
                except ServiceError as error:
                    counts[error.status] += 1


def operate(end: str, digest: str, stop: threading.Event, counts: Counter[str]) -> None:
    with Operator(ClientSettings((end,), connect_timeout=PATIENT)) as operator:
        while not stop.wait(ACTIVATE_EVERY):
            operator.activate(digest)
            counts["activated"] += 1


def state_of(pid: int) -> dict[str, float]:
    """Resident memory (MB), threads and open files of a process."""
    status = Path(f"/proc/{pid}/status").read_text()
    fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    return {
        "memory_mb": float(fields["VmRSS"].split()[0]) / 1024,
        "threads": float(fields["Threads"]),
        "open_files": float(len(os.listdir(f"/proc/{pid}/fd"))),
    }


def grown(samples: list[dict[str, float]]) -> dict[str, Any]:
    third = len(samples) // 3
    rows = {}
    for name in samples[0]:
        middle, last = (
            float(np.median([s[name] for s in part])) for part in (samples[third : 2 * third], samples[2 * third :])
        )
        rows[name] = (middle, last, 100.0 * (last / middle - 1))
    return rows


if __name__ == "__main__":
    main()
