"""The command line, and the small recording as a file, as fixtures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_support import CommandLine, written
from support import short_search, small_log


@pytest.fixture
def gpcorrect(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Iterator[CommandLine]:
    """Return the command line, with a short search for hyperparameters: no law of a command hangs on a long one."""
    with short_search(80):
        yield CommandLine(monkeypatch, capfd)


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    return written(small_log(), tmp_path / "log.csv")
