"""A server in another process and clients here: every arrow a real zenoh connection."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest
import zenoh
from service_support import PATIENT, POSE, SHIFT, ServerProcess, ask_bare, server_process, stranger

from gpcorrect_service import ServiceError
from gpcorrect_service.protocol.answer import PoseAnswer
from gpcorrect_service.protocol.messages import JSON, ErrorAnswer, HealthAnswer, error_codec
from gpcorrect_service.protocol.settings import MAX_MESSAGE_BYTES

ENCODINGS = ["msgpack", "json"]


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    with server_process("faulty") as process:
        yield process


@pytest.fixture(scope="module")
def bare(server: ServerProcess) -> Iterator[zenoh.Session]:
    with stranger(server.endpoint) as session:
        yield session


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_correct(server: ServerProcess, encoding: str) -> None:
    """A pose comes back shifted, with model and process named, whatever the encoding."""
    with server.client(encoding=encoding) as client:
        reply = client.correct(POSE, np.zeros(6))
    np.testing.assert_allclose(reply.pose, [*(POSE[:3] + SHIFT), *POSE[3:]], rtol=0, atol=1e-15)
    assert (reply.status, reply.fallback, reply.in_domain) == ("OK", "", True)
    assert np.isnan(reply.std[3:]).all()
    assert reply.meta.model_id == "faulty-model"
    assert reply.meta.model_hash == b"faulty".hex()
    assert reply.meta.replica.endswith(str(server.process.pid))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_correct_path(server: ServerProcess, encoding: str) -> None:
    """A path of the longest length passes in both encodings, row by row in order."""
    n = 5000
    poses = np.tile(POSE, (n, 1))
    poses[:, 1] = np.linspace(-0.1, 0.1, n)
    with server.client(encoding=encoding, path_timeout=PATIENT) as client:
        reply = client.correct_path(poses, np.arange(n) * 0.01)
    np.testing.assert_allclose(reply.pose[:, :3], poses[:, :3] + SHIFT, rtol=0, atol=1e-15)
    assert reply.pose.shape == (n, 7)
    assert reply.in_domain.all()
    assert set(reply.status) == {"OK"}


def test_model_and_health(server: ServerProcess) -> None:
    """The model tells itself, and health counts the queries that were answered."""
    with server.client() as client:
        before = client.health()
        client.correct(POSE)
        after, model = client.health(), client.model()
    assert (after.state, after.arm, after.model_id) == ("ENABLED", "arm1", model.id)
    assert after.uptime >= before.uptime
    assert after.counts["correct"]["OK"] == before.counts.get("correct", {}).get("OK", 0) + 1
    assert model.info["frames"] == {"input": "tracker", "output": "base"}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    ("pose", "status"),
    [
        ([np.nan, *POSE[1:]], "BAD_INPUT"),
        ([100.0, 20.0, -110.0, *POSE[3:]], "BAD_INPUT"),
        (np.eye(4), "BAD_INPUT"),
        (["a", "b", "c"], "BAD_INPUT"),
        ([-0.1, *POSE[1:]], "INTERNAL"),
        ([0.0, *POSE[1:]], "INTERNAL"),
    ],
    ids=["nan", "mm", "matrix", "text", "fault", "nan answer"],
)
def test_refusals(server: ServerProcess, encoding: str, pose: object, status: str) -> None:
    """Bad input and faults inside come back with status and cause, and the next query is answered."""
    with server.client(encoding=encoding) as client:
        with pytest.raises(ServiceError) as caught:
            client.correct(pose)  # type: ignore[arg-type]
        assert client.correct(POSE).status == "OK"
    assert caught.value.status == status
    assert caught.value.message


def test_identity_never_hides_bad_input(server: ServerProcess) -> None:
    """The caller's mistakes raise whatever the fallback is, and so do faults of a model without a registration."""
    with server.client(on_failure="identity") as client:
        assert client.correct(POSE).fallback == ""
        with pytest.raises(ServiceError, match="BAD_INPUT"):
            client.correct([*POSE[:3], 0, 0, 0, 0])
        with pytest.raises(ServiceError, match="INTERNAL"):
            client.correct([-0.1, *POSE[1:]])


