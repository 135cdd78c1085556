"""Clients that are closed, by their own thread or another, and those that a process forked away from."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from service_support import PATIENT, POSE, server_process, wait_for

from gpcorrect_service import ClientSettings, ServiceError
from gpcorrect_service.client.connection import Querier
from gpcorrect_service.client.replies import PinnedModels
from gpcorrect_service.client.requests import RequestBuilder
from gpcorrect_service.protocol.messages import HealthAnswer


def shared_memory() -> set[str]:
    """Return the zenoh segments that this process has open."""
    files = (f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd"))
    return {os.readlink(file) for file in files if os.path.islink(file) and ".zenoh" in os.readlink(file)}


def test_closed_clients_leave_no_file_open() -> None:
    """Clients that come and go with errors whose tracebacks live on do not let this process's open files grow."""
    errors = []
    with server_process() as server:
        with server.client() as client:
            client.health()
        before = len(shared_memory())
        for _ in range(5):
            with server.client() as client:
                querier = client._querier("correct")
                try:
                    client.correct([np.nan, *POSE[1:]])
                except ServiceError as error:
                    errors.append(error)
        del querier
        errors.clear()
        gc.collect()
        wait_for(lambda: len(shared_memory()) <= before + 1)


def test_a_client_that_another_thread_closes_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """A question under way when its client is closed ends with NO_SERVICE."""
    with server_process() as server, server.client(timeout=1.0) as client:
        client.correct(POSE)

        async def _closing(*_: object) -> ServiceError:
            client.close()
            return ServiceError("NO_SERVICE", "no reply came")

        monkeypatch.setattr(client, "_attempt", _closing)
        with pytest.raises(ServiceError, match="NO_SERVICE"):
            client.correct(POSE)


class HeldQuerier:
    """A querier as zenoh refuses it while another thread holds it: what is asked of it raises, closing it twice."""

    def __init__(self) -> None:
        self.refusals = 2

    @property
    def matching_status(self) -> None:
        """Refuse."""
        raise RuntimeError("Already mutably borrowed")

    def get(self, *_: object, **__: object) -> None:
        """Refuse."""
        raise RuntimeError("Already mutably borrowed")

    def undeclare(self) -> None:
        """Refuse, or be gone."""
        if self.refusals:
            self.refusals -= 1
            raise RuntimeError("Already borrowed")


def test_a_querier_in_another_threads_hands_is_closed_all_the_same() -> None:
    """Closing waits for who sends a question by it; who asks what is just being closed hears NO_SERVICE."""
    held = [HeldQuerier(), HeldQuerier()]
    declared = iter(held)
    session: Any = SimpleNamespace(declare_querier=lambda *_, **__: next(declared))
    settings = ClientSettings()
    querier = Querier(session, "arm1/health", settings, 1.0, fresh=True)
    question = RequestBuilder(settings, "msgpack", "raise", PinnedModels("", hold=True)).plain("health", HealthAnswer)
    assert not querier.matched
    with pytest.raises(ServiceError, match="NO_SERVICE"):
        querier.ask(querier.first, None, question)
    querier.close()
    assert [one.refusals for one in held] == [0, 0]


def test_a_closed_client_says_so() -> None:
    """Closing twice is closing once; a question after that is NO_SERVICE."""
    with server_process() as server:
        client = server.client()
        assert client.correct(POSE).status == "OK"
        client.close()
        client.close()
        with pytest.raises(ServiceError, match="closed"):
            client.correct(POSE)


def test_a_forked_child_is_told_so_at_once() -> None:
    """In a process forked after a client was opened, old and new clients raise at once; the parent goes on."""
    with server_process() as server, server.client() as client:
        assert client.correct(POSE).status == "OK"
        script = [sys.executable, "-c", FORKING, server.endpoint]
        done = subprocess.run(script, capture_output=True, text=True, timeout=PATIENT, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["OK", "NO_SERVICE spawn", "NO_SERVICE spawn", "child 3", "OK"]


FORKING = """
import os, sys
from gpcorrect_service import CorrectionClient, ServiceError
pose = [0.1, 0.02, -0.11, 1.0, 0.0, 0.0, 0.0]
old = CorrectionClient(sys.argv[1], timeout=20.0, connect_timeout=20.0)
print(old.correct(pose).status, flush=True)
if not (child := os.fork()):
    new = CorrectionClient(sys.argv[1], timeout=20.0, connect_timeout=20.0)
    for client in (old, new):
        try:
            client.correct(pose)
        except ServiceError as error:
            print(error.status, "spawn" if "spawn" in error.hint else "", flush=True)
        client.close()
    sys.exit(3)
print("child", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
print(old.correct(pose).status, flush=True)
old.close()
"""
