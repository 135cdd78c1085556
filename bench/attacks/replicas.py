"""Servers of one arm that hold different models."""

from __future__ import annotations

import os
import signal
import time
from itertools import pairwise

import numpy as np
from service_bench import PATIENT

from attacks.lab import Lab, Scenario, Seen
from gpcorrect.calibration import load
from gpcorrect_service import CorrectionClient, ServiceError

RATE = 200.0  # Hz
SECONDS = 6.0


def mixed_stream(lab: Lab) -> Seen:
    """Ask two servers with different models for one stream, while the one that answered hangs."""
    pose = load(lab.model).check_queries[0, :7]
    hashes: list[str] = []
    positions: list[np.ndarray] = []
    refused = 0
    with (
        lab.server(lab.model) as (one, first),
        lab.server(lab.other_model) as (other, second),
        CorrectionClient((one, other), timeout=0.2, connect_timeout=PATIENT) as client,
    ):
        began, victim, replica = time.monotonic(), 0, ""
        while (now := time.monotonic()) < began + SECONDS:
            if now > began + SECONDS / 3 and not victim:
                victim = first if str(first) in replica else second
                os.kill(victim, signal.SIGSTOP)
            try:
                reply = client.correct(pose)
            except ServiceError:
                refused += 1
                continue
            replica = reply.meta.replica
            hashes.append(reply.meta.model_hash)
            positions.append(reply.position)
            time.sleep(max(0.0, 1.0 / RATE - (time.monotonic() - now)))
        os.kill(victim, signal.SIGCONT)
    switches = sum(one != other for one, other in pairwise(hashes))
    apart = 1e3 * float(np.linalg.norm(np.ptp(np.array(positions), axis=0)))
    return Seen(len(hashes), switches, f"commands up to {apart:.1f} mm apart, {refused} refused")


SCENARIOS = (Scenario("two replicas, two models, one hangs", "changes of model in a stream", mixed_stream),)
