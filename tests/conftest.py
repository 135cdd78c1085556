"""What is made once a run and shared by all tests and all worker processes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings
from support import Once, small_log
from threadpoolctl import threadpool_limits

from gpcorrect.calibration import CommandCorrector, fit_corrector, save

# How long an example takes says more of the machine's other work than of the code.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


def pytest_configure() -> None:
    """One thread of linear algebra a process: two pools on few cores fight each other, ten times slower."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # of the processes that tests start
    threadpool_limits(1)


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """Return the maker of what several worker processes need."""
    folder = tmp_path_factory.getbasetemp()
    return Once(folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder)


@pytest.fixture(scope="session")
def small_corrector(once: Once) -> CommandCorrector:
    """Return a corrector fitted to the small recording with the known miss."""
    return once.value("small_corrector", lambda: fit_corrector(small_log()))


@pytest.fixture(scope="session")
def small_model(once: Once, small_corrector: CommandCorrector) -> Path:
    """Return the model file of the small corrector; no test may write to it."""
    return once.file("small.gpc", lambda path: save(small_corrector, path))
