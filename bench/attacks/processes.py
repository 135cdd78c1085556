"""Processes that are forked, clients that other threads close, models whose compiled code panics."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import suppress

from service_bench import PATIENT, free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import Program
from gpcorrect.calibration import load
from gpcorrect_service import CorrectionClient, ServiceError

ALLOWED = 10.0  # s for what has timeouts of 1 s, on a busy machine
FORKED = """
import os, sys, time
from gpcorrect_service import CorrectionClient, ServiceError
end, pose = sys.argv[1], [float(number) for number in sys.argv[2:]]
old = CorrectionClient(end, timeout=1.0, connect_timeout=1.0)
old.correct(pose)
if not os.fork():
    for client in (old, CorrectionClient(end, timeout=1.0, connect_timeout=1.0)):
        try:
            client.correct(pose)
        except ServiceError:
            pass
        print("came back", flush=True)
    sys.exit(0)
os.wait()
"""
PANICS = """
import sys
from gpcorrect.calibration import CommandCorrector
from gpcorrect.cli import main
correct = CommandCorrector.correct
def panicking(model, pose, *more):
    if pose[0] == 0.123:
        raise BaseException("a panic of compiled code")
    return correct(model, pose, *more)
CommandCorrector.correct = panicking
main()
"""
PANICKED = 20  # questions at which the model panics: more than there are workers
CLOSED = 40  # clients, each closed while three threads ask by it
JOINED = 5.0  # s in which a thread must hear that its client was closed


def forked_clients(lab: Lab) -> Seen:
    """Ask in a forked child, with the parent's client and with a new one."""
    pose = [repr(float(number)) for number in load(lab.model).check_queries[0, :7]]
    with lab.server(lab.model) as (end, _):
        asking = subprocess.Popen([sys.executable, "-c", FORKED, end, *pose], stdout=subprocess.PIPE, text=True)
        try:
            text, _ = asking.communicate(timeout=ALLOWED)
            ended = True
        except subprocess.TimeoutExpired:
            asking.kill()
            text, ended = "", False
    came = text.count("came back")
    return Seen(3, 3 - came - ended, f"{came} of 2 came back, the child {'ended' if ended else 'hung'}")


def panics(lab: Lab) -> Seen:
    """Have a server's model raise what is no Exception, more often than there are workers; others must be answered."""
    good, end, refused = load(lab.model).check_queries[0, :7], free_endpoint(), 0
    words = [sys.executable, "-c", PANICS, "serve", str(lab.model), "--endpoint", end]
    with (
        Program(words, lab.folder / "panics.log", "serving"),
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as client,
    ):
        for _ in range(PANICKED):
            with suppress(ServiceError):
                client.correct([0.123, *good[1:]])
                refused += 1  # it was to panic
            try:
                client.correct(good)
            except ServiceError:
                refused += 1
        refused += client.health().state != "ENABLED"
    return Seen(2 * PANICKED + 1, refused)


def closed_clients(lab: Lab) -> Seen:
    """Close clients while threads ask by them: every thread hears NO_SERVICE, and closing itself raises nothing."""
    pose, heard = load(lab.model).check_queries[0, :7], Counter[str]()

    def _ask(client: CorrectionClient) -> None:
        try:
            while True:
                client.correct(pose)
        except BaseException as error:  # noqa: BLE001  # whatever it is, it is counted
            heard[getattr(error, "status", type(error).__name__)] += 1

    with lab.server(lab.model) as (end, _):
        for k in range(CLOSED):
            client = CorrectionClient(end, timeout=1.0, connect_timeout=PATIENT)
            client.correct(pose)
            asking = [threading.Thread(target=_ask, args=(client,), daemon=True) for _ in range(3)]
            for thread in asking:
                thread.start()
            time.sleep(0.01 + 0.0007 * (k % 17))
            try:
                client.close()
            except RuntimeError as error:
                heard[f"closing: {error}"] += 1
            for thread in asking:
                thread.join(JOINED)
    wrong = 3 * CLOSED - heard.pop("NO_SERVICE", 0) + sum(n for what, n in heard.items() if what.startswith("closing"))
    return Seen(3 * CLOSED, wrong, f"{dict(heard)}")


SCENARIOS = (
    Scenario("clients after os.fork", "calls that hang", forked_clients),
    Scenario("panics of a model", "workers lost, others refused", panics),
    Scenario("clients closed by other threads", "raw errors, threads that hang", closed_clients),
)
