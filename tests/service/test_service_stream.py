"""The live stream of joints over zenoh: robot state in, estimates out."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from queue import Empty, SimpleQueue

import numpy as np
import pytest
import zenoh
from service_support import PATIENT, SLACK, ServerProcess, hang, server_process, stranger, wait_for

from gpcorrect_service.protocol.answer import EstimateAnswer
from gpcorrect_service.protocol.messages import MSGPACK, JointState

CODEC = MSGPACK


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    with server_process("joints", stream_max_age=PATIENT) as process:  # whatever else the machine does
        yield process


def test_a_thousand_samples_in_a_thousand_estimates_out(server: ServerProcess) -> None:
    """Every sample that does not wait long is answered, in order, as the model answers the path."""
    samples: SimpleQueue[zenoh.Sample] = SimpleQueue()
    rng = np.random.default_rng(2)
    path = np.cumsum(0.01 * rng.standard_normal((1000, 3)), axis=0)
    with stranger(server.endpoint) as session:
        listening = session.declare_subscriber(
            "gpcorrect/arm1/estimate", zenoh.handlers.Callback(samples.put, indirect=False)
        )
        publisher = session.declare_publisher("gpcorrect/arm1/measured_js")
        result: list[EstimateAnswer] = []
        with listening, publisher:
            wait_for(lambda: bool(publisher.matching_status.matching) and listens(session, samples))
            stamps = (time.monotonic() + 0.001 * np.arange(len(path))).tolist()
            for i, q in enumerate(path.tolist()):
                state = JointState(stamps[i], tuple(q))
                publisher.put(CODEC.encode(state), encoding=CODEC.encoding("joint_state"))
                if i % 20 == 19:  # no more than that are under way: zenoh drops samples that nobody takes off its hands
                    result += [next_of(samples) for _ in range(20)]
    assert [one.stamp for one in result] == stamps
    assert {one.status for one in result} == {"OK"}
    joints = path[0]
    for q, one in zip(path, result, strict=True):
        joints = np.clip(joints, q - SLACK, q + SLACK)
        np.testing.assert_allclose(one.joints, joints, atol=1e-12)
    with server.client() as client:
        assert sum(client.health().counts["estimate"].values()) > len(path)


def test_old_samples_that_others_wait_behind_move_the_slack_alone() -> None:
    """Of what came in while a server was stopped the newest is answered, from the slack of all that came before."""
    samples: SimpleQueue[zenoh.Sample] = SimpleQueue()
    path = np.concatenate([np.linspace(0.0, 0.2, 150), np.linspace(0.2, 0.19, 50)])
    with server_process("joints") as process, stranger(process.endpoint) as session, process.client() as client:
        callback = zenoh.handlers.Callback(samples.put, indirect=False)
        block = zenoh.CongestionControl.BLOCK
        publisher = session.declare_publisher("gpcorrect/arm1/measured_js", congestion_control=block)
        with session.declare_subscriber("gpcorrect/arm1/estimate", callback), publisher:
            wait_for(lambda: listens(session, samples))
            before = client.health().counts["estimate"]
            assert process.process.pid is not None
            hang(process.process.pid)
            for q in path.tolist():
                state = JointState(time.monotonic(), (q,) * 3)
                publisher.put(CODEC.encode(state), encoding=CODEC.encoding("joint_state"))
            time.sleep(0.1)
            os.kill(process.process.pid, signal.SIGCONT)
            while (newest := next_of(samples)).stamp != state.stamp:
                pass
            counts = client.health().counts["estimate"]
    assert newest.joints == pytest.approx([0.2 - SLACK] * 3)
    assert counts["SKIPPED"] > 0
    assert sum(counts.values()) - sum(before.values()) == len(path)


def listens(session: zenoh.Session, samples: SimpleQueue[zenoh.Sample]) -> bool:
    """Send a sample of another session; whether its estimate comes back, so that none of the test's is lost."""
    state = JointState(time.monotonic(), (0.0,) * 3, session=9)
    session.put("gpcorrect/arm1/measured_js", CODEC.encode(state), encoding=CODEC.encoding("joint_state"))
    try:
        return read(samples.get(timeout=0.1)).session == 9
    except Empty:
        return False


def next_of(samples: SimpleQueue[zenoh.Sample]) -> EstimateAnswer:
    """Return the next estimate of the test's own session."""
    while (result := read(samples.get(timeout=PATIENT))).session != 0:
        pass
    return result


def read(sample: zenoh.Sample) -> EstimateAnswer:
    assert str(sample.encoding) == CODEC.encoding("estimate")
    return CODEC.decode(EstimateAnswer, sample.payload.to_bytes())


def test_joints_are_corrected_through_the_client(server: ServerProcess) -> None:
    """A path of joints comes back with slack, NaN where a number was missing, and the joint model named."""
    q = np.array([[0.0] * 3, [0.1] * 3, [np.nan, 0.1, 0.1]])
    with server.client(path_timeout=PATIENT) as client:
        reply = client.correct_joints(q, [0.0, 0.1, 0.2], efforts=np.zeros((3, 3)), sessions=[0, 0, 0])
        health = client.health()
    np.testing.assert_allclose(reply.joints[:2], [[0.0] * 3, [0.1 - SLACK] * 3], atol=1e-12)
    assert np.isnan(reply.joints[2]).all()
    assert reply.status == ("OK", "OK", "MISSING")
    assert reply.meta.model_id == health.joint_model_id == "lagging"


def test_joints_fall_back_to_themselves(server: ServerProcess) -> None:
    """Without a server of that name, a client that chose identity gets its joints back, flagged."""
    q = np.array([[0.1, 0.2, 0.05]])
    with server.client(arm="arm9", on_failure="identity", path_timeout=0.1, connect_timeout=0.2) as client:
        reply = client.correct_joints(q, [0.0])
    np.testing.assert_array_equal(reply.joints, q)
    assert (reply.fallback, reply.status) == ("identity", ("NO_SERVICE",))
