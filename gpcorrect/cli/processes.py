"""Processes: others of this program that a command needs for a while, and the end of this one."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from gpcorrect.cli import end_within_import
from gpcorrect.cli.console import note
from gpcorrect.errors import GpCorrectError

BORN = 0.2  # s, after which a process that could not start has ended; chosen by hand
STOPPING = 20.0  # s for a process to end before it is killed; chosen by hand


def free_endpoint() -> str:
    """Return a loopback address that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def running(*words: str) -> Iterator[None]:
    """Run `gpcorrect WORDS` in another process until the block ends; what it prints goes nowhere.

    Parameters
    ----------
    *words : str, command and options; GpCorrectError where it ends at once, as where its address is taken
    """
    command = [sys.executable, "-m", "gpcorrect", *words]
    nowhere = subprocess.DEVNULL
    process = subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere)
    try:
        time.sleep(BORN)
        if process.poll() is not None:
            cause = f"`gpcorrect {' '.join(words)}` ended at once with status {process.returncode}."
            raise GpCorrectError(cause, hint="Run it yourself to see why.")
        yield
    finally:
        process.terminate()
        try:
            process.wait(STOPPING)
        except subprocess.TimeoutExpired:
            note(f"gpcorrect {words[0]} did not stop in time and was killed")
            process.kill()


def end_as_interrupted() -> None:
    """Let SIGTERM and a closed terminal do what Ctrl-C does: what was recorded until then is written."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if number == signal.SIGTERM or signal.getsignal(number) != signal.SIG_IGN:  # as nohup has it
            signal.signal(number, signal.getsignal(signal.SIGINT))


def stop_signal() -> threading.Event:
    """Return an event that Ctrl-C, SIGTERM and a terminal that is closed set; a second one ends the process.

    To be called in the main thread, before a command reads its libraries and files: Ctrl-C meanwhile is an end too.
    """
    stop = threading.Event()

    def _stop(number: int, frame: FrameType | None) -> None:
        end_within_import(frame)
        if stop.is_set():
            os._exit(128 + number)
        stop.set()

    signal.signal(signal.SIGINT, _stop)
    end_as_interrupted()
    return stop
