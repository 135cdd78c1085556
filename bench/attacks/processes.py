"""Processes that are forked, as multiprocessing does by itself on Linux."""

from __future__ import annotations

import subprocess
import sys

from attacks.lab import Lab, Scenario, Seen
from gpcorrect.calibration import load

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


SCENARIOS = (Scenario("clients after os.fork", "calls that hang", forked_clients),)