@pytest.mark.parametrize(
    ("payload", "encoding"),
    [
        (b"", "application/json;gpcorrect.correct/1"),
        (b"", "application/msgpack"),
        (b'{"pose": [0.1, 0.0,', "application/json"),
        (b'{"pose": [0.1, 0.0, 0.0]}', "application/msgpack"),
        (b'{"pose": [0.1, 0.0, 0.0]}', "text/plain"),
        (b'{"pose": [0.1, 0.0, 0.0]}', "application/json;gpcorrect.correct/2"),
        (os.urandom(2000), "application/json"),
        (b"\xc1" + os.urandom(2000), "application/msgpack"),
        (b"x" * (MAX_MESSAGE_BYTES - 10_000), "application/json"),
    ],
    ids=["empty", "no msgpack", "cut", "mixed up", "text", "schema 2", "random", "random msgpack", "large"],
)
def test_foreign_payloads(bare: zenoh.Session, payload: bytes, encoding: str) -> None:
    """Whatever bytes a stranger sends, the one reply is BAD_INPUT in the service's own error encoding."""
    (reply,) = ask_bare(bare, "gpcorrect/arm1/correct", payload, encoding)
    assert reply.err is not None
    codec = error_codec(str(reply.err.encoding))
    assert codec is not None
    assert codec.decode(ErrorAnswer, reply.err.payload.to_bytes()).status == "BAD_INPUT"


def test_too_large_a_query_reaches_nobody(server: ServerProcess) -> None:
    """Ten megabytes are never answered, and the server answers the next query."""
    with stranger(server.endpoint) as session:
        assert ask_bare(session, "gpcorrect/arm1/health", b"")
        querier = session.declare_querier("gpcorrect/arm1/correct", timeout=1.0)
        for reply in querier.get(payload=bytes(10_000_000), encoding="application/json"):
            assert reply.err is not None
            assert error_codec(str(reply.err.encoding)) is None
    with server.client() as client:
        assert client.correct(POSE).status == "OK"


def test_a_person_may_ask_without_encoding(bare: zenoh.Session) -> None:
    """A query without encoding and attachment is JSON; the answer is JSON on the concrete key."""
    (reply,) = ask_bare(bare, "gpcorrect/arm1/correct", b'{"pose": [0.1, 0.0, 0.0]}')
    assert reply.ok is not None
    assert str(reply.ok.key_expr) == "gpcorrect/arm1/correct"
    assert str(reply.ok.encoding) == "application/json;gpcorrect.correct/1"
    JSON.decode(PoseAnswer, reply.ok.payload.to_bytes())


def test_a_wildcard_finds_every_arm(bare: zenoh.Session) -> None:
    """Asking `gpcorrect/*/health` is answered on the key of the arm."""
    (reply,) = ask_bare(bare, "gpcorrect/*/health", b"")
    assert reply.ok is not None
    assert str(reply.ok.key_expr) == "gpcorrect/arm1/health"
    assert JSON.decode(HealthAnswer, reply.ok.payload.to_bytes()).state == "ENABLED"


@pytest.mark.parametrize("options", [{"arm": "arm2"}, {"namespace": "elsewhere"}])
def test_other_names_are_other_services(server: ServerProcess, options: dict[str, str]) -> None:
    """A server answers for its own arm and namespace only; the client says whom it did not find."""
    client = server.client(timeout=0.1, connect_timeout=0.2, **options)
    with client, pytest.raises(ServiceError) as caught:
        client.correct(POSE)
    assert caught.value.status == "NO_SERVICE"
    assert next(iter(options.values())) in caught.value.message


def test_too_large_a_path_stays_at_home(server: ServerProcess) -> None:
    """A path that no server would take is refused by the client itself, with what to do."""
    with server.client() as client, pytest.raises(ServiceError, match="BAD_INPUT") as caught:
        client.correct_path(np.tile(POSE, (100_000, 1)), np.arange(100_000))
    assert "in parts" in caught.value.hint
