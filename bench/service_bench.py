"""What the benchmarks of the service share: processes that end with their parent, a model, an echo, and summaries."""

from __future__ import annotations

import json
import multiprocessing
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from gpcorrect.calibration import load, save
from gpcorrect.cli.processes import free_endpoint
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings
from gpcorrect_service.ops.router import route
from gpcorrect_service.protocol.messages import CODECS, JSON, CorrectRequest, RequestMeta
from gpcorrect_service.protocol.ros import CDR_ENCODING, StampedPose, write_pose
from gpcorrect_service.protocol.sessions import CLIENT, COMMON, open_client, open_server
from gpcorrect_service.server.service import serve

PATIENT = 60.0  # s
SLOW = 0.001  # s
ECHO = "echo"
LATENCIES = ("median ms", "p99 ms", "min ms", "over 1 ms %")  # the columns of :func:`latencies`

# Children come from a process that has read the libraries and opened nothing.
children = multiprocessing.get_context("forkserver")
children.set_forkserver_preload(["service_bench"])


def end_with_parent() -> None:
    """End this child process when its parent is gone, even when the parent was killed."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def serve_model(ready: Event, model: str, settings: ServerSettings) -> None:
    end_with_parent()
    serve(model, settings, on_ready=lambda _: ready.set())


def serve_store(ready: Event, folder: str, settings: ServerSettings) -> None:
    end_with_parent()
    serve(None, settings, on_ready=lambda _: ready.set(), store=folder)


def serve_joints(ready: Event, model: str, settings: ServerSettings) -> None:
    end_with_parent()
    serve(None, settings, on_ready=lambda _: ready.set(), joint_path=model)


def serve_echo(ready: Event, settings: ServerSettings) -> None:
    """Send a query's payload and attachment back, and nothing else: zenoh's own callback and thread."""
    end_with_parent()

    def echo(query: zenoh.Query) -> None:
        with query:
            query.reply(ECHO, query.payload, attachment=query.attachment)

    with open_server(settings) as session, session.declare_queryable(ECHO, echo, complete=True):
        ready.set()
        time.sleep(1e6)


def run_router(ready: Event, config: str) -> None:
    end_with_parent()
    route(Path(config), threading.Event(), ready.set)


@contextmanager
def process(target: Callable[..., None], *arguments: Any) -> Iterator[Any]:
    """Run `target(ready, *arguments)` in another process until the block ends."""
    ready = children.Event()
    child = children.Process(target=target, args=(ready, *arguments), daemon=True)
    child.start()
    try:
        if not ready.wait(PATIENT):
            raise TimeoutError(f"{target.__name__} did not start")
        yield child
    finally:
        child.kill()
        child.join()


@contextmanager
def a_model(given: Path | None) -> Iterator[Path]:
    """Give the model file, or one fitted to simulated reaches as `gpcorrect fit` does."""
    if given is not None:
        yield given
        return
    from gpcorrect.calibration import fit_corrector
    from gpcorrect.sim import debridement_log

    with tempfile.TemporaryDirectory() as folder:
        print("fitting a model to 40 simulated reaches ...")
        path = Path(folder) / "model.gpc"
        save(fit_corrector(debridement_log(reaches=40)), path)
        yield path


def typical_query(model: Path) -> tuple[list[float], list[float]]:
    """Return a pose and a twist from the model's own training data."""
    queries = load(model).check_queries
    query = queries[0]
    return query[:7].tolist(), query[7:].tolist()


@contextmanager
def service_and_echo(model: Path, *, routed: bool) -> Iterator[tuple[ClientSettings, ClientSettings]]:
    """Serve the model and an echo; how to reach each, directly or both through one router."""
    with ExitStack() as stack:
        if not routed:
            ends = free_endpoint(), free_endpoint()
            stack.enter_context(process(serve_model, str(model), ServerSettings(endpoint=ends[0])))
            stack.enter_context(process(serve_echo, ServerSettings(endpoint=ends[1])))
            patience = {"timeout": PATIENT, "connect_timeout": PATIENT}
            yield ClientSettings((ends[0],), **patience), ClientSettings((ends[1],), **patience)
            return
        router, client = router_site(Path(stack.enter_context(tempfile.TemporaryDirectory())))
        stack.enter_context(process(run_router, str(router)))
        stack.enter_context(process(serve_model, str(model), ServerSettings(config_file=client)))
        stack.enter_context(process(serve_echo, ServerSettings(config_file=client)))
        settings = ClientSettings(config_file=client, timeout=PATIENT, connect_timeout=PATIENT)
        yield settings, settings


