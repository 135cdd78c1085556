"""Runs the command line as a user does, in this process: arguments in, exit status and output back."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from gpcorrect.cli import main
from gpcorrect.logs import write_log
from gpcorrect.types import CalibrationLog


@dataclass(frozen=True)
class Outcome:
    """What a command did."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as JSON."""
        return json.loads(self.out)


class CommandLine:
    """Calls `gpcorrect` with words, as from a shell."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch = monkeypatch
        self._capfd = capfd

    def __call__(self, *words: object) -> Outcome:
        self._monkeypatch.setattr(sys, "argv", ["gpcorrect", *(str(word) for word in words)])
        self._capfd.readouterr()
        with pytest.raises(SystemExit) as stopped:
            main()
        output = self._capfd.readouterr()
        code = stopped.value.code
        return Outcome(code if isinstance(code, int) else 0, output.out, output.err)


def assert_refused(outcome: Outcome, *words: str) -> None:
    """Exit status 2, one message that holds the words and says what to do, and no traceback."""
    assert outcome.code == 2, outcome.err
    assert "Traceback" not in outcome.err
    said = " ".join(outcome.err.split())
    for word in words:
        assert word in said, said


def written(log: CalibrationLog, path: Path) -> Path:
    """Write the log and return the path."""
    write_log(log, path)
    return path
