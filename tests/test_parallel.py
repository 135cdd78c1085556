"""Work spread over threads, processes and a Dask cluster: the same results, also when a worker dies half-way."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gpcorrect.errors import DataError, MissingExtraError
from gpcorrect.parallel import ClusterError, each, each_as_done, each_here, workers
from gpcorrect.types import Progress

pytest.importorskip("distributed", reason="clusters need distributed: pip install 'gpcorrect[cluster]'")


class Recorded(Progress):
    """Remembers what was reported."""

    def __init__(self) -> None:
        self.steps: list[tuple[str, float]] = []

    def step(self, stage: str, done: float) -> None:
        self.steps.append((stage, done))


def drawn(scale: np.ndarray, seed: int) -> np.ndarray:
    """Return numbers that depend on shared data and the item alone."""
    return scale * np.random.default_rng(seed).normal(size=50)


def slow(folder: Path, seconds: float, number: int) -> tuple[int, int]:
    """Take a while, leave a mark, and say who did it."""
    (folder / f"{number}-{os.getpid()}").touch()
    time.sleep(seconds)
    return number, os.getpid()


def refuse(number: int) -> int:
    """Refuse the third."""
    if number == 3:
        raise DataError("the third is bad.", hint="Leave it out.")
    return number


SCALE = np.linspace(1, 2, 50)


def test_results_are_the_same_wherever_they_are_computed(cluster) -> None:
    """Here, in two threads or processes, on a cluster: bit for bit, and in order."""
    here = list(each(partial(drawn, SCALE), range(40)))
    with workers(jobs=2, threads=True):
        threads = list(each(partial(drawn, SCALE), range(40)))
    np.testing.assert_array_equal(threads, here)
    with workers(jobs=2):
        processes = list(each(partial(drawn, SCALE), range(40)))
    with workers(scheduler=cluster.scheduler_address):
        spread = list(each(partial(drawn, SCALE), range(40)))
    np.testing.assert_array_equal(processes, here)
    np.testing.assert_array_equal(spread, here)


@pytest.mark.parametrize(("context", "alone"), [({"jobs": 2, "threads": True}, False), ({"jobs": 2}, True), ({}, True)])
def test_what_is_too_short_to_be_sent_goes_to_threads_or_stays(context: dict[str, int], alone: bool) -> None:
    def thread(number: int) -> tuple[int, int]:
        time.sleep(0.05)
        return number, threading.get_ident()

    with workers(**context):
        found = each_here(thread, range(6))
    assert [number for number, _ in found] == list(range(6))
    assert ({ident for _, ident in found} == {threading.get_ident()}) is alone


def test_a_worker_that_is_killed_half_way_costs_no_result(cluster, tmp_path: Path) -> None:
    """What it had begun is done again by another."""

    def kill() -> None:
        while len(list(tmp_path.iterdir())) < 4:
            time.sleep(0.05)
        victim = int(sorted(tmp_path.iterdir())[-1].name.split("-")[1])
        killed.append(victim)
        os.kill(victim, signal.SIGKILL)

    killed: list[int] = []
    killer = threading.Thread(target=kill)
    killer.start()
    with workers(scheduler=cluster.scheduler_address):
        done = list(each(partial(slow, tmp_path, 0.15), range(24)))
    killer.join()
    assert [number for number, _ in done] == list(range(24))
    begun = {tuple(map(int, p.name.split("-"))) for p in tmp_path.iterdir()}
    assert any(pid == killed[0] and (number, pid) not in done for number, pid in begun)


def test_progress_is_reported_and_anything_done_first_comes_first() -> None:
    """Each call is counted once; in any order every result is there once."""
    progress = Recorded()
    assert list(each(partial(drawn, 1.0), range(3), progress, "drawing"))[2].shape == (50,)
    assert progress.steps == [("drawing", 1 / 3), ("drawing", 2 / 3), ("drawing", 1.0)]
    with workers(jobs=2):
        assert sorted(each_as_done(abs, [-3, -1, -2])) == [1, 2, 3]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_a_call_is_the_errors_own(jobs: int) -> None:
    """Message and hint come through, wherever the call ran."""
    with workers(jobs=jobs), pytest.raises(DataError, match=r"the third is bad\. Leave it out"):
        list(each(refuse, range(6)))


@pytest.mark.parametrize("threads", [False, True])
def test_no_job_at_all_is_refused(threads: bool) -> None:
    with pytest.raises(DataError, match="--jobs a number from 1"), workers(jobs=0, threads=threads):
        pass


def test_work_that_is_broken_off_ends_inside_its_context(tmp_path: Path) -> None:
    """What stops the results stops the calls too, while their workers are there, though its traceback is kept."""

    class Broken(Progress):
        def step(self, stage: str, done: float) -> None:
            raise KeyboardInterrupt

    with warnings.catch_warnings(record=True) as said, workers(jobs=2):
        warnings.simplefilter("always")
        with pytest.raises(KeyboardInterrupt) as kept:
            list(each(partial(slow, tmp_path, 0.05), range(40), Broken(), "slowly"))
        assert any(re.search("cancelled|not used", str(w.message)) for w in said)  # joblib of calls that it gives up
    assert kept.tb is not None
    assert len(list(tmp_path.iterdir())) < 40


def test_a_cluster_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """With how to start one; and which extra brings the library."""
    monkeypatch.setattr("gpcorrect.parallel.PATIENCE", 0.5)
    with (
        pytest.raises(ClusterError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:1"),
        workers(scheduler="tcp://127.0.0.1:1"),
    ):
        pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"gpcorrect\[cluster\]"), workers(scheduler="tcp://127.0.0.1:1"):
        pass


def test_workers_of_another_version_are_refused(cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    """They would compute something else."""
    monkeypatch.setattr("gpcorrect.parallel.version", lambda name: "99")
    with pytest.raises(ClusterError, match="version"), workers(scheduler=cluster.scheduler_address):
        pass
