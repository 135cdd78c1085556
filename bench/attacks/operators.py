"""What people type: commands that do not exist, outputs that are there already, Ctrl-C at any moment."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import ENDS, accepted
from gpcorrect_service.crtk import Bus, BusSettings, JointState
from gpcorrect_service.crtk.messages import OperatingState

DOF = 6
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


def lost(lab: Lab) -> Seen:
    """Command an arm whose commands and complaints all get lost: each tool ends in words, none waits for ever."""
    path = lab.folder / "there.csv"
    columns = ["time", "trajectory", *(f"setpoint_jp_{joint}" for joint in range(1, 4))]
    path.write_text("\n".join([",".join(columns), *(f"{0.1 * i},0,{0.01 * i},1.0,0.3" for i in range(30))]))
    with _deaf_arm() as end:
        at = ("--endpoint", end)
        tried: list[Sequence[str]] = [
            ("robot", "operate", "pause", *at),
            ("robot", "goto", "10,80,350,0,0,0", *at),
            ("robot", "follow", str(path), *at),
            ("robot", "random", *at),
            ("collect", "zigzag", "-o", str(lab.folder / "zigzags"), *at),
        ]
        wrong = accepted(tried)
    return Seen(len(tried), wrong)


@contextmanager
def _deaf_arm() -> Iterator[str]:
    """Publish the states of an arm that is enabled, homed and at rest, and hear nothing; gives its address."""
    end, stop = free_endpoint(), threading.Event()
    with Bus(BusSettings(end, role="hub")) as bus:

        def _publish() -> None:
            while not stop.wait(0.02):
                now = time.monotonic()
                for name in ("setpoint_js", "measured_js"):
                    bus.publish(name, JointState(now, (0.0,) * DOF))
                bus.publish("operating_state", OperatingState(now, "ENABLED", is_homed=True, is_busy=False))

        thread = threading.Thread(target=_publish)
        thread.start()
        try:
            yield end
        finally:
            stop.set()
            thread.join()


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
    Scenario("commands and complaints that get lost", "waited for without end, or taken for obeyed", lost),
    Scenario("Ctrl-C in the first seconds", "tracebacks and hangs", interrupts),
)
