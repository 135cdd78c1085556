"""The same correction served by FastAPI on uvicorn, by gRPC, and by this service, one planner, same run.

The peers are given their best: one worker beside the model, a connection kept alive, no checks of units or deadlines,
no bounded queue, no model named in the answer. FastAPI speaks JSON; gRPC carries the service's own MessagePack, so it
needs no generated code. Install them with: pip install 'gpcorrect[peers]'.
"""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
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
    ask_of,
    client_of,
    end_with_parent,
    free_endpoint,
    latencies,
    process,
    service_and_echo,
    summary,
    typical_query,
)
from support import print_load, print_table, save_results

from gpcorrect_service.protocol.answer import PoseAnswer, pack
from gpcorrect_service.protocol.messages import MSGPACK, CorrectRequest
from gpcorrect_service.server.models import Model, load_model

ROUNDS = 2000
WARM_UP = 200
METHOD = "/gpcorrect.Correction/correct"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="model file; without it a small one is fitted to simulated data")
    options.add_argument("--rounds", type=int, default=ROUNDS)
    given = options.parse_args()
    with a_model(given.model) as model, ExitStack() as stack:
        service, _ = stack.enter_context(service_and_echo(model, routed=False))
        pose, twist = typical_query(model)
        clients = {name: stack.enter_context(client_of(service, name)) for name in ("msgpack", "json")}
        ways: dict[str, Ask] = {f"this service, {name}": ask_of(c, pose, twist) for name, c in clients.items()}
        ways["gRPC, MessagePack"] = stack.enter_context(grpc_peer(model, pose, twist))
        ways["FastAPI on uvicorn, JSON"] = stack.enter_context(fastapi_peer(model, pose, twist))
        results = {name: summary(seconds) for name, seconds in alternate(ways, given.rounds, WARM_UP).items()}
    print_load()
    print_table(("", *LATENCIES), [[name, *latencies(row)] for name, row in results.items()])
    save_results("service_peers", results)


def answer(model: Model, pose: tuple[float, ...], twist: tuple[float, ...] | None) -> PoseAnswer:
    return pack(PoseAnswer, model.corrector.correct(np.array(pose), None if twist is None else np.array(twist)))


@contextmanager
def grpc_peer(model: Path, pose: list[float], twist: list[float]) -> Iterator[Ask]:
    import grpc

    port = int(free_endpoint().rpartition(":")[2])
    with process(serve_grpc, str(model), port), grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        call = channel.unary_unary(METHOD)

        def ask() -> PoseAnswer:
            payload = MSGPACK.encode(CorrectRequest(tuple(pose), tuple(twist)))
            return MSGPACK.decode(PoseAnswer, call(payload))

        yield ask


def serve_grpc(ready: Event, model: str, port: int) -> None:
    import grpc

    end_with_parent()
    corrector = load_model(model)

    def correct(payload: bytes, _: Any) -> bytes:
        asked = MSGPACK.decode(CorrectRequest, payload)
        return MSGPACK.encode(answer(corrector, asked.pose, asked.twist))

    class Handler(grpc.GenericRpcHandler):
        def service(self, details: Any) -> Any:
            return grpc.unary_unary_rpc_method_handler(correct) if details.method == METHOD else None

    server = grpc.server(ThreadPoolExecutor(1))
    server.add_generic_rpc_handlers((Handler(),))
    server.add_insecure_port(f"127.0.0.1:{port}")
    server.start()
    ready.set()
    server.wait_for_termination()


@contextmanager
def fastapi_peer(model: Path, pose: list[float], twist: list[float]) -> Iterator[Ask]:
    import httpx

    port = int(free_endpoint().rpartition(":")[2])
    with process(serve_fastapi, str(model), port), httpx.Client(base_url=f"http://127.0.0.1:{port}") as client:
        body = {"pose": pose, "twist": twist}
        yield lambda: client.post("/correct", json=body).raise_for_status().json()


def serve_fastapi(ready: Event, model: str, port: int) -> None:
    import uvicorn
    from fastapi import FastAPI
    from pydantic import BaseModel

    end_with_parent()
    corrector = load_model(model)

    class Asked(BaseModel):
        pose: list[float]
        twist: list[float] | None = None

    Asked.model_rebuild()
    app = FastAPI()

    async def correct(asked: Asked) -> dict[str, Any]:
        told = answer(corrector, tuple(asked.pose), None if asked.twist is None else tuple(asked.twist))
        return {name: getattr(told, name) for name in told.__struct_fields__}

    correct.__annotations__["asked"] = Asked
    app.post("/correct")(correct)
    server = uvicorn.Server(uvicorn.Config(app, host="127.0.0.1", port=port, log_level="error"))

    def tell() -> None:
        until = time.monotonic() + PATIENT
        while not server.started and time.monotonic() < until:
            time.sleep(0.01)
        ready.set()

    threading.Thread(target=tell, daemon=True).start()
    server.run()


if __name__ == "__main__":
    main()
