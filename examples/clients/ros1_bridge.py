#!/usr/bin/env python3
"""Corrections for ROS 1: poses and paths come in on topics, and go out as what to command instead.

A node for ROS's own Python (3.6 or newer), which needs rospy, geometry_msgs, nav_msgs and std_msgs and nothing of ours;
it asks through gpcorrect's client, which runs in gpcorrect's Python as this same file:

    ./ros1_bridge.py _python:=/opt/gpcorrect/bin/python _arm:=PSM1 _endpoint:=tcp/127.0.0.1:7449

    ~desired       geometry_msgs/PoseStamped  where the tool shall be, in the frame that the model was trained in
    ~desired_path  nav_msgs/Path              the same along a path, whose poses have increasing stamps
    ~command       geometry_msgs/PoseStamped  what to command instead, with the question's stamp, in the robot's frame
    ~command_path  nav_msgs/Path
    ~report        std_msgs/String            on every question, in JSON: status, interval, or why there is no command

What is refused, late or not understood gets a report and no command. A single pose has no velocity: models that look at
it take the arm to be at rest; send a path.

Parameters: ~python, ~arm, ~endpoint or ~config (of a secured site), ~frame (ROS's name of the frame of poses, where
the model has another), ~timeout (0.2 s for an answer), ~max_age (0.25 s that a pose's stamp may lie behind).
"""

import argparse
import json
import os
import subprocess
import sys
import threading
import time


def answer_lines(options):
    """Run in gpcorrect's Python: answer questions, a JSON object a line, until standard input ends."""
    import numpy as np

    from gpcorrect.errors import GpCorrectError
    from gpcorrect.plain import json_ready
    from gpcorrect_service import CorrectionClient, ServiceError

    frame, endpoint = options.pop("frame", ""), [options.pop("endpoint")] if "endpoint" in options else []
    with CorrectionClient(*endpoint, **options) as client:
        frames = {}
        for line in sys.stdin:
            asked = json.loads(line)
            try:
                frames = frames or client.model().info["frames"]
                if asked["frame"].strip("/") not in ("", frame, frames["input"]):
                    raise ServiceError("BAD_INPUT", f"poses are in {asked['frame']}, the model's in {frames['input']}.")
                one, times = "times" not in asked, asked.get("times")
                reply = client.correct(asked["poses"][0]) if one else client.correct_path(asked["poses"], times)
                answer = {
                    "status": reply.status, "reason": reply.reason, "in_domain": reply.in_domain,
                    "interval95": reply.interval95, "model_hash": reply.meta.model_hash,
                    "poses": np.atleast_2d(reply.pose), "frame": frames["output"],
                }  # fmt: skip
            except GpCorrectError as error:
                answer = {"status": getattr(error, "status", "BAD_INPUT"), "reason": str(error)}
            print(json.dumps(json_ready(answer)), flush=True)


class Bridge:
    """The node."""

    def __init__(self, rospy):
        from geometry_msgs.msg import PoseStamped
        from nav_msgs.msg import Path
        from std_msgs.msg import String

        rospy.init_node("gpcorrect")
        self._rospy, self._lock = rospy, threading.Lock()
        self._timeout = float(rospy.get_param("~timeout", 0.2))
        self._max_age = float(rospy.get_param("~max_age", 0.25))
        names = {"arm": "arm", "endpoint": "endpoint", "config": "config_file", "frame": "frame"}
        options = {names[name]: rospy.get_param("~" + name) for name in names if rospy.has_param("~" + name)}
        options.update(timeout=self._timeout, connect_timeout=self._timeout)
        words = [rospy.get_param("~python", "python3"), os.path.abspath(__file__), "--answer", json.dumps(options)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "universal_newlines": True}
        self._client = subprocess.Popen(words, **pipes)
        rospy.on_shutdown(self._client.stdin.close)
        self._report = rospy.Publisher("~report", String, queue_size=10)
        self._command = rospy.Publisher("~command", PoseStamped, queue_size=1)
        self._command_path = rospy.Publisher("~command_path", Path, queue_size=1)
        rospy.Subscriber("~desired", PoseStamped, self._one, queue_size=1)
        rospy.Subscriber("~desired_path", Path, self._path, queue_size=1)

    def _one(self, desired):
        age = (self._rospy.Time.now() - desired.header.stamp).to_sec()
        if abs(age) > self._max_age:
            self._say({"status": "STALE", "reason": f"the pose's stamp is {age:.3f} s old."})
        elif self._corrected(desired.header, [desired.pose]):
            self._command.publish(desired)

    def _path(self, path):
        times = [(p.header.stamp - path.poses[0].header.stamp).to_sec() for p in path.poses]
        headers = [p.header for p in path.poses]
        if self._corrected(path.header, [p.pose for p in path.poses], times):
            for header in headers:
                header.frame_id = path.header.frame_id
            self._command_path.publish(path)

    def _corrected(self, header, poses, times=None):
        """Put commands in the place of poses, and their frame into the header; say whether there are any."""
        asked = {"frame": header.frame_id, "poses": [_numbers(pose) for pose in poses]}
        if times is not None:
            asked["times"] = times
        begun = time.monotonic()
        with self._lock:
            try:
                self._client.stdin.write(json.dumps(asked) + "\n")
                self._client.stdin.flush()
                answer = json.loads(self._client.stdout.readline())
            except (OSError, ValueError):
                self._rospy.signal_shutdown("gpcorrect's client has ended: is ~python the one with gpcorrect in it?")
                return False
        if times is None and time.monotonic() - begun > 2 * self._timeout:
            answer = {"status": "STALE", "reason": "the answer came too late."}
        commands = answer.pop("poses", [])
        for pose, numbers in zip(poses, commands):  # noqa: B905 - Python 3.6 has no strict
            p, q = pose.position, pose.orientation
            p.x, p.y, p.z, q.w, q.x, q.y, q.z = numbers
        header.frame_id = answer.pop("frame", header.frame_id)
        self._say(answer)
        return bool(commands)

    def _say(self, report):
        self._report.publish(json.dumps(report))


def _numbers(pose):
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--answer", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_known_args()[0].answer
    if options is not None:
        answer_lines(options)
    else:
        import rospy

        Bridge(rospy)
        rospy.spin()


if __name__ == "__main__":
    main()
