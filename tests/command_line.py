"""Runs the command line as a user does, in this process: arguments in, exit status and output back."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import typer.main

from gpcorrect.cli import main
from gpcorrect.cli.app import app
from gpcorrect.logs import write_log
from gpcorrect.types import CalibrationLog


@dataclass(frozen=True)
class Outcome:
    """What a command did."""

    code: int
    out: str
    err: str

    @property
    def said(self) -> str:
        """What it told the user, however the lines were broken."""
        return " ".join(self.err.split())

    @property
    def json(self) -> Any:
        """Standard output as JSON."""
        return json.loads(self.out)


class Program:
    """The commands of the program, for tests that parse without running."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, ...], Any] = {(): typer.main.get_command(app)}

    def command(self, *path: str) -> Any:
        """Return the command of a path of names; an unknown one is a usage error."""
        if path not in self._known:
            group = self.command(*path[:-1])
            self._known[path] = group.resolve_command(typer.Context(group), [path[-1]])[1]
        return self._known[path]

    def walk(self, *path: str) -> Iterator[tuple[str, ...]]:
        """All paths of names below a path."""
        command = self.command(*path)
        for name in command.list_commands(typer.Context(command)) if hasattr(command, "commands") else ():
            yield (*path, name)
            yield from self.walk(*path, name)

    def parse(self, words: Sequence[str]) -> None:
        """Parse the words after `gpcorrect` without running the command; what it does not take is a usage error."""
        path: tuple[str, ...] = ()
        rest = list(words)
        while hasattr(self.command(*path), "commands"):
            path = (*path, rest.pop(0))
        self.command(*path).make_context(path[-1], rest)


PROGRAM = Program()


def exit_status(*words: object) -> int:
    """Call `gpcorrect` with words, as from a shell, and return its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["gpcorrect", *map(str, words)])
        with pytest.raises(SystemExit) as stopped:
            main()
    code = stopped.value.code
    return code if isinstance(code, int) else 0


@dataclass(frozen=True)
class CommandLine:
    """Calls `gpcorrect` with words, and hears what it says."""

    capfd: pytest.CaptureFixture[str]

    def __call__(self, *words: object) -> Outcome:
        self.capfd.readouterr()
        code = exit_status(*words)
        output = self.capfd.readouterr()
        return Outcome(code, output.out, output.err)


def assert_refused(outcome: Outcome, *words: str) -> None:
    """Exit status 2, one message that holds the words and says what to do, and no traceback."""
    assert outcome.code == 2, outcome.err
    assert "Traceback" not in outcome.err
    for word in words:
        assert word in outcome.said, outcome.said


def written(log: CalibrationLog, path: Path) -> Path:
    """Write the log and return the path."""
    write_log(log, path)
    return path
