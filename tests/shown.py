"""Runs what a page shows, line by line, as a reader would copy it into a shell."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from support import ROOT

UNTIL_STOPPED = re.compile(r"gpcorrect (serve|monitor|prefilter|router|sim serve)\b")
RUNNING = re.compile("stop with Ctrl-C")
PATIENCE = 600.0  # s for a command: only a test that fails waits this long
FILE = re.compile(r'```\w+ title="(?P<name>[^"]+)"\n(?P<text>.*?)```', re.DOTALL)
COMMANDS = re.compile(r"(?:^ {4}(?:gpcorrect|python|pip|curl|make) .*\n)+", re.MULTILINE)


@dataclass(frozen=True)
class Ran:
    """A command of a page, what it printed, and how many seconds it took."""

    command: str
    printed: str
    seconds: float


def section(page: str, title: str) -> str:
    """Text of a section of a page."""
    return (ROOT / page).read_text().split(f"## {title}", 1)[1].partition("\n")[2].split("\n## ", 1)[0] + "\n"


def run_shown(text: str, folder: Path) -> list[Ran]:
    """Write the titled files of a text and run its indented lines, in their order, in a folder; servers until the end.

    A command that fails ends it with an AssertionError that holds what was printed.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "COLUMNS": "200"}
    if not (folder / "examples").exists():
        (folder / "examples").symlink_to(ROOT / "examples")
    ran = []
    with ExitStack() as servers:
        for name, line in _steps(text):
            if name:
                (folder / name).write_text(line)
                continue
            begun = time.monotonic()
            if UNTIL_STOPPED.match(line):
                printed = _start(line, folder, environment, servers)
            else:
                done = subprocess.run(
                    ["bash", "-c", line],
                    cwd=folder,
                    env=environment,
                    capture_output=True,
                    text=True,
                    timeout=PATIENCE,
                    check=False,
                )
                printed = done.stdout + done.stderr
                assert done.returncode == 0, f"$ {line}\n{printed}"
            ran.append(Ran(line, printed, time.monotonic() - begun))
    return ran


def _steps(text: str) -> Iterator[tuple[str, str]]:
    """Name and text of a file, or an empty name and a command, in their order."""
    found = [(m.start(), [(m["name"], m["text"])]) for m in FILE.finditer(text)]
    fenced = [(m.start(), m.end()) for m in re.finditer(r"```.*?```", text, re.DOTALL)]
    for block in COMMANDS.finditer(text):
        if not any(start <= block.start() < end for start, end in fenced):
            found.append((block.start(), [("", line[4:]) for line in block[0].splitlines()]))
    for _, steps in sorted(found):
        yield from steps


def _start(line: str, folder: Path, environment: dict[str, str], servers: ExitStack) -> str:
    """Start what runs until it is stopped, and wait until it says so."""
    log = folder / f"server-{len(list(folder.glob('server-*')))}.txt"
    with log.open("w") as stream:
        server = subprocess.Popen(
            ["bash", "-c", f"exec {line}"], cwd=folder, env=environment, stdout=stream, stderr=stream
        )
    servers.callback(server.wait, timeout=30)
    servers.callback(server.terminate)
    until = time.monotonic() + PATIENCE
    while not RUNNING.search(log.read_text()):
        assert server.poll() is None, f"$ {line}\n{log.read_text()}"
        assert time.monotonic() < until, f"$ {line}\n{log.read_text()}"
        time.sleep(0.1)
    return log.read_text()
