"""One planner among others: what it asks must not stop those that ask well."""

from __future__ import annotations

import json
import time
from contextlib import suppress

import numpy as np
from service_bench import PATIENT, free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import waited
from gpcorrect.calibration import JointCorrector, load
from gpcorrect_service import ClientSettings, CorrectionClient, ServiceError
from gpcorrect_service.protocol.messages import JSON
from gpcorrect_service.protocol.ros import CDR_ENCODING, StampedPose, write_pose
from gpcorrect_service.protocol.sessions import open_client

FAR = 4.9999  # m: just within what is believed
DIRECTIONS = 60


def far_poses(lab: Lab) -> Seen:
    """Ask poses at the edge of what is believed, in all directions, and after each a good one."""
    rng = np.random.default_rng(0)
    good = load(lab.model).check_queries[0, :7]
    refused, blamed = 0, 0
    with (
        lab.server(lab.model) as (end, _),
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as bad,
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as well,
    ):
        for _ in range(DIRECTIONS):
            way = rng.standard_normal(3)
            try:
                bad.correct([*(FAR * way / np.linalg.norm(way)), 1.0, 0.0, 0.0, 0.0])
            except ServiceError as error:
                blamed += error.status == "INTERNAL"
        for _ in range(DIRECTIONS):
            with suppress(ServiceError):
                well.correct(good)
                continue
            refused += 1
        state = well.health().state
    return Seen(DIRECTIONS, refused + blamed, f"{blamed} blamed on the model, {refused} others refused, state {state}")


def foreign_frames(lab: Lab) -> Seen:
    """Ask in CDR for poses that say they are in another frame than the model's."""
    good = load(lab.model).check_queries[0, :7]
    answered = 0
    frames = ("base", "world", "camera")
    with lab.server(lab.model) as (end, _), open_client(ClientSettings((end,))) as session:
        querier = session.declare_querier("arm1/correct", timeout=2.0)
        for frame in frames:
            payload = write_pose(StampedPose(tuple(good.tolist()), 1, 0, frame))
            replies = waited(lambda payload=payload: list(querier.get(payload=payload, encoding=CDR_ENCODING)))
            answered += any(reply.ok is not None for reply in replies)
    return Seen(len(frames), answered)


def unknown_region(lab: Lab) -> Seen:
    """Ask a strict server for poses half a metre away from all that was learned."""
    poses = load(lab.model).check_queries[:, :7] + np.array([0.5, 0.5, 0.5, 0, 0, 0, 0])
    answered = 0
    with (
        lab.server(lab.model, "--strict") as (end, _),
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as client,
    ):
        for pose in poses:
            with suppress(ServiceError):
                client.correct(pose)
                answered += 1
    return Seen(len(poses), answered)


def sessions(lab: Lab) -> Seen:
    """Ask about joints, and stream them, with session numbers that 64 bits do not hold."""
    width, end = len(load(lab.joint_model, JointCorrector).types), free_endpoint()
    row, numbers = [0.0] * width, (2**63, -(2**63) - 1, 2**64, 10**30)
    with (
        lab.program("serve", "--joints", str(lab.joint_model), "--endpoint", end, ready="serving"),
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as client,
        open_client(ClientSettings((end,))) as session,
    ):
        querier = session.declare_querier("arm1/correct_joints", timeout=2.0)
        for k, number in enumerate(numbers):
            path = {"q": [row, row], "times": [0.0, 0.1], "efforts": [row, row], "sessions": [0, number]}
            waited(lambda path=path: list(querier.get(payload=json.dumps(path), encoding=JSON.media_type)))
            state = {"stamp": 100.0 + k, "position": row, "effort": row, "session": number}
            session.put("arm1/measured_js", json.dumps(state), encoding=JSON.encoding("joint_state"))
        time.sleep(1.0)
        counts = client.health().counts
    blamed = [counts.get(kind, {}).get("BAD_INPUT", 0) for kind in ("correct_joints", "estimate")]
    return Seen(2 * len(numbers), 2 * len(numbers) - sum(blamed), f"{counts}")


SCENARIOS = (
    Scenario("poses at 4.9999 m", "faults of the model, others refused", far_poses),
    Scenario("ROS poses in another frame", "answers", foreign_frames),
    Scenario("strict server, unknown region", "answers", unknown_region),
    Scenario("sessions beyond 64 bits", "not BAD_INPUT", sessions),
)
