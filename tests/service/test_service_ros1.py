"""The ROS 1 bridge beside Debian's rosmaster and rospy: each in a process of its own."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from service_support import PATIENT, POSE, SHIFT, free_port, server_process, wait_for
from support import ROOT

BRIDGE = ROOT / "examples" / "clients" / "ros1_bridge.py"
PYTHON = "/usr/bin/python3"  # that Debian's rospy belongs to
IMPORTS = "import rospy, geometry_msgs.msg, nav_msgs.msg, std_msgs.msg"
ASKER = """
import json, sys, threading
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import String

rospy.init_node("asker")
heard, came = {"reports": []}, threading.Event()
def hear(name, message):
    heard[name] = message
    came.set()
rospy.Subscriber("/gpcorrect/command", PoseStamped, lambda m: hear("command", m))
rospy.Subscriber("/gpcorrect/command_path", Path, lambda m: hear("path", m))
rospy.Subscriber("/gpcorrect/report", String, lambda m: (heard["reports"].append(json.loads(m.data)), came.set()))
one = rospy.Publisher("/gpcorrect/desired", PoseStamped, queue_size=1)
many = rospy.Publisher("/gpcorrect/desired_path", Path, queue_size=1)

def desired(x=0.1, frame="tracker", age=0.0):
    m = PoseStamped()
    m.header.frame_id, m.header.stamp = frame, rospy.Time.now() - rospy.Duration(age)
    p, q = m.pose.position, m.pose.orientation
    p.x, p.y, p.z, q.w = x, 0.02, -0.11, 1.0
    return m
def until(done, message=None, publisher=None):
    for _ in range(300):
        if done():
            return
        if publisher is not None:
            publisher.publish(message() if callable(message) else message)
        rospy.sleep(0.1)
    sys.exit("nothing came: %s" % heard)
def shown(pose):
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]

until(lambda: "command" in heard, desired, one)
until(lambda: many.get_num_connections() > 0)
path = Path()
path.header.frame_id, path.poses = "tracker", [desired(0.1 + 0.001 * k) for k in range(20)]
for k, pose in enumerate(path.poses):
    pose.header.stamp = rospy.Time(100 + 0.02 * k)
until(lambda: "path" in heard, path, many)
rospy.sleep(0.5)
found = {"frame": heard["command"].header.frame_id, "command": shown(heard["command"].pose)}
found["path"] = [shown(p.pose) for p in heard["path"].poses]
found["seconds"] = (heard["path"].poses[-1].header.stamp - heard["path"].poses[0].header.stamp).to_sec()
found["good"] = heard["reports"][-1]
del heard["command"]
for message in (desired(100.0), desired(frame="base"), desired(age=0.6)):
    heard["reports"] = []
    one.publish(message)
    until(lambda: heard["reports"])
    found.setdefault("refused", []).append(heard["reports"][0]["status"])
rospy.sleep(0.3)
found["commanded"] = "command" in heard
print(json.dumps(found))
"""


def has_rospy() -> bool:
    """Whether rosmaster and rospy with the messages are installed for the system's Python."""
    if shutil.which("rosmaster") is None or not Path(PYTHON).exists():
        return False
    return subprocess.run([PYTHON, "-c", IMPORTS], capture_output=True, check=False).returncode == 0


def answers(port: int) -> bool:
    """Whether something listens on a port of this machine."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def running(words: list[str], environment: dict[str, str], log: Path) -> Iterator[None]:
    """Run a program until the block ends."""
    with log.open("w") as said, subprocess.Popen(words, env=environment, stdout=said, stderr=said) as process:
        try:
            yield
        finally:
            process.kill()


@pytest.mark.skipif(not has_rospy(), reason="no ROS 1: apt-get install ros-core python3-rospy python3-nav-msgs")
def test_a_ros_1_node_is_corrected(tmp_path: Path) -> None:
    """Poses and paths come back corrected; what is in millimetres, another frame, or old gets a report, no command."""
    master = free_port()
    environment = os.environ | {
        "ROS_MASTER_URI": f"http://127.0.0.1:{master}", "ROS_IP": "127.0.0.1", "ROS_HOME": str(tmp_path),
    }  # fmt: skip
    with server_process() as server, ExitStack() as stack:
        stack.enter_context(running(["rosmaster", "--core", "-p", str(master)], environment, tmp_path / "master"))
        wait_for(lambda: answers(master))
        words = [PYTHON, str(BRIDGE), f"_python:={sys.executable}", f"_endpoint:={server.endpoint}", "_timeout:=2.0"]
        stack.enter_context(running(words, environment, tmp_path / "bridge"))
        asker = subprocess.run(
            [PYTHON, "-c", ASKER], env=environment, capture_output=True, text=True, timeout=3 * PATIENT, check=False
        )
    assert asker.returncode == 0, asker.stderr + (tmp_path / "bridge").read_text()
    found = json.loads(asker.stdout.splitlines()[-1])
    np.testing.assert_allclose(found["command"], [*(np.array(POSE[:3]) + SHIFT), *POSE[3:]], atol=1e-12)
    np.testing.assert_allclose(np.array(found["path"])[:, 0], 0.1 + 0.001 * np.arange(20) + SHIFT[0], atol=1e-12)
    assert found["seconds"] == pytest.approx(0.38)
    assert found["frame"] == "base"
    assert found["good"]["model_hash"] == b"shift".hex()
    assert found["refused"] == ["BAD_INPUT", "BAD_INPUT", "STALE"]
    assert not found["commanded"]
