"""ROS 2 as another implementation of rmw_zenoh speaks it: zenoh-ros2-sdk, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.resources import files
from importlib.util import find_spec

import numpy as np
import pytest
from crtk_support import (
    PATIENCE_OF_ANOTHER,
    SHIFT,
    ShiftCorrector,
    free_endpoint,
    living_arm,
    model,
    wait_for,
)

from gpcorrect_service import ServerSettings
from gpcorrect_service.crtk.robot import Robot
from gpcorrect_service.protocol.ros import CORRECT, ros_types
from gpcorrect_service.server.service import Server

pytestmark = pytest.mark.skipif(
    find_spec("zenoh_ros2_sdk") is None, reason="zenoh-ros2-sdk is not installed (pip install zenoh-ros2-sdk)"
)
TIME = "int32 sec\nuint32 nanosec\n"
HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
DEFINITIONS = {
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    ),
    "crtk_msgs/msg/OperatingState": "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
}
NESTED = {
    "std_msgs/msg/Header": HEADER,
    "builtin_interfaces/msg/Time": TIME,
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
}

CALL_NESTED = {
    **{name: NESTED[name] for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header")},
    **{name: NESTED[name] for name in ("geometry_msgs/msg/Point", "geometry_msgs/msg/Quaternion")},
    "geometry_msgs/msg/Pose": NESTED["geometry_msgs/msg/Pose"],
    "geometry_msgs/msg/PoseStamped": DEFINITIONS["geometry_msgs/msg/PoseStamped"],
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
}

NODE = """
import json, os, sys, time, traceback
import numpy as np
sys.excepthook = lambda *error: (traceback.print_exception(*error), os._exit(1))  # its threads would keep it alive
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession

port, (hashes, definitions, nested) = int(sys.argv[1]), map(json.loads, sys.argv[2:])
session = ZenohSession.get_instance("127.0.0.1", port)
for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header"):
    session.register_message_type(nested[name], name)
JOINTS, STATE = "sensor_msgs/msg/JointState", "crtk_msgs/msg/OperatingState"
heard = {}
def options(kind):
    return {"msg_definition": definitions[kind], "type_hash": hashes[kind], "domain_id": 5, "router_port": port}
ROS2Subscriber("/arm1/measured_js", JOINTS, lambda m: heard.__setitem__("joints", m), **options(JOINTS))
latched = QosProfile(durability=QosDurability.TRANSIENT_LOCAL)
ROS2Subscriber("/arm1/operating_state", STATE, lambda m: heard.__setitem__("state", m), qos=latched, **options(STATE))
until = time.monotonic() + 60
while len(heard) < 2:
    time.sleep(0.05)
    if time.monotonic() > until:
        print("heard only", *heard, file=sys.stderr, flush=True)
        os._exit(1)
joints, state = heard["joints"], heard["state"]
goal = np.array(joints.position) + np.eye(len(joints.position))[0] * 0.01
empty = np.empty(0)
mover = ROS2Publisher("/arm1/move_jp", JOINTS, **options(JOINTS))
time.sleep(0.5)
mover.publish(header=joints.header, name=list(joints.name), position=goal, velocity=empty, effort=empty)
print(json.dumps({"state": state.state, "homed": bool(state.is_homed), "goal": goal.tolist()}), flush=True)
time.sleep(2.0)
os._exit(0)
"""


CALLER = """
import json, os, sys, traceback
sys.excepthook = lambda *error: (traceback.print_exception(*error), os._exit(1))  # its threads would keep it alive
from zenoh_ros2_sdk import ROS2ServiceClient
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.utils import compute_service_type_hash

KIND = "gpcorrect_msgs/srv/Correct"
port, text, nested, pose = int(sys.argv[1]), sys.argv[2], *map(json.loads, sys.argv[3:])
session = ZenohSession.get_instance("127.0.0.1", port)
kinds = {name: session.register_message_type(definition, name) for name, definition in nested.items()}
def make(name, *fields):
    return kinds[name](*fields)
asked, answered = text.split("---")
type_hash = compute_service_type_hash(KIND, asked, answered, nested)
client = ROS2ServiceClient(
    "/arm1/correct", KIND, asked, answered, domain_id=5, router_port=port, type_hash=type_hash, timeout=60.0
)
x, y, z, qw, qx, qy, qz = pose
vector = make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
header = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 12, 34), "tracker")
body = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", x, y, z),
            make("geometry_msgs/msg/Quaternion", qx, qy, qz, qw))
answer = client.call(desired=make("geometry_msgs/msg/PoseStamped", header, body),
                     twist=make("geometry_msgs/msg/Twist", vector, vector), with_twist=True)
p = answer.command.pose.position
print(json.dumps({"success": bool(answer.success), "status": answer.status, "position": [p.x, p.y, p.z],
                  "std": list(answer.std), "hash": client.type_hash}), flush=True)
os._exit(0)
"""


def test_a_ros_node_asks_for_a_correction() -> None:
    """Its client finds the service by the hash that it computes from the .srv file, and hears the command."""
    text = files("gpcorrect_service").joinpath("ros", *f"{CORRECT}.srv".split("/")).read_text()
    settings = ServerSettings(endpoint=free_endpoint(), ros_domain=5)
    with Server(model(ShiftCorrector()), settings):
        port = settings.endpoint.rpartition(":")[2]
        pose = [0.1, 0.02, -0.11, 1.0, 0.0, 0.0, 0.0]
        words = [sys.executable, "-c", CALLER, port, text, json.dumps(CALL_NESTED), json.dumps(pose)]
        node = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_OF_ANOTHER, check=False)
    assert node.returncode == 0, node.stderr
    found = json.loads(node.stdout.splitlines()[-1])
    assert found["hash"] == ros_types().hash_rihs01(CORRECT)
    assert (found["success"], found["status"]) == (True, "OK")
    np.testing.assert_allclose(found["position"], np.array(pose[:3]) + SHIFT, atol=1e-15)


def test_hashes_of_types_are_those_of_another_implementation() -> None:
    """RIHS01 of the types that an arm speaks, by rosbags and by zenoh-ros2-sdk from the definitions' text."""
    from zenoh_ros2_sdk.utils import get_type_hash

    for name, text in DEFINITIONS.items():
        assert get_type_hash(name, msg_definition=text, dependencies=NESTED) == ros_types().hash_rihs01(name)


@pytest.mark.parametrize("distro", ["humble", "jazzy"])
def test_a_ros_node_sees_the_arm_and_drives_it(distro: str) -> None:
    """It hears joints, and the state that was published before it came; its JointState on move_jp moves the arm."""
    hashes = {
        name: "TypeHashNotSupported" if distro == "humble" else ros_types().hash_rihs01(name) for name in DEFINITIONS
    }
    with living_arm(ros_domain=5, ros_distro=distro) as (settings, arm), Robot(settings) as robot:
        robot.make_ready()
        port = settings.endpoint.rpartition(":")[2]
        words = [sys.executable, "-c", NODE, port, *map(json.dumps, (hashes, DEFINITIONS, NESTED))]
        node = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_OF_ANOTHER, check=False)
        assert node.returncode == 0, node.stderr
        found = json.loads(node.stdout.splitlines()[-1])
        assert (found["state"], found["homed"]) == ("ENABLED", True)
        wait_for(lambda: bool(np.abs(arm.setpoint - np.array(found["goal"])).max() < 1e-9))
