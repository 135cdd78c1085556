"""What people type: commands that do not exist, outputs that are there already, Ctrl-C at any moment."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import ENDS, accepted

MOMENTS = (0.2, 0.4, 0.7, 1.1, 1.6, 2.2)  # s after the start


def commands(lab: Lab) -> Seen:
    """Give commands that cannot be meant, or would destroy a recording: each ends with status 2."""
    there = lab.folder / "there.csv"
    there.write_text("precious")
    with lab.arm() as (end, _):
        at = ("--endpoint", end)
        tried: list[Sequence[str]] = [
            ("robot", "operate", "foo", *at),
            ("robot", "record", "-o", str(there), "--seconds", "1", *at),
            ("robot", "record", "-o", "/proc/run.csv", "--seconds", "60", *at),
            ("robot", "record", "-o", str(lab.folder / "run.txt"), "--seconds", "60", *at),
            ("serve", str(lab.joint_model), "--endpoint", free_endpoint()),
        ]
        wrong = accepted(tried) + (there.read_text() != "precious")
    return Seen(len(tried) + 1, wrong)


def interrupts(lab: Lab) -> Seen:
    """Press Ctrl-C in the first seconds of commands."""
    end = ("--endpoint", free_endpoint())
    tried = [("serve", str(lab.model), *end), ("sim", "serve", *end), ("robot", "state", *end), ("doctor", *end)]
    with ThreadPoolExecutor(2) as pool:
        wrong = sum(pool.map(_interrupted, tried * len(MOMENTS), sorted(MOMENTS * len(tried))))
    return Seen(len(tried) * len(MOMENTS), wrong)


def _interrupted(words: Sequence[str], moment: float) -> bool:
    """Whether a command ends with a traceback, or not at all."""
    command = [sys.executable, "-m", "gpcorrect", *words]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    time.sleep(moment)
    process.send_signal(signal.SIGINT)
    try:
        _, text = process.communicate(timeout=ENDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return True
    return "Traceback" in text


SCENARIOS = (
    Scenario("commands that cannot be meant", "obeyed, or ended by a traceback", commands),
    Scenario("Ctrl-C in the first seconds", "tracebacks and hangs", interrupts),
)
