"""Recordings parsed: whatever a parser raises becomes words; compiled ones run apart, in bounded memory and time.

Compiled libraries crash, loop for ever or ask for all memory on some damaged bytes. In a process of its own none of it
reaches the program that reads; and as every recording has one, nothing reaches the recording that is read next. These
processes are forked from one that has loaded the libraries, which takes half a second, and has read nothing.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from gpcorrect import errors
from gpcorrect.codec import pack, unpack
from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs.columns import ReadSettings

T = TypeVar("T")

Order = tuple[bytes, tuple[str, ...], str, int, int]
"""What is read, the libraries for it, the file for the answer, and the seconds and bytes that it may take."""

PATIENCE = 8.0  # s of processor time for a small file, start included; a sound one takes less than one
PACE = 1e5  # bytes/s beyond that; chosen by hand, for compressed bags, whose messages are unpacked one by one
WAITING = 20.0  # times the processor time that reading may take on a machine that has other work too
MEMORY = 1 << 30  # bytes for a small file; the libraries themselves take 0.2 GB
EXPANSION = 100
"""bytes of memory for each byte of the file beyond that; chosen by hand: packed 10:1, then 10 times as numbers."""
# For files that may have been damaged on their way.
COPY = "Copy it again from where it was recorded."
FRUGAL = {"ARROW_DEFAULT_MEMORY_POOL": "system", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""So that libraries set no memory aside: Arrow's own pool begins with 1 GB, a thread of linear algebra with 32 MB."""


def parse(title: str, read: Callable[[Path, ReadSettings], T], path: Path, settings: ReadSettings) -> T:
    """Read a recording; damaged bytes make parsers raise whatever they stumble over, which becomes a LogError.

    Parameters
    ----------
    title : str
    read : callable, from path and settings to what is wanted of the recording
    path, settings : see :func:`gpcorrect.logs.read_log`
    """
    try:
        return read(path, settings)
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
    return LogError(f"the {title} file cannot be read, it may be damaged or cut off: {what}.", hint=COPY)


def _too_large(title: str) -> LogError:
    hint = "It may be damaged or forged; a sound one is read when saved without compression, or in parts."
    return LogError(f"the {title} file asks for more memory than a file of its size may.", hint=hint)


def parse_apart(
    kind: type[T],
    title: str,
    read: Callable[[Path, ReadSettings], T],
    path: Path,
    settings: ReadSettings,
    libraries: Sequence[str] = (),
) -> T:
    """Do what :func:`parse` does in a process of its own, in memory and time bounded by the file's size.

    Parameters
    ----------
    kind : type, what `read` returns: a dataclass that :func:`gpcorrect.codec.pack` takes apart
    title, read, path, settings : as for :func:`parse`; `read` can be pickled
    libraries : sequence of str, modules that the reader needs, loaded once; one that is not installed is left out
    """
    parts = path.rglob("*") if path.is_dir() else [path]
    size = sum(part.stat().st_size for part in parts)
    seconds, memory = int(PATIENCE + size / PACE), MEMORY + EXPANSION * size
    with tempfile.NamedTemporaryFile() as answer:
        work = pickle.dumps((title, read, path.absolute(), settings))
        status = _FORKER.run((work, tuple(libraries), answer.name, seconds, memory))
        if status in (-signal.SIGXCPU, -signal.SIGKILL):
            raise LogError(f"the {title} file is damaged: reading it did not end within {seconds} s.", hint=COPY)
        answer.seek(0)
        try:
            with np.load(answer, allow_pickle=False) as stored:
                header = json.loads(stored["header"].tobytes())
                arrays = {name: stored[f"array{k}"] for k, name in enumerate(header["arrays"])}
        except Exception as error:  # what a process that crashed left behind
            raise LogError(
                f"the {title} file is damaged: it crashed its reader (status {status}).", hint=COPY
            ) from error
    if "error" in header:
        error_kind = getattr(errors, header["error"])
        raised: GpCorrectError = error_kind.__new__(error_kind, header["state"]["message"])
        vars(raised).update(header["state"])
        raise raised
    return unpack(kind, header["found"], arrays)


class _Forker(threading.local):
    """The process that forks for each recording that this thread reads; started with the first, and again once gone."""

    process: subprocess.Popen[bytes] | None = None
    owner = 0

    def run(self, order: Order) -> int:
        """Have a recording read; return the exit status of who did, negative where a signal ended it."""
        for _ in range(2):  # somebody may have ended the process since the last recording
            process = self._running()
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                pickle.dump(order, process.stdin)
                process.stdin.flush()
                if status := process.stdout.readline():
                    return int(status)
            except BrokenPipeError:
                pass
            except BaseException:  # interrupted: its answer must not be taken for the next one
                self._end()
                raise
            self._end()
        return -signal.SIGKILL

    def _running(self) -> subprocess.Popen[bytes]:
        if self.process is None or self.owner != os.getpid():  # a fork of this program has a process of its own
            places = os.pathsep.join(place or os.getcwd() for place in sys.path)
            self.process, self.owner = (
                subprocess.Popen(
                    [sys.executable, "-P", "-m", __name__],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    env={**os.environ, "PYTHONPATH": places, **FRUGAL},
                ),
                os.getpid(),
            )
        return self.process

    def _end(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None


_FORKER = _Forker()


def main() -> None:
    """Fork for each recording that standard input names, and write to standard output how that ended."""
    statuses = os.dup(1)
    os.dup2(2, 1)  # what libraries print is no status
    while True:
        try:
            order: Order = pickle.load(sys.stdin.buffer)  # noqa: S301  # from the process that started this one
        except EOFError:
            return
        work, libraries, answer, seconds, memory = order
        for library in libraries:
            with suppress(ImportError):
                import_module(library)
        task = pickle.loads(work)  # noqa: S301  # here, so that its reader's module is loaded once
        child = os.fork()
        if child == 0:
            _in_child(task, answer, seconds, memory)
        signal.signal(signal.SIGALRM, lambda *_, child=child: os.kill(child, signal.SIGKILL))
        signal.alarm(int(WAITING * seconds))
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        signal.alarm(0)
        os.write(statuses, b"%d\n" % status)


def _in_child(task: tuple[Any, ...], answer: str, seconds: int, memory: int) -> NoReturn:
    status = 1
    try:
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        with suppress(ImportError, ValueError, OSError):  # where the system has no such limits, or lower ones
            import resource

            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
            resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
        _read_into(answer, *task)
        status = 0
    finally:
        os._exit(status)


def _read_into(answer: str, title: str, read: Callable[..., Any], path: Path, settings: ReadSettings) -> None:
    """Write what is wanted of a recording, or why it cannot be read, as npz."""
    arrays: dict[str, Any] = {}
    try:
        found, arrays = pack(parse(title, read, path, settings), "found")
        header = {"found": found}
    except OSError as error:
        header = _refusal(LogError(f"cannot be read: {error.strerror or error}."))
    except GpCorrectError as error:
        header = _refusal(error)
    except MemoryError:
        header = _refusal(_too_large(title))
    text = json.dumps({**header, "arrays": list(arrays)}).encode()
    contents: dict[str, Any] = {f"array{k}": array for k, array in enumerate(arrays.values())}
    with Path(answer).open("wb") as out:
        np.savez(out, header=np.frombuffer(text, dtype=np.uint8), **contents)


def _refusal(error: GpCorrectError) -> dict[str, Any]:
    return {"error": type(error).__name__, "state": vars(error)}


if __name__ == "__main__":
    main()
