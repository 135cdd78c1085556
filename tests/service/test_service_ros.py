"""CDR in and out, what no PoseStamped says in the attachment, and the numbers that monitors read."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from service_support import POSE, SHIFT, ShiftCorrector, ask_bare, called, server_process, stranger
from service_support import STAMPED as ASKED

from gpcorrect.correction import Reason
from gpcorrect_service import ServerSettings, ServiceError
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.metrics import OPENMETRICS, Counters
from gpcorrect_service.protocol import ros
from gpcorrect_service.protocol.answer import PathAnswer
from gpcorrect_service.protocol.bounds import CorrectionBound
from gpcorrect_service.protocol.messages import JSON, CorrectPathRequest, ErrorAnswer, RequestMeta
from gpcorrect_service.protocol.ros import (
    CDR_ENCODING,
    CORRECT,
    StampedPose,
    attachment,
    read_pose,
    rmw_key,
    ros_types,
    write_pose,
)
from gpcorrect_service.server.handlers import Corrections, Health
from gpcorrect_service.server.models import Active, Model
from gpcorrect_service.server.requests import Clock, Request, RequestParser, Response

NOW = 100.0


def ask(payload: bytes, bound: CorrectionBound | None = None, *, frame: str = "", **meta: Any) -> Response:
    active = Active(Model(ShiftCorrector(), id="m", hash="h"))
    clock = Clock(monotonic=lambda: NOW, wall=lambda: 1e9)
    settings = ServerSettings(replica="r1", bound=bound or CorrectionBound(), frame=frame)
    parser = RequestParser(active, settings, open_logger(io.StringIO()), clock)
    attachment = JSON.encode(RequestMeta(**meta)) if meta else b""
    correct = Corrections(parser).handlers()["correct"]
    return correct(Request(payload, CDR_ENCODING, attachment, NOW - 0.2))


def test_a_pose_stamped_comes_back_corrected() -> None:
    """A ROS pose comes back with its stamp, in the frame of commands; the spread and the model travel beside it."""
    answer = ask(write_pose(ASKED), request_id="q1")
    result = read_pose(answer.payload)
    beside = json.loads(answer.attachment)
    np.testing.assert_allclose(result.pose, [*(POSE[:3] + SHIFT), *POSE[3:]], atol=1e-15)
    assert (result.sec, result.nanosec, result.frame_id) == (12, 34, "base")
    assert (answer.encoding, answer.status) == (CDR_ENCODING, "OK")
    assert tuple(beside[name] for name in ("request_id", "model_id", "in_domain", "std")) == (
        "q1",
        "m",
        True,
        [1e-3] * 3 + [None] * 3,
    )


def test_a_frame_may_have_another_name() -> None:
    """Where the operator names the tracker's frame as ROS does, poses under that name are answered."""
    assert ask(write_pose(replace(ASKED, frame_id="/polaris")), frame="polaris").status == "OK"
    assert ask(write_pose(replace(ASKED, frame_id=""))).status == "OK"


def test_the_messages_of_ros_are_read() -> None:
    """What rosbags' own types serialise is what is read, quaternion order included."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    t = store.types
    message = t["geometry_msgs/msg/PoseStamped"](
        header=t["std_msgs/msg/Header"](stamp=t["builtin_interfaces/msg/Time"](sec=5, nanosec=6), frame_id="base_link"),
        pose=t["geometry_msgs/msg/Pose"](
            position=t["geometry_msgs/msg/Point"](x=1.0, y=2.0, z=3.0),
            orientation=t["geometry_msgs/msg/Quaternion"](x=0.1, y=0.2, z=0.3, w=0.9),
        ),
    )
    data = bytes(store.serialize_cdr(message, "geometry_msgs/msg/PoseStamped"))
    assert read_pose(data) == StampedPose((1.0, 2.0, 3.0, 0.9, 0.1, 0.2, 0.3), 5, 6, "base_link")


@pytest.mark.parametrize(
    ("payload", "meta", "status"),
    [
        (write_pose(StampedPose(tuple(POSE), 0, 0, "")), {}, "BAD_INPUT"),
        (write_pose(StampedPose((np.nan, *POSE[1:]), 1, 0, "")), {}, "BAD_INPUT"),
        (write_pose(StampedPose((*POSE[:3], 0.0, 0.0, 0.0, 0.0), 1, 0, "")), {}, "BAD_INPUT"),
        (b"", {}, "BAD_INPUT"),
        (write_pose(ASKED)[:40], {}, "BAD_INPUT"),
        (write_pose(ASKED), {"deadline": 0.1}, "STALE"),
        (write_pose(replace(ASKED, frame_id="base")), {}, "BAD_INPUT"),
        (write_pose(ASKED), {"frame": "polaris"}, "BAD_INPUT"),
    ],
    ids=["stamp 0", "nan", "quaternion 0", "empty", "cut", "stale", "frame", "other name"],
)
def test_refusals_are_in_json(payload: bytes, meta: dict[str, Any], status: str) -> None:
    """Bad CDR, stamp 0 and expired requests are refused as others are; in JSON, for CDR has no word for it."""
    answer = ask(payload, **meta)
    assert answer.is_error
    assert JSON.decode(ErrorAnswer, answer.payload).status == status


@given(data=st.binary(max_size=200))
def test_random_bytes_are_bad_input(data: bytes) -> None:
    """Random bytes are a pose by luck or BAD_INPUT, never another error."""
    try:
        assert len(read_pose(data).pose) == 7
    except ServiceError as error:
        assert error.status == "BAD_INPUT"  # noqa: PT017 - either outcome is lawful


def test_the_operators_bound_acts_and_says_so() -> None:
    """A correction beyond the operator's bound leaves shortened, LIMITED, with the reason."""
    answer = ask(write_pose(ASKED), CorrectionBound(position=1e-3))
    beside = json.loads(answer.attachment)
    moved = np.array(read_pose(answer.payload).pose[:3]) - POSE[:3]
    assert np.linalg.norm(moved) == pytest.approx(1e-3)
    np.testing.assert_allclose(moved / np.linalg.norm(moved), SHIFT / np.linalg.norm(SHIFT))
    assert (beside["status"], beside["reason"]) == ("LIMITED", Reason.BOUNDED.text)


