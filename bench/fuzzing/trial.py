"""Trials in a process of their own: what came of each, or how it failed."""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import traceback
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

MOST_SECONDS = 10.0  # of processor time
MOST_BYTES = 1 << 30  # resident, beyond what the process had before
LIMIT_BYTES = 4 << 30  # of data: what asks for more gets a MemoryError
WAIT = 300.0  # s until a trial that takes no processor time counts as hanging
FAULTS = ("traceback", "crash", "hang", "memory")

Work = Callable[[int], tuple[str, str]]
"""Does trial k, and returns a word for what came of it, and particulars."""


@dataclass(frozen=True)
class Trial:
    """What came of a trial: a word of the work itself, or one of :data:`FAULTS`; and particulars."""

    number: int
    outcome: str
    said: str = ""
    seconds: float = 0.0
    grown: int = 0


def tried(work: Work, count: int) -> Iterator[Trial]:
    """Do trials 0 to count - 1 in a forked process, and in another one after each that fails."""
    number = 0
    while number < count:
        for trial in _until_a_fault(work, number, count):
            yield trial
            number = trial.number + 1


def _until_a_fault(work: Work, start: int, count: int) -> Iterator[Trial]:
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read_end)
        _in_child(work, start, count, write_end)
    os.close(write_end)
    number, fault = start, False
    with os.fdopen(read_end, "rb") as pipe:
        while select.select([pipe], [], [], WAIT)[0] and (line := pipe.readline()):
            trial = Trial(**json.loads(line))
            number, fault = trial.number + 1, trial.outcome in FAULTS
            yield trial
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if number < count and not fault:
        ended = os.WIFSIGNALED(status) and os.WTERMSIG(status) not in (signal.SIGKILL, signal.SIGXCPU)
        yield Trial(number, "crash" if ended else "hang", f"status {status}")


def _in_child(work: Work, start: int, count: int, out: int) -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (LIMIT_BYTES, LIMIT_BYTES))
    for number in range(start, count):
        before, most = _seconds(), _largest()
        resource.setrlimit(resource.RLIMIT_CPU, (int(before + 2 * MOST_SECONDS), resource.RLIM_INFINITY))
        try:
            outcome, said = work(number)
        except MemoryError as error:
            outcome, said = "memory", repr(error)
        except BaseException:  # noqa: BLE001  # whatever comes through is what is looked for
            outcome, said = "traceback", traceback.format_exc()
        seconds, grown = _seconds() - before, _largest() - most
        if outcome not in FAULTS:
            outcome = "hang" if seconds > MOST_SECONDS else "memory" if grown > MOST_BYTES else outcome
        trial = Trial(number, outcome, said[-3000:], seconds, grown)
        os.write(out, json.dumps(asdict(trial)).encode() + b"\n")
        if outcome in FAULTS:
            break
    os._exit(0)


def _seconds() -> float:
    """Processor time of this process: one that reads apart has a limit of its own, and counts only when it ends."""
    used = os.times()
    return used.user + used.system


def _largest() -> int:
    """Bytes that this process, or the largest it waited for, ever had."""
    return 1024 * max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