def router_site(folder: Path) -> tuple[Path, Path]:
    """Write the configurations of a router, and of its clients and servers."""
    end = free_endpoint()
    router, client = folder / "router.json5", folder / "client.json5"
    router.write_text(json.dumps(nested({**COMMON, "mode": "router", "listen/endpoints": [end]})))
    peer = {**COMMON, **CLIENT, "mode": "client", "namespace": "gpcorrect", "connect/endpoints": [end]}
    client.write_text(json.dumps(nested(peer)))
    return router, client


def nested(flat: dict[str, Any]) -> dict[str, Any]:
    """Turn zenoh's paths, as `listen/endpoints`, into nested mappings."""
    whole: dict[str, Any] = {}
    for path, value in flat.items():
        *outer, last = path.split("/")
        inner = whole
        for name in outer:
            inner = inner.setdefault(name, {})
        inner[last] = value
    return whole


def client_of(settings: ClientSettings, encoding: str) -> CorrectionClient:
    return CorrectionClient(
        settings.endpoints,
        settings.arm,
        settings.namespace,
        encoding,
        settings.timeout,
        connect_timeout=settings.connect_timeout,
        config_file=settings.config_file,
    )


Ask = Callable[[], object]


def payloads(pose: list[float], twist: list[float]) -> dict[str, tuple[bytes, bytes, str]]:
    """Payload, attachment and encoding of one question, by encoding: what the service's client sends."""
    meta = RequestMeta(request_id="01234567-1000", client_time=time.time(), deadline=PATIENT)
    body = CorrectRequest(tuple(pose), tuple(twist))
    told = {
        codec.name: (codec.encode(body), codec.encode(meta), codec.encoding("correct")) for codec in CODECS.values()
    }
    stamped = StampedPose(tuple(pose), 1, 0, "tracker")
    return {**told, "cdr": (write_pose(stamped), JSON.encode(meta), CDR_ENCODING)}


def bare_asker(session: zenoh.Session, key: str, message: tuple[bytes, bytes, str]) -> Ask:
    """Ask a key with given bytes, and wait for one reply."""
    payload, attachment, encoding = message
    querier = session.declare_querier(key, timeout=PATIENT, consolidation=zenoh.ConsolidationMode.NONE)
    while not querier.matching_status.matching:
        time.sleep(0.01)

    def ask() -> zenoh.Reply:
        channel = zenoh.handlers.FifoChannel(64)
        reply = querier.get(channel, payload=payload, attachment=attachment, encoding=encoding).recv()
        if reply.ok is None:
            raise RuntimeError(reply.err.payload.to_bytes())
        return reply

    return ask


@contextmanager
def askers(service: ClientSettings, echo: ClientSettings, model: Path) -> Iterator[dict[str, Ask]]:
    """Give the ways to ask service and echo with every encoding."""
    pose, twist = typical_query(model)
    messages = payloads(pose, twist)
    with ExitStack() as stack:
        session = stack.enter_context(open_client(echo))
        clients = {name: stack.enter_context(client_of(service, name)) for name in ("json", "msgpack")}
        to_service = stack.enter_context(open_client(service))
        yield {
            **{f"echo, {name} size": bare_asker(session, ECHO, messages[name]) for name in messages},
            **{f"service, {name}": ask_of(client, pose, twist) for name, client in clients.items()},
            "service, cdr": bare_asker(to_service, f"{service.arm}/correct", messages["cdr"]),
        }


def ask_of(client: CorrectionClient, pose: list[float], twist: list[float]) -> Ask:
    return lambda: client.correct(pose, twist)


def alternate(ways: dict[str, Ask], rounds: int, warm_up: int) -> dict[str, list[float]]:
    """Seconds of every way, asked once a round, each round starting with another one."""
    order = list(ways)
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for round_ in range(warm_up + rounds):
        start = round_ % len(order)
        for name in order[start:] + order[:start]:
            began = time.perf_counter()
            ways[name]()
            seconds[name].append(time.perf_counter() - began)
    return {name: values[warm_up:] for name, values in seconds.items()}


def together(plan: Callable[..., None], count: int, *arguments: Any, patience: float) -> list[Any]:
    """Return what each of `count` processes puts into `told` by `plan(told, start, *arguments)`, waiting at `start`."""
    told, start = children.Queue(), children.Barrier(count)
    planners = [children.Process(target=plan, args=(told, start, *arguments), daemon=True) for _ in range(count)]
    for planner in planners:
        planner.start()
    answers = [told.get(timeout=patience) for _ in planners]
    for planner in planners:
        planner.join()
    return answers


def latencies(row: dict[str, float]) -> list[float]:
    """Return the cells of a :func:`summary` in a table."""
    return [row["median_ms"], row["p99_ms"], row["min_ms"], 100 * row["share_over_1_ms"]]


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
