"""How long a served correction takes, beside a bare zenoh echo of the same bytes in the same run.

Processes: planners, the service with a real model, and an echo, a queryable that sends a query back and does nothing
else. Questions alternate between the two, so that both see the same machine: JSON, MessagePack, CDR; one planner and
eight, directly and through a router. Also: the model alone without a network, and how fast `health` answers while
other planners flood the service.
"""

from __future__ import annotations

import argparse
import asyncio
import time
from contextlib import suppress
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
from service_bench import (
    LATENCIES,
    PATIENT,
    Ask,
    a_model,
    alternate,
    askers,
    end_with_parent,
    latencies,
    process,
    service_and_echo,
    summary,
    together,
    typical_query,
)
from support import print_load, print_table, save_results

from gpcorrect.calibration import load
from gpcorrect_service import (
    AsyncCorrectionClient,
    ClientSettings,
    CorrectionClient,
    ServerSettings,
    ServiceError,
)

ROUNDS = 3000
WARM_UP = 300
MANY = 8
FLOOD_SECONDS = 3.0
HEALTH_BOUND = 0.050  # s
ENCODINGS = ("msgpack", "json", "cdr")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="model file; without it a small one is fitted to simulated data")
    options.add_argument("--rounds", type=int, default=ROUNDS)
    options.add_argument("--direct-only", action="store_true", help="one planner without a router")
    given = options.parse_args()
    results: dict[str, Any] = {}
    with a_model(given.model) as model:
        for routed in (False,) if given.direct_only else (False, True):
            with service_and_echo(model, routed=routed) as (service, echo):
                way = "through a router" if routed else "direct"
                results[f"1 planner, {way}"] = one_planner(service, echo, model, given.rounds, alone=not routed)
                if not given.direct_only:
                    rounds = max(1, given.rounds // MANY)
                    results[f"{MANY} planners, {way}"] = many_planners(service, echo, model, rounds)
                if not routed:
                    results["health"] = {"health while flooded": health_under_flood(service)}
    report(results)


def one_planner(
    service: ClientSettings, echo: ClientSettings, model: Path, rounds: int, *, alone: bool
) -> dict[str, Any]:
    pose, twist = typical_query(model)
    corrector = load(model)
    with askers(service, echo, model) as ways:
        told = in_pairs(ways, rounds, WARM_UP)
    if alone:
        told |= alternate({"model alone, no network": lambda: corrector.correct(pose, twist)}, rounds, WARM_UP)
    return {name: summary(seconds) for name, seconds in told.items()}


def in_pairs(ways: dict[str, Ask], rounds: int, warm_up: int) -> dict[str, list[float]]:
    """Seconds of every way: echo and service alternate, one encoding after the other."""
    told: dict[str, list[float]] = {}
    for name in ENCODINGS:
        pair = {label: ways[label] for label in (f"echo, {name} size", f"service, {name}")}
        told |= alternate(pair, rounds, warm_up)
    return told


def many_planners(service: ClientSettings, echo: ClientSettings, model: Path, rounds: int) -> dict[str, Any]:
    """Seconds of all planners together, each a process of its own that asks as fast as it is answered."""
    answers = together(plan, MANY, service, echo, str(model), rounds, patience=10 * PATIENT)
    return {name: summary([s for answer in answers for s in answer[name]]) for name in answers[0]}


def plan(told: Any, start: Any, service: ClientSettings, echo: ClientSettings, model: str, rounds: int) -> None:
    end_with_parent()
    with askers(service, echo, Path(model)) as ways:
        start.wait(PATIENT)
        told.put(in_pairs(ways, rounds, WARM_UP // MANY))


def health_under_flood(settings: ClientSettings) -> dict[str, Any]:
    """Ask `health` while another process keeps four times the queue's capacity under way."""
    seconds = []
    endpoint = settings.endpoints[0]
    with (
        process(flood, endpoint),
        CorrectionClient(endpoint, timeout=PATIENT, connect_timeout=PATIENT) as client,
    ):
        until = time.monotonic() + FLOOD_SECONDS
        while time.monotonic() < until:
            began = time.perf_counter()
            client.health()
            seconds.append(time.perf_counter() - began)
            time.sleep(0.005)
        counts = client.health().counts["correct"]
    share = float((np.array(seconds) > HEALTH_BOUND).mean())
    return {**summary(seconds), "share_over_50_ms": share, "corrections": counts}


def flood(ready: Event, endpoint: str) -> None:
    end_with_parent()
    asyncio.run(keep_asking(ready, endpoint))


async def keep_asking(ready: Event, endpoint: str) -> None:
    async with AsyncCorrectionClient(endpoint, timeout=PATIENT, connect_timeout=PATIENT) as client:

        async def planner() -> None:
            while True:
                with suppress(ServiceError):  # BUSY is what a flood is for
                    await client.correct([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

        await client.health()
        ready.set()
        await asyncio.gather(*(planner() for _ in range(4 * ServerSettings.queue_capacity)))


def ratios_of(results: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Service over echo: medians and 99th percentiles."""
    ratios = {}
    for where, rows in results.items():
        for name in ENCODINGS:
            if f"service, {name}" in rows:
                service, echo = rows[f"service, {name}"], rows[f"echo, {name} size"]
                ratios[f"{where}, {name}"] = {
                    leaf: service[f"{leaf}_ms"] / echo[f"{leaf}_ms"] for leaf in ("median", "p99")
                }
    return ratios


def report(results: dict[str, Any]) -> None:
    """Print the tables and the ratios, and write both as JSON."""
    print_load()
    for where, rows in results.items():
        print_table((where, *LATENCIES), [[name, *latencies(row)] for name, row in rows.items()])
        print()
    ratios = ratios_of(results)
    print_table(("service / echo", "median", "p99"), [[where, r["median"], r["p99"]] for where, r in ratios.items()])
    health = results["health"]["health while flooded"]
    print(f"\nhealth while flooded: slowest {health['max_ms']:.1f} ms of {health['count']} answers")
    print(f"corrections meanwhile: {health['corrections']}")
    save_results("service_latency", {"latency": results, "ratios": ratios})


if __name__ == "__main__":
    main()
