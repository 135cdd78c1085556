"""How many corrections a second one and several replicas answer, by number of planners that ask at once.

Every planner is a process of its own that asks again as soon as it has an answer. "any": each planner knows all
replicas, and zenoh chooses for it; "own": planner k knows replica k mod R alone. A bare echo stands beside them: what
the machine itself can do with as many processes.

    python bench/service_replicas.py --replicas 1 2 --clients 1 2 4
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from service_bench import (
    ECHO,
    a_model,
    bare_asker,
    children,
    end_with_parent,
    free_endpoint,
    payloads,
    process,
    serve_echo,
    serve_model,
    typical_query,
)
from support import print_table, save_results

from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings
from gpcorrect_service.protocol.sessions import open_client

SECONDS = 2.0
WARM_UP = 20
PATIENT = 60.0
HEAD = ("replicas", "clients", "way", "answers/s", "median ms", "p99 ms")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--model", type=Path, help="model file; without it a small one is fitted to simulated data")
    options.add_argument("--replicas", type=int, nargs="+", default=[1, 2])
    options.add_argument("--clients", type=int, nargs="+", default=[1, 2, 4])
    given = options.parse_args()
    with a_model(given.model) as model, ExitStack() as running:
        endpoints, echo = [free_endpoint() for _ in range(max(given.replicas))], free_endpoint()
        running.enter_context(process(serve_echo, ServerSettings(endpoint=echo)))
        for endpoint in endpoints:
            running.enter_context(process(serve_model, str(model), ServerSettings(endpoint=endpoint)))
        planners = [running.enter_context(planner(model)) for _ in range(max(given.clients))]
        rows = [r for n in given.clients for r in of_planners(planners[:n], endpoints, echo, given.replicas)]
    print_table(HEAD, [list(row.values()) for row in rows])
    print(f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}")
    save_results("service_replicas", {"rows": rows, "cores": os.cpu_count(), "load": os.getloadavg()[0]})


def of_planners(
    planners: Sequence[Connection], endpoints: list[str], echo: str, replicas: Sequence[int]
) -> Iterator[dict[str, Any]]:
    """Measure these planners on the echo, and on each number of replicas."""
    yield measured(planners, 1, "echo", [[echo]] * len(planners))
    for number in replicas:
        known = endpoints[:number]
        yield measured(planners, number, "any", [known] * len(planners))
        if number > 1:
            yield measured(planners, number, "own", [[known[k % number]] for k in range(len(planners))])


def measured(planners: Sequence[Connection], replicas: int, way: str, whom: list[list[str]]) -> dict[str, Any]:
    """Let all planners ask for some seconds and pool how long their answers took."""
    for pipe, known in zip(planners, whom, strict=True):
        pipe.send((way, known))
    for pipe in planners:
        pipe.recv()  # connected and warm
    for pipe in planners:
        pipe.send("go")
    seconds = np.concatenate([pipe.recv() for pipe in planners])
    return {
        "replicas": replicas,
        "clients": len(planners),
        "way": way,
        "answers_per_s": len(seconds) / SECONDS,
        "median_ms": 1e3 * float(np.median(seconds)),
        "p99_ms": 1e3 * float(np.percentile(seconds, 99)),
    }


@contextmanager
def planner(model: Path) -> Iterator[Connection]:
    """Run a planner in a process of its own, told through a pipe whom to ask and when."""
    ours, theirs = children.Pipe()
    pose, twist = typical_query(model)
    with process(plan, theirs, pose, twist):
        yield ours


def plan(ready: Any, pipe: Connection, pose: list[float], twist: list[float]) -> None:
    end_with_parent()
    ready.set()
    while True:
        way, known = pipe.recv()
        if way == "echo":
            with open_client(ClientSettings(tuple(known))) as session:
                ask(bare_asker(session, ECHO, payloads(pose, twist)["msgpack"]), pipe)
        else:
            with CorrectionClient(known, encoding="msgpack", timeout=PATIENT, connect_timeout=PATIENT) as client:
                ask(partial(client.correct, pose, twist), pipe)


def ask(question: Callable[[], object], pipe: Connection) -> None:
    """Warm up, wait for the word, then ask without a pause."""
    for _ in range(WARM_UP):
        question()
    pipe.send("ready")
    pipe.recv()
    seconds = []
    until = time.perf_counter() + SECONDS
    while (began := time.perf_counter()) < until:
        question()
        seconds.append(time.perf_counter() - began)
    pipe.send(np.array(seconds))


if __name__ == "__main__":
    main()
