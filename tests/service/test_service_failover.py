"""Servers that die, hang and come back, as a planner sees them."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
from service_support import PATIENT, POSE, endpoint_of, free_port, server_process

from gpcorrect_service import CorrectionClient, ServiceError


def test_nobody_there() -> None:
    """Without a server a client can be made; it says NO_SERVICE, the address and what may be the matter."""
    endpoint = endpoint_of(free_port())
    with CorrectionClient(endpoint, connect_timeout=0.2) as client, pytest.raises(ServiceError) as caught:
        client.correct(POSE)
    assert caught.value.status == "NO_SERVICE"
    assert endpoint in caught.value.message
    assert "running" in caught.value.hint


def test_identity_when_nobody_is_there() -> None:
    """The identity fallback hands the desired pose or path back unchanged and says so in every row."""
    with CorrectionClient(endpoint_of(free_port()), connect_timeout=0.1, on_failure="identity") as client:
        one = client.correct(POSE)
        path = client.correct_path([POSE[:3], POSE[:3]], [0.0, 1.0])
        with pytest.raises(ServiceError, match="NO_SERVICE"):
            client.health()
    np.testing.assert_array_equal(one.pose, POSE)
    np.testing.assert_array_equal(path.poses, [POSE[:3]] * 2)
    assert (one.fallback, path.fallback) == ("identity", "identity")
    assert (one.status, path.status) == ("NO_SERVICE", ("NO_SERVICE",) * 2)
    assert not one.in_domain
    assert not path.in_domain.any()


def test_a_server_that_comes_back_is_found_again() -> None:
    """A killed server is NO_SERVICE; once another listens there, the same client is answered again."""
    port = free_port()
    with CorrectionClient(endpoint_of(port), timeout=1.0, connect_timeout=PATIENT) as client:
        with server_process(port=port):
            assert client.correct(POSE).status == "OK"
        with pytest.raises(ServiceError, match="NO_SERVICE"):
            client.correct(POSE)
        with server_process(port=port) as successor:
            assert answering_pid(client) == successor.process.pid


def answering_pid(client: CorrectionClient) -> int:
    """Return the process that answers this client, asking until one does."""
    for _ in range(int(PATIENT)):
        try:
            return int(client.correct(POSE).provenance.replica.rsplit("-", 1)[1])
        except ServiceError:
            continue
    raise AssertionError("nobody answers")


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hung"])
def test_another_replica_answers(blow: signal.Signals) -> None:
    """When the replica that answered is killed or hangs, the other one answers."""
    with server_process() as first, server_process() as second:
        endpoints = (first.endpoint, second.endpoint)
        with CorrectionClient(endpoints, timeout=2.0, connect_timeout=PATIENT) as client:
            victim = answering_pid(client)
            os.kill(victim, blow)
            assert answering_pid(client) in {first.process.pid, second.process.pid} - {victim}


def test_a_closed_client_says_so() -> None:
    """Closing twice is closing once; a question after that is NO_SERVICE."""
    with server_process() as server:
        client = server.client()
        assert client.correct(POSE).status == "OK"
        client.close()
        client.close()
        with pytest.raises(ServiceError, match="closed"):
            client.correct(POSE)
