from contextlib import suppress

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcorrect_service.crtk.bus import read_message
from gpcorrect_service.crtk.messages import TOPICS, JointState, OperatingState, Pose, Text, from_cdr, to_cdr
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.limits import checked_stamp
from gpcorrect_service.protocol.ros import RmwNode, attachment, rmw_key, ros_types

MESSAGES = [
    ("measured_js", JointState(1.5, (0.1, -0.2), (1.0, 2.0), (3.0, 4.0))),
    ("servo_jp", JointState(1.5, (0.1, -0.2))),
    ("tracker_cp", Pose(1234.25, (0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5), "tracker")),
    ("operating_state", OperatingState(2.0, "PAUSED", True, False)),
    ("error", Text(3.0, "why not")),
]


@pytest.mark.parametrize(("name", "message"), MESSAGES)
@pytest.mark.parametrize("encoding", ["application/msgpack", "application/json", "application/cdr", "zenoh/bytes"])
def test_messages_come_back_in_every_encoding(name, message, encoding):
    """What is written in MessagePack, JSON or CDR reads back as the same message; bytes without a name are CDR."""
    writers = {"application/msgpack": msgspec.msgpack.encode, "application/json": msgspec.json.encode}
    payload = writers.get(encoding, to_cdr)(message)
    assert read_message(payload, encoding, TOPICS[name]) == message


def test_ros_has_w_last():
    """A pose's quaternion is w x y z here and x y z w in the ROS message."""
    cdr = to_cdr(Pose(1.0, (1.0, 2.0, 3.0, 0.4, 0.1, 0.2, 0.3), "base"))
    ros = ros_types().deserialize_cdr(cdr, "geometry_msgs/msg/PoseStamped")
    q = ros.pose.orientation
    assert (q.x, q.y, q.z, q.w) == (0.1, 0.2, 0.3, 0.4)
    assert ros.header.frame_id == "base"


def test_cdr_of_another_program_is_read():
    """A JointState as rosbags writes it, with names and without efforts, is read to the numbers in it."""
    kinds = ros_types().types
    header = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](7, 250_000_000), "arm")
    ros = kinds["sensor_msgs/msg/JointState"](header, ["a", "b"], np.array([0.5, 0.25]), np.zeros(0), np.zeros(0))
    cdr = ros_types().serialize_cdr(ros, "sensor_msgs/msg/JointState")
    assert from_cdr(bytes(cdr), "sensor_msgs/msg/JointState") == JointState(7.25, (0.5, 0.25))


@settings(max_examples=200, deadline=None)
@given(data=st.binary(max_size=200), name=st.sampled_from(sorted(TOPICS)))
def test_bytes_that_are_no_message_are_refused(data, name):
    """Whatever bytes come, a message or a refusal is what becomes of them."""
    for encoding in ("application/msgpack", "application/json", "application/cdr", "image/png"):
        with suppress(ServiceError):
            assert isinstance(read_message(data, encoding, TOPICS[name]), TOPICS[name].form)


@pytest.mark.parametrize("stamp", [-1.0, float("nan"), float("inf"), 1.7e12, 1.7e18])
@pytest.mark.parametrize("encoding", ["application/msgpack", "application/json"])
def test_no_message_passes_whose_stamp_cannot_be_handed_on(encoding, stamp):
    """A pose in milliseconds was refused, and the refusal, with that stamp, could not be written for ROS."""
    if encoding.endswith("json"):
        payload = f'{{"stamp": {str(stamp).replace("inf", "1e999")}, "pose": [0, 0, 0, 1, 0, 0, 0]}}'.encode()
    else:
        payload = msgspec.msgpack.encode(Pose(stamp, (0, 0, 0, 1, 0, 0, 0)))
    with pytest.raises(ServiceError):
        read_message(payload, encoding, TOPICS["servo_cp"])


def test_a_message_may_say_no_time():
    said = Text(0.0, "enable")
    assert read_message(msgspec.json.encode(said), "application/json", TOPICS["state_command"]) == said


@pytest.mark.parametrize("stamp", [0.0, -1.0, float("nan"), float("inf"), 1.7e12, 1.7e18])
def test_a_stamp_says_when(stamp):
    with pytest.raises(ServiceError, match="stamp"):
        checked_stamp(stamp)


def test_keys_are_those_of_rmw_zenoh():
    """Domain, topic, type as DDS names it, and the RIHS01 hash that ROS 2 publishes for the type."""
    digest = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    expected = f"3/arm1/measured_js/sensor_msgs::msg::dds_::JointState_/{digest}"
    assert rmw_key(3, "/arm1/measured_js", "sensor_msgs/msg/JointState", "jazzy") == expected
    humble = rmw_key(3, "arm1/measured_js", "sensor_msgs/msg/JointState", "humble")
    assert humble == "3/arm1/measured_js/sensor_msgs::msg::dds_::JointState_/TypeHashNotSupported"


def test_attachments_are_33_bytes_as_rmw_zenoh_writes_them():
    """Number and time little-endian, the length of the sender's id, and the id."""
    gid = b"sixteen bytes id"
    data = attachment(7, 1_700_000_000_123_456_789, gid)
    assert len(data) == 33
    assert data[16] == 16
    assert int.from_bytes(data[:8], "little") == 7
    assert int.from_bytes(data[8:16], "little") == 1_700_000_000_123_456_789
    assert data[17:] == gid


def test_tokens_tell_the_graph_who_publishes_what():
    """A token names domain, session, kind, node, topic with its slashes replaced, and type."""
    node = RmwNode(0, "abc", "tester", "jazzy")
    parts = node.topic_token(4, "MP", "arm1/corrected/servo_cp", "geometry_msgs/msg/PoseStamped").split("/")
    assert parts[:9] == ["@ros2_lv", "0", "abc", "0", "4", "MP", "%", "%", "tester"]
    assert parts[9] == "%arm1%corrected%servo_cp"
    assert parts[10] == "geometry_msgs::msg::dds_::PoseStamped_"
