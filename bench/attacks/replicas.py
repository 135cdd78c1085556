"""Servers of one arm that hold different models, are bounded otherwise, or do not hear that the arm is paused."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from itertools import pairwise

import numpy as np
from service_bench import PATIENT, free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import held, ran, waited
from attacks.watching import page
from gpcorrect.calibration import ModelStore, load
from gpcorrect.types import PoseSignal
from gpcorrect_service import ClientSettings, CorrectionClient, ServiceError
from gpcorrect_service.client.operator import Operator

RATE = 200.0  # Hz
SECONDS = 6.0
NEAR = 1e-9  # m
LOOKS = 3.0  # s in which a server that wakes has looked into its store


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


def bounded_otherwise(lab: Lab) -> Seen:
    """Ask two servers with one model for one stream, of which one has bounds, while the one that answered hangs."""
    pose, mixed = load(lab.model).check_queries[0, :7], 0
    with (
        lab.server(lab.model, "--max-mm", "0.1") as (one, first),
        lab.server(lab.model) as (other, second),
        CorrectionClient((one, other), timeout=0.4, connect_timeout=PATIENT) as client,
    ):
        reply = client.correct(pose)
        with held(first if str(first) in reply.meta.replica else second):
            for _ in range(20):
                with suppress(ServiceError):
                    mixed += bool((client.correct(pose).position != reply.position).any())
    return Seen(20, mixed)


def paused(lab: Lab) -> Seen:
    """Pause an arm while one of its servers hangs, and start another one later: who corrects all the same."""
    pose, store = load(lab.model).check_queries[0, :7], lab.folder / "paused"
    folder = ModelStore(store)
    folder.activate(folder.add(lab.model, now=0.0))
    ends = [free_endpoint() for _ in range(3)]
    words = [["serve", "--store", str(store), "--endpoint", end] for end in ends]
    with lab.program(*words[0], ready="serving") as well, lab.program(*words[1], ready="serving") as hung:
        with Operator(ClientSettings(tuple(ends[:2]), connect_timeout=PATIENT), patience=3.0) as operator:
            waited(lambda: len(operator.models()) == 2)
            with held(hung.pid):
                quiet = _says_nothing(operator)
        time.sleep(LOOKS)
        with lab.program(*words[2], ready="serving"):
            answered = [_answers(end, pose) for end in ends]
        well.stop()
    return Seen(1 + len(ends), quiet + sum(answered))


def _says_nothing(operator: Operator) -> bool:
    try:
        operator.set_state("PAUSED")
    except ServiceError:
        return False
    return True


def _answers(end: str, pose: np.ndarray) -> bool:
    try:
        with CorrectionClient(end, timeout=1.0, connect_timeout=PATIENT) as client:
            client.correct(pose)
    except ServiceError as error:
        return "PAUSED" not in str(error)
    return True


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
    Scenario("one model, other bounds, one hangs", "commands within other bounds in a stream", bounded_otherwise),
    Scenario("a pause while one server hangs", "servers that go on, or silence about it", paused),
    Scenario("fallback of a planner without a server", "commands off the registered pose", lost_server),
)
