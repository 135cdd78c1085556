"""How long a served correction takes, beside a bare zenoh echo of the same bytes in the same run.

Three processes: this planner, the service with a real model, and an echo: a queryable that sends a query's
payload back and does nothing else. Questions alternate between them, so that both see the same machine. Also:
the model alone without a network, and how fast `health` answers while other planners flood the service.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from support import print_table, save_results

from gpcorrect import artifact
from gpcorrect_service import (
    AsyncCorrectionClient,
    ClientSettings,
    CorrectionClient,
    ServerSettings,
    ServiceError,
    wire,
)
from gpcorrect_service.server import serve
from gpcorrect_service.transport import open_client, open_server

ROUNDS = 5000
WARM_UP = 500
FLOOD_SECONDS = 3.0
HEALTH_BOUND = 0.050  # s
SLOW = 0.001  # s
PATIENT = 60.0  # s
ECHO = "echo"
HEAD = ("", "median ms", "p99 ms", "min ms", "over 1 ms %")

spawn = multiprocessing.get_context("spawn")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="model file; without it a small one is fitted to simulated data")
    options.add_argument("--rounds", type=int, default=ROUNDS)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        model = given.model or fitted_model(Path(folder) / "model.gpc")
        service, echo = free_endpoint(), free_endpoint()
        with process(serve_model, str(model), service), process(serve_echo, echo):
            results = latencies(model, service, echo, given.rounds)
            results["health while flooded"] = health_under_flood(service)
    report(results)


def fitted_model(path: Path) -> Path:
    """Fit a model to simulated reaches, as `gpcorrect fit` does."""
    from gpcorrect.corrector import fit_corrector
    from gpcorrect.sim import debridement_log

    print("fitting a model to 40 simulated reaches ...")
    artifact.save(fit_corrector(debridement_log(reaches=40)), path)
    return path


def end_with_parent() -> None:
    """End this child process when its parent is gone, even when the parent was killed."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def serve_model(ready: Event, model: str, endpoint: str) -> None:
    end_with_parent()
    serve(model, ServerSettings(endpoint=endpoint), on_ready=lambda _: ready.set())


def serve_echo(ready: Event, endpoint: str) -> None:
    end_with_parent()

    def echo(query: zenoh.Query) -> None:
        with query:
            query.reply(ECHO, query.payload, attachment=query.attachment)

    with (
        open_server(ServerSettings(endpoint=endpoint)) as session,
        session.declare_queryable(ECHO, echo, complete=True),
    ):
        ready.set()
        time.sleep(1e6)


@contextmanager
def process(target: Callable[..., None], *arguments: str) -> Iterator[None]:
    """Run `target` in another process until the block ends."""
    ready = spawn.Event()
    child = spawn.Process(target=target, args=(ready, *arguments), daemon=True)
    child.start()
    try:
        if not ready.wait(PATIENT):
            raise TimeoutError(f"{target.__name__} did not start")
        yield
    finally:
        child.kill()
        child.join()


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def latencies(model: Path, service: str, echo: str, rounds: int) -> dict[str, Any]:
    """Seconds of each way to ask, alternating."""
    pose, twist = typical_query(model)
    corrector = artifact.load(model)
    options = {"timeout": PATIENT, "connect_timeout": PATIENT}
    with (
        CorrectionClient(service, encoding="json", **options) as json_client,
        CorrectionClient(service, encoding="msgpack", **options) as msgpack_client,
        open_client(ClientSettings((echo,))) as session,
    ):
        ways = {
            "echo, JSON size": echo_asker(session, wire.JSON, pose, twist),
            "service, JSON": lambda: json_client.correct(pose, twist),
            "echo, MessagePack size": echo_asker(session, wire.MSGPACK, pose, twist),
            "service, MessagePack": lambda: msgpack_client.correct(pose, twist),
            "model alone, no network": lambda: corrector.correct(pose, twist),
        }
        return alternate(ways, rounds)


def typical_query(model: Path) -> tuple[list[float], list[float]]:
    """Return a pose and a twist from the model's own training data."""
    _, arrays = artifact.read_parts(model)
    query = arrays["check_queries"][0]
    return query[:7].tolist(), query[7:].tolist()


def echo_asker(
    session: zenoh.Session, codec: wire.Codec, pose: list[float], twist: list[float]
) -> Callable[[], object]:
    """Ask the echo with the bytes that the service's client would send."""
    payload = codec.encode(wire.CorrectRequest(tuple(pose), tuple(twist)))
    attachment = codec.encode(wire.RequestMeta(request_id="01234567-1000", client_time=time.time(), deadline=1.0))
    querier = session.declare_querier(ECHO, timeout=PATIENT, consolidation=zenoh.ConsolidationMode.NONE)
    while not querier.matching_status.matching:
        time.sleep(0.01)
    return lambda: querier.get(zenoh.handlers.FifoChannel(64), payload=payload, attachment=attachment).recv()


def alternate(ways: dict[str, Callable[[], object]], rounds: int) -> dict[str, Any]:
    """Ask every way once a round, each round starting with another one."""
    order = list(ways)
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for round_ in range(WARM_UP + rounds):
        start = round_ % len(order)
        for name in order[start:] + order[:start]:
            began = time.perf_counter()
            ways[name]()
            seconds[name].append(time.perf_counter() - began)
    return {name: summary(values[WARM_UP:]) for name, values in seconds.items()}


def summary(seconds: list[float]) -> dict[str, float]:
    values = np.array(seconds)
    return {
        "median_ms": 1e3 * float(np.median(values)),
        "p99_ms": 1e3 * float(np.percentile(values, 99)),
        "min_ms": 1e3 * float(values.min()),
        "max_ms": 1e3 * float(values.max()),
        "share_over_1_ms": float((values > SLOW).mean()),
        "count": len(values),
    }


def health_under_flood(endpoint: str) -> dict[str, Any]:
    """Ask `health` while another process keeps four times the queue's capacity under way."""
    seconds = []
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


def ratios_of(results: dict[str, Any]) -> dict[str, float]:
    """Ratios of medians: what a planner sees, and what the service itself adds around the model."""
    median = {name: leaf["median_ms"] for name, leaf in results.items()}
    ratios = {}
    for name in ("JSON", "MessagePack"):
        service, echo = median[f"service, {name}"], median[f"echo, {name} size"]
        ratios[f"service / echo, {name}"] = service / echo
        ratios[f"(service - model) / echo, {name}"] = (service - median["model alone, no network"]) / echo
    return ratios


def report(results: dict[str, Any]) -> None:
    """Print the table and the ratios, and write both as JSON."""
    leaves = ("median_ms", "p99_ms", "min_ms")
    print_table(HEAD, [[name, *(r[x] for x in leaves), 100 * r["share_over_1_ms"]] for name, r in results.items()])
    ratios = ratios_of(results)
    print()
    for name, ratio in ratios.items():
        print(f"{name}: {ratio:.2f} (medians)")
    health = results["health while flooded"]
    print(f"health while flooded: slowest {health['max_ms']:.1f} ms of {health['count']} answers")
    print(f"corrections so far: {health['corrections']}")
    save_results("service_latency", {"latency": results, "ratios": ratios})


if __name__ == "__main__":
    main()
