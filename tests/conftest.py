"""What is made once a run and shared by all tests and all worker processes."""

from __future__ import annotations

import fcntl
import io
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from command_line import CommandLine, exit_status
from hypothesis import settings
from support import Fitted, Once, short_search, small_log
from threadpoolctl import threadpool_limits

from gpcorrect.calibration import CommandCorrector, load
from gpcorrect.logs import write_log

# How long an example takes says more of the machine's other work than of the code.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


def pytest_configure() -> None:
    """One thread of linear algebra a process: two pools on few cores fight each other, ten times slower.

    Programs that the tests start hear of a closed terminal, also when nohup made this one deaf to it.
    """
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # of the processes that tests start
    threadpool_limits(1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, so that no worker is left alone with one of them at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """Return the maker of what several worker processes need."""
    folder = tmp_path_factory.getbasetemp()
    return Once(folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder)


@pytest.fixture(scope="session")
def fitted(once: Once) -> Fitted:
    """Return what `gpcorrect fit` makes of the small recording with the known miss; no test may write to it."""
    return Fitted(once.file("fitted", _fit))


@pytest.fixture(scope="session")
def small_model(fitted: Fitted) -> Path:
    """Return its model file; no test may write to it."""
    return fitted.model


@pytest.fixture(scope="session")
def small_corrector(small_model: Path) -> CommandCorrector:
    """Return its corrector."""
    corrector: CommandCorrector = load(small_model)
    return corrector


@pytest.fixture
def gpcorrect(capfd: pytest.CaptureFixture[str]) -> Iterator[CommandLine]:
    """Return the command line, with a short search for hyperparameters: no law of a command hangs on a long one."""
    with short_search(80):
        yield CommandLine(capfd)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes of one thread each, and their scheduler."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as found:
        yield found


@pytest.fixture
def ports(once: Once) -> Iterator[None]:
    """Keep the ports that documents name from other tests, in other processes too; skip where they are taken."""
    with (once.folder / "ports.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for port in (7449, 9464):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    pytest.skip(f"another process listens on port {port}")
        yield


def _fit(folder: Path) -> None:
    folder.mkdir()
    log = folder / "log.csv"
    write_log(small_log(), log)
    words = ("fit", log, "--output", folder / "model.gpc", "--time-offset", "none", "--json")
    with short_search(), redirect_stdout(io.StringIO()) as printed:
        assert exit_status(*words) == 0
    (folder / "fit.json").write_text(printed.getvalue())
