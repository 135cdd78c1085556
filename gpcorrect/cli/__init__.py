"""The command line: one file a command, and the only place that prints."""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType

__all__ = ["end_within_import", "main"]

INTERRUPTED = 130  # exit status, as shells have it


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, while libraries are still read too."""
    if threading.current_thread() is not threading.main_thread():
        _run()
        return
    before = signal.signal(signal.SIGINT, _interrupted)
    try:
        _run()
    finally:
        signal.signal(signal.SIGINT, before)


def _run() -> None:
    from gpcorrect.cli.app import main as run  # takes half a second, in which Ctrl-C may come

    run()


def _interrupted(number: int, frame: FrameType | None) -> None:
    end_within_import(frame)
    raise KeyboardInterrupt


def end_within_import(frame: FrameType | None) -> None:
    """End the process where a library is being read: libraries make other errors and hangs of an interrupt.

    Parameters
    ----------
    frame : frame, where the interrupt came
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            os.write(2, b"stopped\n")
            os._exit(INTERRUPTED)
        frame = frame.f_back
