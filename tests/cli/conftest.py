"""The small recording as a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import written
from support import small_log


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    return written(small_log(), tmp_path / "log.csv")
