"""Other processes of this program, started for as long as a command needs them."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gpcorrect.cli.console import err
from gpcorrect.errors import GpCorrectError

__all__ = ["free_endpoint", "running"]

STOPPING = 20.0  # s


def free_endpoint() -> str:
    """Return a loopback address that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def running(*words: str, log: Path | None = None) -> Iterator[None]:
    """Run `gpcorrect WORDS` in another process until the block ends; what it logs goes to a file, or nowhere.

    Raises
    ------
    GpCorrectError
        It ends at once, as where its address is taken.
    """
    command = [sys.executable, "-m", "gpcorrect", *words]
    target = subprocess.DEVNULL if log is None else log.open("w")
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=target)
    if not isinstance(target, int):
        target.close()
    try:
        _check_alive(process, words)
        yield
    finally:
        process.terminate()
        try:
            process.wait(STOPPING)
        except subprocess.TimeoutExpired:
            err.print(f"[yellow]note:[/] gpcorrect {words[0]} did not stop in time and was killed")
            process.kill()


def _check_alive(process: subprocess.Popen[bytes], words: tuple[str, ...]) -> None:
    time.sleep(0.2)
    if process.poll() is not None:
        raise GpCorrectError(
            f"`gpcorrect {' '.join(words)}` ended at once with status {process.returncode}.",
            hint="Run it yourself to see why.",
        )
