from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, written
from robot_files import write_urdf

from gpcorrect import se3
from gpcorrect.arms import read_robot
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog, PoseSignal

pytest.importorskip("mujoco", reason="robot files need mujoco: pip install 'gpcorrect[mujoco]'")


def test_effects_and_noise_are_added_on_the_command_line(gpcorrect, tmp_path):
    """A URDF without anything else is simulated with an effect that it lacks."""
    path, log = write_urdf(tmp_path), tmp_path / "runs.csv"
    effect = ["--effect", "backlash joint=2 radius=0.02", "--noise", "1e-4"]
    size = ["--trajectories", "1", "--seconds", "2", "--output", str(log)]
    assert gpcorrect("simulate", "joints", "--machine", str(path), *effect, *size).code == 0
    assert log.exists()


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["--effect", "backlash joint radius=1"], "an effect is a name and fields with numbers"),
        (["--effect", "backslash joint=1"], "backslash"),
        (["--effect", "backlash joint=9 radius=0.1"], "acts on joint 9"),
        (["--effect", ""], "no effect is called ''"),
        (["--seconds", "inf"], "at least four samples and an end, got inf s"),
        (["--seconds", "nan"], "at least four samples and an end, got nan s"),
        (["--payload", "nan"], "payloads are masses in kg, 0 or more, got nan"),
        (["--payload", "0.1", "--payload", "-1"], "payloads are masses in kg, 0 or more, got 0.1, -1"),
    ],
)
def test_an_option_that_cannot_be_meant_is_refused(gpcorrect, tmp_path, extra, message):
    """The text or number is quoted, with how to write it."""
    log = tmp_path / "log.csv"
    assert_refused(gpcorrect("simulate", "joints", "--machine", write_urdf(tmp_path), "-o", log, *extra), message)
    assert not log.exists()


def test_reaches_of_a_robot_file_are_refused(gpcorrect, tmp_path):
    """Reaches are planned by a closed form that only arms with a remote centre have."""
    ended = gpcorrect("simulate", "reaches", "--machine", str(write_urdf(tmp_path)))
    assert ended.code == 2
    assert "remote centre" in ended.said


def test_reaches_with_a_payload_that_is_no_mass_are_refused(gpcorrect, tmp_path):
    """As of joint motion."""
    reaches = ("simulate", "reaches", "--reaches", 2, "--payload", "-1", "-o", tmp_path / "log.csv")
    assert_refused(gpcorrect(*reaches), "payloads are masses in kg, 0 or more, got -1")


def joints_and_tracker(robot: Path, folder: Path) -> Path:
    """Write a recording of a robot file's joints whose second is 0.02 rad off, seen by a tracker, without poses."""
    rng, time = np.random.default_rng(2), np.arange(480) * 0.05
    q = np.array([0.7, 0.7, 0.3]) * np.sin(time[:, None] * [0.7, 1.1, 1.7] + rng.uniform(0, 6, 3))
    base, marker = (se3.exp(np.array(xi)) for xi in ([0.3, -0.2, 0.9, 0.4, -0.7, 1.1], [0.01, 0.02, 0, 0.2, 0.5, 0]))
    T = base @ read_robot(robot).arm.forward(q + np.array([0, 0.02, 0])) @ marker
    seen = PoseSignal(
        T[:, :3, 3] + rng.normal(0, 1e-4, (480, 3)),
        se3.quaternion_from_matrix(T[:, :3, :3] @ se3.matrix_from_rotvec(rng.normal(0, 1e-3, (480, 3)))),
    )
    runs = np.repeat(np.arange(8), 60)
    log = CalibrationLog(time, runs, np.zeros_like(runs), tracker_cp=seen, setpoint_jp=q, measured_jp=q)
    return written(log, folder / "joints.csv")


def test_a_robot_file_lets_poses_and_joints_be_learned_from_joints_and_a_tracker(gpcorrect, tmp_path):
    """Poses and outside joints are computed by the machine's kinematics, and a joint's zero is found."""
    robot = write_urdf(tmp_path)
    log, joints = joints_and_tracker(robot, tmp_path), tmp_path / "joints.gpc"
    assert_refused(gpcorrect("fit", log, "--output", tmp_path / "m.gpc"), "setpoint_cp", "--machine")
    assert_refused(gpcorrect("joint", "fit", log, "--output", joints), "external_jp", "--machine")
    assert set(gpcorrect("validate", log, "--machine", robot, "--json").json["uses"].values()) == {True}
    assert "setpoint_cp" in gpcorrect("convert", log, tmp_path / "p.csv", "--machine", robot, "--json").json["signals"]
    words = ("--machine", robot, "--method", "offset", "--no-clean", "--json")
    found = gpcorrect("joint", "fit", log, *words, "--output", joints).json["errors"]
    assert abs(found["raw"][1]["mean"]) == pytest.approx(np.degrees(0.02), rel=0.1)
    assert found["corrected"][1]["rmse"] < 0.2 * found["raw"][1]["rmse"]


def test_a_mirrored_tracker_of_joints_is_refused(gpcorrect, tmp_path):
    """A recording of joints has no poses to compare a tracker with but those that the machine's kinematics gives."""
    robot = write_urdf(tmp_path)
    log = read_log(joints_and_tracker(robot, tmp_path))
    mirrored = PoseSignal(log.tracker_cp.position * [1, 1, -1], log.tracker_cp.quaternion)
    path = written(replace(log, tracker_cp=mirrored), tmp_path / "mirrored.csv")
    words = (path, "--machine", robot, "--output", tmp_path / "m.gpc")
    for command in (("fit",), ("joint", "fit", "--method", "offset", "--no-clean")):
        assert_refused(gpcorrect(*command, *words), "mirror image", "--as-is")
    assert gpcorrect("joint", "fit", "--method", "offset", "--no-clean", "--as-is", *words).code == 0


def test_a_machine_that_is_none_is_refused(gpcorrect, tmp_path):
    """The names that are known are listed; an arm of another kind is refused by its joints."""
    log = joints_and_tracker(write_urdf(tmp_path), tmp_path)
    words = ("joint", "fit", log, "--output", tmp_path / "m.gpc", "--machine")
    assert_refused(gpcorrect(*words, "panda"), "no machine panda", "dvrk_psm")
    assert_refused(gpcorrect(*words, "dvrk_psm"), "3 joints", "RRPRRR")
