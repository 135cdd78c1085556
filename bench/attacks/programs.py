"""Programs of the project as processes that are killed, held and started again, with a date that can be set."""

from __future__ import annotations

import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from service_bench import PATIENT

ENDS = 30.0  # s that a command has to end by itself
FAREWELL = 10.0  # s that a program has to end when it is asked to
# The date alone, as an operator or a time server sets it: every wait goes by the kernel's monotonic clock. Debian's
# libfaketime 0.9.10 does not serve: it turns waits on the monotonic clock into errors (time.sleep of Python 3.11).
DATE = r"""
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
static volatile int64_t nothing, *offset = &nothing;
__attribute__((constructor)) static void begin(void) {
    const char *name = getenv("SOAK_CLOCK");
    int file = name ? open(name, O_RDONLY | O_CLOEXEC) : -1;
    void *page = file < 0 ? MAP_FAILED : mmap(0, 8, PROT_READ, MAP_SHARED, file, 0);
    if (page != MAP_FAILED) offset = page;
}
int clock_gettime(clockid_t id, struct timespec *now) {
    int failed = syscall(SYS_clock_gettime, id, now);
    if (!failed && (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE)) now->tv_sec += *offset;
    return failed;
}
int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    now->tv_sec = t.tv_sec;
    now->tv_usec = t.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *now) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    if (now) *now = t.tv_sec;
    return t.tv_sec;
}
"""


class SettableClock:
    """The date of one process, set while it runs; its monotonic clock stays.

    Parameters
    ----------
    folder : Path, for the library that every program loads before others, and this clock's offset
    name : str, of the clock
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._library = folder / "date.so"
        self._offset = folder / f"{name}.clock"
        self._offset.write_bytes(bytes(8))
        if not self._library.exists():
            source = folder / "date.c"
            source.write_text(DATE)
            subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", self._library, source], check=True)

    @staticmethod
    def missing() -> str:
        """Return why clocks cannot be set on this machine; empty where they can."""
        return "" if shutil.which("cc") else "no C compiler (cc) for the library that sets a process's date"

    @property
    def environment(self) -> dict[str, str]:
        """What a process must have in its environment for this to be its clock."""
        return {"LD_PRELOAD": str(self._library), "SOAK_CLOCK": str(self._offset)}

    def set(self, seconds: int) -> None:
        """Set the clock to so many seconds from the true date, at once.

        Parameters
        ----------
        seconds : int
        """
        with self._offset.open("r+b") as file:
            file.write(struct.pack("=q", seconds))


class Program:
    """One program: started, killed, held and started again; a context manager, which ends it however it was left.

    Parameters
    ----------
    command : sequence of str
    log : Path, gets standard output and error, of every start anew
    ready : str, text in its log by which it is known to answer; empty does not wait
    clock : SettableClock, optional, what it takes for the date
    folder : Path, optional, where it runs
    """

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        ready: str = "",
        clock: SettableClock | None = None,
        folder: Path | None = None,
    ) -> None:
        self._command, self._log, self._ready, self._folder = list(command), log, ready, folder
        self._environment = None if clock is None else {**os.environ, **clock.environment}
        self.clock = clock
        self.start()

    def start(self) -> None:
        """Start, and wait until it is ready."""
        with self._log.open("w") as stream:
            self.process = subprocess.Popen(
                self._command, stdout=stream, stderr=stream, env=self._environment, cwd=self._folder
            )
        try:
            if self._ready and waited(lambda: self._ready in self.log or self.ended) and self.ended:
                raise RuntimeError(f"{' '.join(self._command)} ended: {self.log}")
        except BaseException:
            self.stop()
            raise

    @property
    def log(self) -> str:
        """What it has written since it was started."""
        return self._log.read_text(errors="replace")

    @property
    def ended(self) -> bool:
        """Whether it runs no more."""
        return self.process.poll() is not None

    @property
    def pid(self) -> int:
        """Its number."""
        return self.process.pid

    def kill(self) -> None:
        """End it without a warning."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """Ask it to end, and kill it if it does not; return its exit status."""
        self.process.send_signal(signal.SIGCONT)
        self.process.terminate()
        try:
            return self.process.wait(FAREWELL)
        except subprocess.TimeoutExpired:
            self.kill()
            return self.process.returncode

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def ran(words: Sequence[str], begin: Callable[[], object] | None = None) -> tuple[int, str]:
    """Run `gpcorrect WORDS` to its end; return its exit status and all that it wrote.

    Parameters
    ----------
    words : sequence of str
    begin : callable, optional, what the process does before the program begins

    Raises
    ------
    subprocess.TimeoutExpired
        It did not end.
    """
    command = [sys.executable, "-m", "gpcorrect", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENT, check=False, preexec_fn=begin)
    return done.returncode, done.stdout + done.stderr


def refused(words: Sequence[str], begin: Callable[[], object] | None = None) -> bool:
    """Whether `gpcorrect WORDS` ends by itself, with status 2, saying what to do."""
    try:
        status, text = ran(words, begin)
    except subprocess.TimeoutExpired:
        return False
    return status == 2 and "Traceback" not in text and "try:" in text


def accepted(commands: Sequence[Sequence[str]]) -> int:
    """How many of several commands are not refused as :func:`refused` says; as many at once as there are cores."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return sum(not one for one in pool.map(refused, commands))


@contextmanager
def held(pid: int) -> Iterator[None]:
    """Stop a process for as long as the block lasts."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def waited(done: Callable[[], Any]) -> Any:
    """Return the first true answer."""
    until = time.monotonic() + PATIENT
    while not (found := done()):
        if time.monotonic() > until:
            raise TimeoutError("waited in vain")
        time.sleep(0.02)
    return found
