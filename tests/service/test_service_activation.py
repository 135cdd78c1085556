"""Models that change while a server answers: nothing fails, nothing is mixed, a bad one changes nothing."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from service_support import PATIENT, ServerProcess, hang, store_process, wait_for

from gpcorrect.calibration import ModelStore, load, model_hash
from gpcorrect.types import FloatArray
from gpcorrect_service import ClientSettings, Reply, ServiceError
from gpcorrect_service.client.operator import Operator

ACTIVATIONS = 12  # bench/service_faults.py makes a hundred


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory, model_files: tuple[Path, Path]) -> ModelStore:
    made = ModelStore(tmp_path_factory.mktemp("served") / "store")
    for when, path in enumerate(model_files):
        made.add(path, now=float(when))
    made.activate(made.find("monday"))
    return made


@pytest.fixture(scope="module")
def server(store: ModelStore) -> Iterator[ServerProcess]:
    with store_process(store.folder) as process:
        yield process


@pytest.fixture(scope="module")
def operator(server: ServerProcess) -> Iterator[Operator]:
    settings = ClientSettings((server.endpoint,), connect_timeout=PATIENT)
    with Operator(settings, patience=PATIENT) as made:
        yield made


def path_of(model: Path) -> tuple[FloatArray, FloatArray]:
    """Return a path through the training region, poses and times."""
    queries = load(model).check_queries
    start, end = queries[0][:3], queries[1][:3]
    share = np.linspace(0.0, 1.0, 200)[:, None]
    positions = (1 - share) * start + share * end
    return np.hstack([positions, np.tile([1.0, 0.0, 0.0, 0.0], (200, 1))]), np.linspace(0.0, 4.0, 200)


class Planner:
    """Asks one path again and again until it is stopped; collects every reply and every failure."""

    def __init__(self, server: ServerProcess, poses: FloatArray, times: FloatArray) -> None:
        self._server, self._poses, self._times = server, poses, times
        self._stop = threading.Event()
        self.replies: list[Reply] = []
        self.failures: list[ServiceError] = []
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Planner:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(2 * PATIENT)

    def _run(self) -> None:
        with self._server.client(path_timeout=PATIENT, pin=False) as client:
            while not self._stop.is_set():
                try:
                    self.replies.append(client.correct_path(self._poses, self._times))
                except ServiceError as error:
                    self.failures.append(error)


def test_activation_under_load(server: ServerProcess, operator: Operator, model_files: tuple[Path, Path]) -> None:
    """While models change, no query fails, and every path comes from one model whole: the one that it names."""
    poses, times = path_of(model_files[0])
    expected = {model_hash(file): load(file).correct_path(poses, times).position for file in model_files}
    with Planner(server, poses, times) as planner:
        for i in range(ACTIVATIONS):
            (result,) = operator.activate(("tuesday", "monday")[i % 2])
            assert result.hash in expected
    assert planner.failures == []
    assert {reply.meta.model_hash for reply in planner.replies} == set(expected)
    for reply in planner.replies:
        np.testing.assert_allclose(reply.position, expected[reply.meta.model_hash], rtol=0, atol=1e-12)


def test_what_is_activated_outlives_the_server(store: ModelStore, operator: Operator) -> None:
    """The store remembers what was activated over the network, and in which order."""
    (listed,) = operator.models()
    before = store.active()
    assert before is not None
    assert listed.serving["pose"] == before.hash
    other = next(entry for entry in store.models() if entry != before)
    (result,) = operator.activate(other.hash[:10])
    assert (result.before, store.history()[-2:]) == (before.hash, (before, other))


def test_a_bad_file_leaves_the_old_model_serving(
    server: ServerProcess, store: ModelStore, operator: Operator, model_files: tuple[Path, Path]
) -> None:
    """A truncated file in the store is refused with the reason; the old model goes on answering."""
    operator.activate("monday")
    path = store.path(store.find("tuesday"))
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    try:
        with pytest.raises(ServiceError, match="refused") as caught:
            operator.activate("tuesday")
    finally:
        path.write_bytes(whole)
    assert caught.value.status == "BAD_INPUT"
    with server.client() as client:
        assert client.model().hash == model_hash(model_files[0])


def test_a_paused_server_refuses_and_goes_on(server: ServerProcess, operator: Operator) -> None:
    """PAUSED refuses corrections, health and the operator still answer; ENABLED answers again."""
    operator.set_state("PAUSED")
    with server.client() as client:
        with pytest.raises(ServiceError, match="PAUSED"):
            client.correct([0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0])
        assert client.health().state == "PAUSED"
        operator.set_state("ENABLED")
        assert client.correct([0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0]).fallback == ""
        assert 'gpcorrect_state{state="ENABLED"} 1.0' in client.metrics()


def test_a_pause_outlives_the_server(tmp_path: Path, model_files: tuple[Path, Path]) -> None:
    """Who starts from the store of a paused arm, or has run on it all the time, refuses too, until it goes on."""
    folder = ModelStore(tmp_path / "store")
    folder.activate(folder.add(model_files[0], now=0.0))
    with store_process(folder.folder) as one, store_process(folder.folder) as other:
        with Operator(ClientSettings((one.endpoint,), connect_timeout=PATIENT), patience=PATIENT) as of_one:
            assert of_one.set_state("PAUSED")[0].stays
        with other.client() as client:
            wait_for(lambda: client.health().state == "PAUSED")
    with store_process(folder.folder) as again, again.client() as client:
        with pytest.raises(ServiceError, match="PAUSED"):
            client.correct([0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0])
        folder.pause(paused=False)
        wait_for(lambda: client.health().state == "ENABLED")


def test_an_activation_reaches_every_server_of_the_store(tmp_path: Path, model_files: tuple[Path, Path]) -> None:
    """Another server of the store takes over what one was told, what was rolled back there, and no damaged file."""
    folder = ModelStore(tmp_path / "store")
    for path in model_files:
        folder.add(path, now=0.0)
    folder.activate(folder.find("monday"))
    monday, tuesday = (model_hash(path) for path in model_files)
    with store_process(folder.folder) as one, store_process(folder.folder) as other, other.client() as client:
        with Operator(ClientSettings((one.endpoint,), connect_timeout=PATIENT), patience=PATIENT) as of_one:
            assert [answer.hash for answer in of_one.activate("tuesday")] == [tuesday]
        wait_for(lambda: client.health().model_hash == tuesday)
        folder.rollback()
        wait_for(lambda: client.health().model_hash == monday)
        with one.client() as first:
            wait_for(lambda: first.health().model_hash == monday)
        file = folder.path(folder.find("tuesday"))
        file.write_bytes(file.read_bytes()[:-100])
        folder.activate(folder.find("tuesday"), verified=True)
        folder.pause(paused=True)
        wait_for(lambda: client.health().state == "PAUSED")
        assert client.health().model_hash == monday
        shutil.rmtree(folder.folder)
        time.sleep(2.5)  # more than two looks
        assert client.health().state == "PAUSED"
        with Operator(ClientSettings((other.endpoint,), connect_timeout=PATIENT), patience=PATIENT) as of_other:
            assert not of_other.set_state("PAUSED")[0].stays
        assert not folder.exists


def test_a_server_that_does_not_answer_the_operator_is_named(tmp_path: Path, model_files: tuple[Path, Path]) -> None:
    """A hung server lives, and goes on as before when it wakes: whoever paused it must hear of it."""
    folder = ModelStore(tmp_path / "store")
    folder.activate(folder.add(model_files[0], now=0.0))
    with store_process(folder.folder, replica="well") as one, store_process(folder.folder, replica="hung") as other:
        settings = ClientSettings((one.endpoint, other.endpoint), connect_timeout=PATIENT)
        with Operator(settings, patience=6.0) as both:
            wait_for(lambda: len(both.models()) == 2)
            assert other.process.pid is not None
            hang(other.process.pid)
            with pytest.raises(ServiceError, match="hung did not answer") as caught:
                both.set_state("PAUSED")
            os.kill(other.process.pid, signal.SIGCONT)
    assert "well answered" in str(caught.value)


def test_servers_that_differ_afterwards_are_named(tmp_path: Path, model_files: tuple[Path, Path]) -> None:
    """One name for two models, and a model that only one server has: the operator hears that they differ now."""
    monday, tuesday = model_files
    stores = [ModelStore(tmp_path / name) for name in "ab"]
    for store, path in zip(stores, (monday, tuesday), strict=True):
        store.add(path, now=0.0, name="best")
    stores[0].add(tuesday, now=1.0, name="only here")
    with store_process(stores[0].folder) as one, store_process(stores[1].folder) as other:
        settings = ClientSettings((one.endpoint, other.endpoint), connect_timeout=PATIENT)
        with Operator(settings, patience=PATIENT) as operator:
            wait_for(lambda: len(operator.models()) == 2)
            with pytest.raises(ServiceError, match="different models in the servers' stores") as found:
                operator.activate("best")
            assert found.value.status == "OTHER_MODEL"
            with pytest.raises(ServiceError, match=r"names no model.* 1 of 2 servers refused; .* did it"):
                operator.activate("only here")
            assert len(operator.activate(model_hash(tuesday))) == 2
