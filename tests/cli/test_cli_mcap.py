"""Poses of an evaluation as a ROS 2 recording, read back by rosbags and by the MCAP library's own ROS 2 decoder."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import CommandLine
from support import small_log

from gpcorrect.calibration import load
from gpcorrect.logs import read_log, write_log

Topics = dict[str, list[Any]]


def by_rosbags(folder: Path) -> Topics:
    """Read with the library that wrote."""
    from rosbags.highlevel import AnyReader

    with AnyReader([folder]) as bag:
        return gathered((c.topic, bag.deserialize(data, c.msgtype)) for c, _, data in bag.messages())


def by_mcap(folder: Path) -> Topics:
    """Read with an independent library; the test is skipped where it is missing."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="pip install mcap-ros2-support")
    (file,) = folder.glob("*.mcap")
    return gathered((m.channel.topic, m.ros_msg) for m in reader.read_ros2_messages(str(file)))


def gathered(messages: Any) -> Topics:
    found: Topics = {}
    for topic, message in messages:
        found.setdefault(topic, []).append(message)
    return found


def numbers(message: Any) -> list[float]:
    """X y z, and qw qx qy qz of a pose."""
    if hasattr(message, "vector"):
        return [message.vector.x, message.vector.y, message.vector.z]
    p, q = message.pose.position, message.pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


@pytest.mark.parametrize("read", [by_rosbags, by_mcap])
def test_poses_come_back_from_the_recording(
    read: Callable[[Path], Topics], gpcorrect: CommandLine, tmp_path: Path, small_model: Path
) -> None:
    """Commanded poses are the log's, reached ones its registered ones; the correction leads on to the corrected."""
    write_log(small_log(5, trajectories=3), tmp_path / "log.csv")
    done = gpcorrect("evaluate", small_model, tmp_path / "log.csv", "--mcap", tmp_path / "poses", "--json")
    assert done.code == 0, done.err
    log, corrector = read_log(tmp_path / "log.csv"), load(small_model)
    topics = read(tmp_path / "poses")
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in topics["/commanded"]]
    rows = np.array([np.abs(log.time - stamp).argmin() for stamp in stamps])
    assert len(rows) > 0.5 * len(log)
    np.testing.assert_allclose(stamps, log.time[rows], atol=1e-8)
    values = {topic: np.array([numbers(m) for m in messages]) for topic, messages in topics.items()}
    assert {m.header.frame_id for m in topics["/corrected"]} == {corrector.info()["frames"]["output"]}
    np.testing.assert_allclose(values["/commanded"][:, :3], log.setpoint_cp.position[rows], atol=1e-12)
    registered = corrector.rigid.apply(log.tracker_cp[rows])
    np.testing.assert_allclose(values["/reached"][:, :3], registered.position, atol=1e-9)
    alike = np.abs(np.sum(values["/reached"][:, 3:] * registered.quaternion, axis=1))
    np.testing.assert_allclose(alike, 1.0, atol=1e-9)
    moved = values["/corrected"][:, :3] - values["/reached"][:, :3]
    np.testing.assert_allclose(values["/correction/position"], moved, atol=1e-12)
    again = gpcorrect("evaluate", small_model, tmp_path / "log.csv", "--mcap", tmp_path / "poses")
    assert again.code == 2
    assert "already" in again.err


def test_poses_without_a_clock_are_refused(gpcorrect: CommandLine, tmp_path: Path, small_model: Path) -> None:
    """A recording has a clock: static poses are refused in words, and nothing is written."""
    write_log(small_log(5, trajectories=3), tmp_path / "log.csv")
    with (tmp_path / "log.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    kept = [name for name in rows[0] if name.startswith(("setpoint_cp", "tracker_cp"))]
    with (tmp_path / "static.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, kept, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows[::20])
    done = gpcorrect("evaluate", small_model, tmp_path / "static.csv", "--mcap", tmp_path / "poses")
    assert (done.code, "clock" in done.err) == (2, True), done.err
    assert not (tmp_path / "poses").exists()
