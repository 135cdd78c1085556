"""The command line, and the small recording as a file, as fixtures."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_support import CommandLine, written
from support import small_log


@pytest.fixture
def gpcorrect(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(monkeypatch, capfd)


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    return written(small_log(), tmp_path / "log.csv")
