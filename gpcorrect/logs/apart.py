"""Recordings parsed: whatever a parser raises becomes words; compiled ones run apart, in bounded memory and time.

Compiled libraries crash, loop for ever or ask for all memory on some damaged bytes. In a process of its own none of it
reaches the program that reads; and as every recording has one, nothing reaches the recording that is read next.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from gpcorrect import errors
from gpcorrect.codec import pack, unpack
from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.mocap.take import Take, log_of
from gpcorrect.types import CalibrationLog

__all__ = ["Reader", "damage_named", "parse", "parse_apart"]

Reader = Callable[[Path, ReadSettings], CalibrationLog | Take]
"""What reads a format, from path and settings: into a log, or what cameras saw, where the tool is still to be chosen.

It raises a LogError where the file is damaged, cut off, too large or of another layout, and a MissingExtraError where
the library that reads it is not installed."""

PATIENCE = 8.0
"""s of processor time for a small file, start included; a sound one takes less than one."""
PACE = 1e5
"""bytes/s beyond that; chosen by hand, for compressed bags, whose messages are unpacked one by one."""
WAITING = 20.0
"""Times the processor time that reading may take on a machine that has other work too."""
MEMORY = 1 << 30
"""bytes for a small file; the libraries themselves take 0.2 GB."""
EXPANSION = 100
"""bytes of memory for each byte of the file beyond that; chosen by hand: packed 10:1, then 10 times as numbers."""
FRUGAL = {"ARROW_DEFAULT_MEMORY_POOL": "system", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""So that libraries set no memory aside: Arrow's own pool begins with 1 GB, a thread of linear algebra with 32 MB."""


def parse(title: str, read: Reader, path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a recording; damaged bytes make parsers raise whatever they stumble over, which becomes a LogError.

    Parameters
    ----------
    title : str
        Name of the format.
    read : callable
        Its reader.
    path, settings
        See :func:`gpcorrect.logs.read_log`.

    Raises
    ------
    GpCorrectError
        What the reader itself says, or that the file may be damaged.
    OSError
        The file cannot be read.
    """
    with damage_named(title):
        found = read(path, settings)
        return log_of(found, settings.columns.mocap) if isinstance(found, Take) else found


@contextmanager
def damage_named(title: str) -> Iterator[None]:
    """Turn whatever a parser raises on damaged bytes into a LogError; errors in words pass.

    Parameters
    ----------
    title : str
        Name of the format.
    """
    try:
        yield
    except GpCorrectError:
        raise
    except OSError as error:
        if error.errno is not None:  # of the system; libraries raise it without a number on damaged bytes
            raise
        raise _damaged(title, error) from error
    except MemoryError as error:
        raise _too_large(title) from error
    except Exception as error:
        raise _damaged(title, error) from error


def _damaged(title: str, error: Exception) -> LogError:
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return LogError(f"the {title} file cannot be read, it may be damaged or cut off: {what}.")


def _too_large(title: str) -> LogError:
    hint = "It may be damaged or forged; a sound one is read when saved without compression, or in parts."
    return LogError(f"the {title} file asks for more memory than a file of its size may.", hint=hint)


def parse_apart(title: str, read: Reader, path: Path, settings: ReadSettings) -> CalibrationLog:
    """Do what :func:`parse` does in a process of its own, in memory and time bounded by the file's size.

    Parameters
    ----------
    title, read, path, settings
        As for :func:`parse`.

    Raises
    ------
    GpCorrectError
        Likewise; or the process crashed, or did not come to an end.
    """
    parts = path.rglob("*") if path.is_dir() else [path]
    size = sum(part.stat().st_size for part in parts)
    seconds, memory = int(PATIENCE + size / PACE), MEMORY + EXPANSION * size
    with tempfile.TemporaryFile() as answer:
        status = _run(pickle.dumps((title, read, path, settings)), answer, seconds, memory)
        if status in (-signal.SIGXCPU, -signal.SIGKILL):
            raise LogError(f"the {title} file is damaged: reading it did not end within {seconds} s.")
        answer.seek(0)
        try:
            header, arrays = _received(answer)
        except Exception as error:  # what a process that crashed left behind
            raise LogError(f"the {title} file is damaged: it crashed its reader (status {status}).") from error
    if "error" in header:
        kind = getattr(errors, header["error"])
        raised: GpCorrectError = kind.__new__(kind, header["state"]["message"])
        vars(raised).update(header["state"])
        raise raised
    return unpack(CalibrationLog, header["log"], arrays)


def _run(work: bytes, answer: IO[bytes], seconds: int, memory: int) -> int:
    """Start :func:`main` as a program of its own, and return its exit status: negative where a signal ended it."""
    places = os.pathsep.join(place or os.getcwd() for place in sys.path)
    try:
        return subprocess.run(
            [sys.executable, "-P", "-m", __name__, str(seconds), str(memory)],
            input=work,
            stdout=answer,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": places, **FRUGAL},
            timeout=WAITING * seconds,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return -signal.SIGKILL


def _received(answer: IO[bytes]) -> tuple[dict[str, Any], dict[str, Any]]:
    with np.load(answer, allow_pickle=False) as stored:
        header = json.loads(stored["header"].tobytes())
        return header, {name: stored[f"array{k}"] for k, name in enumerate(header["arrays"])}


def main(work: IO[bytes], seconds: int, memory: int) -> None:
    """Read the recording that `work` names, and write what it holds, or why not, to standard output as npz.

    Parameters
    ----------
    work : file
        What :func:`parse_apart` sends.
    seconds, memory : int
        Processor time and bytes that reading may take.
    """
    answer = os.dup(1)
    os.dup2(2, 1)  # what libraries print is no part of the answer
    _limit(seconds, memory)
    title, read, path, settings = pickle.load(work)  # noqa: S301  # from the process that started this one
    arrays: dict[str, Any] = {}
    try:
        log, arrays = pack(parse(title, read, path, settings), "log")
        header = {"log": log}
    except OSError as error:
        header = _refusal(LogError(f"cannot be read: {error.strerror or error}."))
    except GpCorrectError as error:
        header = _refusal(error)
    except MemoryError:
        header = _refusal(_too_large(title))
    text = json.dumps({**header, "arrays": list(arrays)}).encode()
    contents: dict[str, Any] = {f"array{k}": array for k, array in enumerate(arrays.values())}
    with os.fdopen(answer, "wb") as out:
        np.savez(out, header=np.frombuffer(text, dtype=np.uint8), **contents)


def _refusal(error: GpCorrectError) -> dict[str, Any]:
    return {"error": type(error).__name__, "state": vars(error)}


def _limit(seconds: int, memory: int) -> None:
    with suppress(ImportError, ValueError, OSError):  # where the system has no such limits, or lower ones
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))


if __name__ == "__main__":
    main(sys.stdin.buffer, int(sys.argv[1]), int(sys.argv[2]))
