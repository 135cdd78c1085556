"""From a model file to a planner: `gpcorrect serve` in another process, asked by clients, commands and the example."""

from __future__ import annotations

import ctypes
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, assert_refused
from service_support import PATIENT, endpoint_of, free_port

from gpcorrect.calibration import CommandCorrector, load, model_hash
from gpcorrect.types import FloatArray
from gpcorrect_service import CorrectionClient

ROOT = Path(__file__).resolve().parents[2]
GPCORRECT = [sys.executable, "-c", "from gpcorrect.cli import main; main()"]


@pytest.fixture(scope="module")
def model(model_files: tuple[Path, Path]) -> Path:
    """Return the model of a few simulated reaches."""
    return model_files[0]


@contextmanager
def serving(model: Path, endpoint: str) -> Iterator[subprocess.Popen[str]]:
    """Run `gpcorrect serve`, and kill it whatever happens."""
    command = [*GPCORRECT, "serve", str(model), "--endpoint", endpoint]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def endpoint(model: Path) -> Iterator[str]:
    """Give the address of a server that answers."""
    address = endpoint_of(free_port())
    with serving(model, address), client_of(address) as client:
        client.health()
        yield address


def client_of(endpoint: str, encoding: str = "msgpack") -> CorrectionClient:
    return CorrectionClient(
        endpoint,
        encoding=encoding,  # type: ignore[arg-type]
        timeout=PATIENT,
        path_timeout=PATIENT,
        connect_timeout=PATIENT,
    )


def training_queries(model: Path) -> tuple[CommandCorrector, FloatArray]:
    """Return the corrector here, and poses with twists `(k, 13)` that it was trained on."""
    corrector = load(model)
    return corrector, corrector.check_queries


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_served_corrections_are_the_models(model: Path, endpoint: str, encoding: str) -> None:
    """What a planner gets over the wire is what the model says in the planner's own process."""
    corrector, queries = training_queries(model)
    with client_of(endpoint, encoding) as client:
        for query in queries:
            here, there = corrector.correct(query[:7], query[7:]), client.correct(query[:7], query[7:])
            np.testing.assert_allclose(there.position, here.position, rtol=0, atol=1e-9)
            np.testing.assert_allclose(there.quaternion, here.quaternion, rtol=0, atol=1e-9)
            np.testing.assert_allclose(there.interval95, here.interval95, rtol=1e-6)
            assert (there.status, there.reason, there.in_domain) == (here.status, here.reason, here.in_domain)


def test_served_paths_are_the_models(model: Path, endpoint: str) -> None:
    """The same holds for a path, whose velocities are computed along it."""
    corrector, queries = training_queries(model)
    times = np.arange(0.0, 0.5, 0.01)
    poses = np.tile(queries[0, :7], (len(times), 1))
    poses[:, 0] += 0.002 * np.sin(2 * np.pi * times)
    here = corrector.correct_path(poses, times)
    with client_of(endpoint) as client:
        there = client.correct_path(poses, times)
    np.testing.assert_allclose(there.position, here.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.quaternion, here.quaternion, rtol=0, atol=1e-9)
    assert there.status == here.status


def test_the_file_is_named(model: Path, endpoint: str) -> None:
    """Replies and the model key carry the name and the SHA-256 of the served file, and its own words."""
    corrector, queries = training_queries(model)
    with client_of(endpoint) as client:
        result, reply = client.model(), client.correct(queries[0, :7])
    assert (result.id, result.hash) == ("monday", model_hash(model))
    assert (reply.meta.model_id, reply.meta.model_hash) == (result.id, result.hash)
    assert result.info["training_region"] == corrector.info()["training_region"]


def test_query_command(model: Path, endpoint: str) -> None:
    """`gpcorrect query correct --json` prints what the model says."""
    corrector, queries = training_queries(model)
    pose = [repr(float(v)) for v in queries[0, :7]]
    twist = [repr(float(v)) for v in queries[0, 7:]]
    options = ["--pose", *pose, "--twist", *twist, "--endpoint", endpoint, "--timeout", str(PATIENT), "--json"]
    done = subprocess.run([*GPCORRECT, "query", "correct", *options], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    here = corrector.correct(queries[0, :7], queries[0, 7:])
    np.testing.assert_allclose(json.loads(done.stdout)["position"], here.position, rtol=0, atol=1e-9)


def test_example(model: Path, endpoint: str) -> None:
    """The example runs against this server, and what it asks of training data is OK."""
    _, queries = training_queries(model)
    pose = [repr(float(v)) for v in queries[0, :7]]
    command = [sys.executable, "examples/query_service.py", "--endpoint", endpoint, "--timeout", str(PATIENT)]
    done = subprocess.run([*command, "--pose", *pose], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert "many at once: 50 replies, 50 OK" in done.stdout
    assert "nobody there: NO_SERVICE" in done.stdout


@pytest.mark.parametrize("thread", ["main", "a library's"])
def test_sigterm_ends_well(thread: str, model: Path) -> None:
    """SIGTERM ends `gpcorrect serve` with status 0, whichever thread it reaches; the log is JSON and tells the end."""
    address = endpoint_of(free_port())
    with serving(model, address) as process:
        with client_of(address) as client:
            client.health()
        if thread == "main":
            process.send_signal(signal.SIGTERM)
        else:
            other = max(int(task.name) for task in Path(f"/proc/{process.pid}/task").iterdir())
            assert ctypes.CDLL(None).tgkill(process.pid, other, signal.SIGTERM) == 0
        _, log = process.communicate(timeout=PATIENT)
        events = [json.loads(line) for line in log.splitlines() if line.startswith("{")]
    assert process.returncode == 0
    assert [event["event"] for event in events] == ["serving", "stopped"]
    assert events[0]["model_hash"] == model_hash(model)


@pytest.mark.parametrize("fault", ["taken", "open", "truncated", "missing"])
def test_refused_at_the_start(fault: str, model: Path, endpoint: str, tmp_path: Path, gpcorrect: CommandLine) -> None:
    """A taken or an open address, a truncated or a missing model: status 2 and one message that says so."""
    broken = tmp_path / "broken.gpc"
    broken.write_bytes(model.read_bytes()[:-100])
    arguments, words = {
        "taken": ((model, "--endpoint", endpoint), "cannot listen"),
        "open": ((model, "--endpoint", "tcp/0.0.0.0:7447"), "other machines"),
        "truncated": ((broken,), "refused"),
        "missing": ((tmp_path / "none.gpc",), "no model file"),
    }[fault]
    assert_refused(gpcorrect("serve", *arguments), words)