def test_the_bound_holds_along_a_path() -> None:
    """On a path every row is bounded alike, and those that were cut say so."""
    active = Active(Model(ShiftCorrector()))
    settings = ServerSettings(bound=CorrectionBound(position=1e-3))
    parser = RequestParser(active, settings, open_logger(io.StringIO()), Clock())
    body = JSON.encode(CorrectPathRequest((tuple(POSE), tuple(POSE)), (0.0, 0.1)))
    request = Request(body, JSON.encoding("correct_path"), b"", NOW)
    corrections = Corrections(parser)
    answer = corrections.handlers()["correct_path"](request)
    path = JSON.decode(PathAnswer, answer.payload)
    away = np.linalg.norm(np.array(path.position) - POSE[:3], axis=1)
    np.testing.assert_allclose(away, 1e-3)
    assert path.status == ["LIMITED"] * 2


def test_metrics_are_openmetrics_and_count_what_was_answered() -> None:
    """A monitor's own parser reads the text; counts, buckets, share out of domain and state are those of the server."""
    counters = Counters()
    for seconds in (1e-4, 3e-4, 2.0):
        counters.add("correct", "OK", seconds, rows=1)
    counters.add("correct", "BAD_INPUT", 1e-4)
    counters.add("correct", "DROPPED", None)
    counters.add("correct_path", "EXTRAPOLATING", 1e-2, rows=100, outside=7)
    active = Active(Model(ShiftCorrector(), id="m", hash="h"))
    parser = RequestParser(active, ServerSettings(replica="r1"), open_logger(io.StringIO()), Clock(lambda: NOW))
    answer = Health(parser, counters, {}).handlers()["metrics"](Request(b"", "", b"", NOW))
    samples = {
        (s.name, *sorted(s.labels.items())): s.value
        for family in text_string_to_metric_families(answer.payload.decode())
        for s in family.samples
    }
    assert answer.encoding == OPENMETRICS
    assert samples["gpcorrect_answers_total", ("key", "correct"), ("status", "OK")] == 3
    assert samples["gpcorrect_latency_seconds_bucket", ("key", "correct"), ("le", "0.0002")] == 2
    assert samples["gpcorrect_latency_seconds_bucket", ("key", "correct"), ("le", "+Inf")] == 4
    assert samples["gpcorrect_latency_seconds_count", ("key", "correct")] == 4  # what was dropped took no time
    assert samples["gpcorrect_poses_total", ("key", "correct")] == 3  # and a refusal answers no pose
    assert samples["gpcorrect_poses_total", ("key", "correct_path")] == 100
    assert samples["gpcorrect_out_of_domain_total", ("key", "correct_path")] == 7
    assert samples["gpcorrect_state", ("state", "ENABLED")] == 1
    assert samples["gpcorrect_state", ("state", "FAULT")] == 0


def test_a_services_hash_is_that_of_ros() -> None:
    """RIHS01 of example_interfaces/srv/AddTwoInts is what the design document of rmw_zenoh shows for it."""
    store = ros_types()
    ros._register_service(store, "example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n---\nint64 sum\n")
    published = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
    assert store.hash_rihs01("example_interfaces/srv/AddTwoInts") == published


def test_a_ros_node_of_humble_is_answered_over_the_network() -> None:
    """Its question comes back corrected with the number and sender that it came with; refusals are answers too."""
    with server_process(ros_domain=3, ros_distro="humble") as server, stranger(server.endpoint) as session:
        key = rmw_key(3, "arm1/correct", CORRECT, "humble")
        answers = []
        for payload in (called(), called(sec=0, nanosec=0), b"nonsense"):
            (reply,) = ask_bare(session, key, payload, attachment=attachment(7, 1, b"g" * 16))
            assert reply.ok.attachment.to_bytes()[:8] == (7).to_bytes(8, "little")
            assert reply.ok.attachment.to_bytes()[-16:] == b"g" * 16
            answers.append(ros.decode_cdr(reply.ok.payload.to_bytes(), f"{CORRECT}_Response"))
        tokens = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/3/**")]
    good, stampless, nonsense = answers
    p = good.command.pose.position
    np.testing.assert_allclose([p.x, p.y, p.z], POSE[:3] + SHIFT, atol=1e-15)
    assert (good.success, good.status, good.in_domain, good.std[0]) == (True, "OK", True, 1e-3)
    assert (good.command.header.stamp.sec, good.command.header.frame_id) == (12, "base")
    assert good.model_hash == b"shift".hex()
    for refused in (stampless, nonsense):
        assert (refused.success, refused.status) == (False, "BAD_INPUT")
        assert np.isnan(refused.command.pose.position.x)
    assert "stamp" in stampless.message
    assert sum("/NN/" in token for token in tokens) == sum("/SS/" in token for token in tokens) == 1
