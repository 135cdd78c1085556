"""A steady rate of queries, beside a bare zenoh echo at the same rate: what is lost, and what is late.

One planner at 1,000 queries a second, then four at 250 each; the echo before and after, so that a machine that is busy
elsewhere shows in both. A query that is due while the one before is under way starts late, and its lateness counts.
"""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from service_bench import (
    ECHO,
    PATIENT,
    SLOW,
    Ask,
    a_model,
    ask_of,
    bare_asker,
    client_of,
    end_with_parent,
    payloads,
    service_and_echo,
    together,
    typical_query,
)
from support import print_load, print_table, save_results

from gpcorrect.errors import GpCorrectError
from gpcorrect_service import ClientSettings
from gpcorrect_service.protocol.sessions import open_client

RATE = 1000.0  # queries a second in all
HEAD = ("", "queries a second", "lost", "median ms", "p99 ms", "over 1 ms %")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="model file; without it a small one is fitted to simulated data")
    options.add_argument("--seconds", type=float, default=60.0)
    given = options.parse_args()
    results: dict[str, Any] = {}
    with a_model(given.model) as model, service_and_echo(model, routed=False) as (service, echo):
        for planners in (1, 4):
            for name, settings in (("echo", echo), ("service", service)):
                label = f"{name}, {planners} planner{'s' if planners > 1 else ''}"
                results[label] = sustained(settings, name, str(model), planners, given.seconds)
    print_load()
    print_table(HEAD, [[name, *row.values()] for name, row in results.items()])
    save_results("service_sustained", results)


def sustained(settings: ClientSettings, what: str, model: str, planners: int, seconds: float) -> dict[str, float]:
    patience = seconds + 2 * PATIENT
    parts = together(plan, planners, settings, what, model, RATE / planners, seconds, patience=patience)
    late = np.concatenate([part["late"] for part in parts])
    return {
        "rate": len(late) / max(part["took"] for part in parts),
        "lost": float(sum(part["lost"] for part in parts)),
        "median_ms": 1e3 * float(np.median(late)),
        "p99_ms": 1e3 * float(np.percentile(late, 99)),
        "share_over_1_ms": 100.0 * float((late > SLOW).mean()),
    }


def plan(told: Any, start: Any, settings: ClientSettings, what: str, model: str, rate: float, seconds: float) -> None:
    """Ask at a steady rate; tell for each query how long after it was due its answer came."""
    end_with_parent()
    pose, twist = typical_query(Path(model))
    with ExitStack() as stack:
        if what == "echo":
            session = stack.enter_context(open_client(settings))
            ask: Ask = bare_asker(session, ECHO, payloads(pose, twist)["msgpack"])
        else:
            ask = ask_of(stack.enter_context(client_of(settings, "msgpack")), pose, twist)
        for _ in range(200):
            ask()
        start.wait(PATIENT)
        told.put(ask_steadily(ask, rate, round(rate * seconds)))


def ask_steadily(ask: Ask, rate: float, count: int) -> dict[str, Any]:
    late, lost, began = [], 0, time.perf_counter()
    for i in range(count):
        due = began + i / rate
        while (now := time.perf_counter()) < due:
            time.sleep(due - now)
        try:
            ask()
            late.append(time.perf_counter() - due)
        except GpCorrectError:
            lost += 1
    return {"late": np.array(late), "lost": lost, "took": time.perf_counter() - began}


if __name__ == "__main__":
    main()
