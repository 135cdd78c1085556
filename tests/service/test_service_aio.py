"""The asyncio client says what the waiting one says, without threads of its own."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator

import numpy as np
import pytest
from service_support import PATIENT, POSE, SHIFT, ServerProcess, endpoint_of, free_port, server_process

from gpcorrect_service import AsyncCorrectionClient, ServiceError


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    with server_process("faulty", queue_capacity=500) as process:
        yield process


def client_of(server: ServerProcess, **options: object) -> AsyncCorrectionClient:
    return AsyncCorrectionClient(server.endpoint, timeout=PATIENT, connect_timeout=PATIENT, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_same_answers_as_the_waiting_client(server: ServerProcess, encoding: str) -> None:
    """Pose, path and model are answered as to the waiting client."""

    async def ask() -> tuple[object, ...]:
        async with client_of(server, encoding=encoding) as client:
            path = await client.correct_path([POSE, POSE], [0.0, 0.1])
            return (
                (await client.correct(POSE)).pose,
                path.pose,
                await client.model(),
                (await client.health()).state,
            )

    pose, poses, model, state = asyncio.run(ask())
    with server.client() as client:
        np.testing.assert_array_equal(pose, client.correct(POSE).pose)
        np.testing.assert_array_equal(poses, client.correct_path([POSE, POSE], [0.0, 0.1]).pose)
        assert model == client.model()
    assert state == "ENABLED"


def test_answers_go_to_their_questions(server: ServerProcess) -> None:
    """Two hundred questions at once each get the answer to their own pose, and take no thread each."""

    async def ask() -> tuple[int, int]:
        poses = np.tile(POSE, (200, 1))
        poses[:, 1] = np.linspace(-0.1, 0.1, len(poses))
        async with client_of(server) as client:
            await client.correct(POSE)
            before = threads()
            answers = [asyncio.create_task(client.correct(pose)) for pose in poses]
            await asyncio.sleep(0)
            during = threads()
            replies = await asyncio.gather(*answers)
        np.testing.assert_array_equal([r.position for r in replies], poses[:, :3] + SHIFT)
        return before, during

    before, during = asyncio.run(ask())
    assert during <= before + 5


def threads() -> int:
    """Return how many threads this process has, those of zenoh included (Linux)."""
    tasks = "/proc/self/task"
    return len(os.listdir(tasks)) if os.path.isdir(tasks) else 0


@pytest.mark.parametrize(("x", "status"), [(-0.1, "INTERNAL"), (np.nan, "BAD_INPUT"), (100.0, "BAD_INPUT")])
def test_refusals(server: ServerProcess, x: float, status: str) -> None:
    """Errors are raised with their status; a fallback hides none of them where nothing was answered before."""

    async def ask(on_failure: str) -> object:
        async with client_of(server, on_failure=on_failure) as client:
            return await client.correct([x, *POSE[1:]])

    with pytest.raises(ServiceError) as caught:
        asyncio.run(ask("raise"))
    assert caught.value.status == status
    with pytest.raises(ServiceError, match=status):
        asyncio.run(ask("identity"))


def test_nobody_there() -> None:
    """Without a server the client says NO_SERVICE, and the event loop runs on while it waits."""

    async def ask() -> int:
        ticks = 0
        async with AsyncCorrectionClient(endpoint_of(free_port()), timeout=0.5, connect_timeout=0.5) as client:
            question = asyncio.create_task(client.correct(POSE))
            while not question.done():
                await asyncio.sleep(0.01)
                ticks += 1
            with pytest.raises(ServiceError, match="NO_SERVICE"):
                await question
        return ticks

    assert asyncio.run(ask()) > 3


def test_a_cancelled_question_harms_no_other(server: ServerProcess) -> None:
    """A question that its planner gave up leaves the client working."""

    async def ask() -> str:
        async with client_of(server) as client:
            await client.correct(POSE)
            question = asyncio.create_task(client.correct(POSE))
            await asyncio.sleep(0)
            question.cancel()
            return (await client.correct(POSE)).status

    assert asyncio.run(ask()) == "OK"
