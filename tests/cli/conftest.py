"""The command line as a fixture, and one fit that many tests look at."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from cli_support import CommandLine, Fitted, written
from support import Once, small_log


@pytest.fixture
def gpcorrect(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(monkeypatch, capfd)


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    return written(small_log(), tmp_path / "log.csv")


@pytest.fixture(scope="session")
def fitted(once: Once) -> Fitted:
    """Return what `gpcorrect fit` makes of the small recording."""
    return Fitted(once.file("fitted", _fit))


def _fit(folder: Path) -> None:
    folder.mkdir()
    log = written(small_log(), folder / "log.csv")
    words = ["fit", log, "--output", folder / "model.gpc", "--time-offset", "none", "--json"]
    done = subprocess.run([sys.executable, "-m", "gpcorrect", *words], check=True, capture_output=True)
    (folder / "fit.json").write_bytes(done.stdout)
