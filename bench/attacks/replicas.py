"""Servers of one arm that hold different models."""

from __future__ import annotations

import os
import signal
import time
from itertools import pairwise

import numpy as np
from service_bench import PATIENT

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import ran, waited
from attacks.watching import page
from gpcorrect.calibration import load
from gpcorrect.types import PoseSignal
from gpcorrect_service import CorrectionClient, ServiceError

RATE = 200.0  # Hz
SECONDS = 6.0
NEAR = 1e-9  # m


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


def announced(lab: Lab) -> Seen:
    """Ask doctor and monitor about two servers with different models: whether they say so."""
    with lab.server(lab.model) as (one, _), lab.server(lab.other_model) as (other, _):
        _, text = ran(["doctor", "--endpoint", one, "--endpoint", other])
        with page(lab, one, other) as ask:
            arm = waited(lambda: next((arm for arm in ask()["arms"] if len(arm["replicas"]) == 2), None))
    return Seen(2, ("different models" not in text) + (not arm["models_differ"]))


def lost_server(lab: Lab) -> Seen:
    """Kill the only server of planners that chose the fallback, one of which was answered before."""
    poses = load(lab.model).check_queries[:, :7]
    registered = load(lab.model).rigid.apply(PoseSignal(poses[:, :3], poses[:, 3:])).position
    with (
        lab.server(lab.model) as (end, pid),
        CorrectionClient(end, timeout=1.0, connect_timeout=PATIENT, on_failure="identity") as client,
    ):
        client.correct(poses[0])
        os.kill(pid, signal.SIGKILL)
        jumps = [_off(client, pose, there) for pose, there in zip(poses, registered, strict=True)]
        with CorrectionClient(end, timeout=1.0, connect_timeout=0.5, on_failure="identity") as late:
            jumps.append(_off(late, poses[0], registered[0]))
    return Seen(len(jumps), sum(jump > NEAR for jump in jumps), f"up to {1e3 * max(jumps):.3f} mm off")


def _off(client: CorrectionClient, pose: np.ndarray, registered: np.ndarray) -> float:
    """Return how far a fallback is from the registered pose, m; 0 where it is an error."""
    try:
        return float(np.linalg.norm(client.correct(pose).position - registered))
    except ServiceError:
        return 0.0


SCENARIOS = (
    Scenario("two models announced", "doctor or monitor that do not say so", announced),
    Scenario("two replicas, two models, one hangs", "changes of model in a stream", mixed_stream),
    Scenario("fallback of a planner without a server", "commands off the registered pose", lost_server),
)
