"""Trajectory tables of public data sets, comments, blanks between cells, and HDF5."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from read_support import random_pose, write
from scipy.spatial.transform import Rotation

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog, FloatArray

N = 25
TIME = 1305031098.5 + np.arange(N) / 10
POSE = random_pose(np.random.default_rng(0), N)
XYZW = POSE.quaternion[:, [1, 2, 3, 0]]
MATRIX = Rotation.from_quat(POSE.quaternion, scalar_first=True).as_matrix()


def text(rows: FloatArray, between: str = " ") -> str:
    return "".join(between.join(f"{x:.12g}" for x in row) + "\n" for row in rows)


def assert_poses(log: CalibrationLog, signal: str = "tracker_cp") -> None:
    pose = getattr(log, signal)
    np.testing.assert_allclose(pose.position, POSE.position, rtol=1e-9)
    turned = Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(turned, MATRIX, atol=1e-9)


TUM = text(np.column_stack([TIME, POSE.position, XYZW]))
WAYS = {
    "bare": TUM,
    "described": "# ground truth trajectory\n# file: 'a.bag'\n# timestamp tx ty tz qx qy qz qw\n" + TUM,
    "aligned": TUM.replace(" ", "    ").replace("\n", "  \n"),
    "tabs": TUM.replace(" ", "\t"),
    "commas": TUM.replace(" ", ","),
    "named commas": "timestamp,tx,ty,tz,qx,qy,qz,qw\n" + TUM.replace(" ", ","),
    "a comment inside": TUM.replace("\n", "\n# here the clock was set\n", 1),
}


@pytest.mark.parametrize("content", WAYS.values(), ids=WAYS)
def test_a_tum_trajectory_needs_no_mapping(tmp_path: Path, content: str):
    log = read_log(write(tmp_path / "groundtruth.txt", content))
    assert_poses(log)
    np.testing.assert_allclose(log.time, TIME, atol=1e-2)
    assert "TUM" in log.remarks[0]


def test_euroc_ground_truth_is_read_with_and_without_orientation(tmp_path: Path):
    stamps = [str(int(1e9 * t)) for t in TIME]
    lines = zip(stamps, text(np.column_stack([POSE.position, POSE.quaternion]), ",").splitlines(), strict=True)
    names = "p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
    body = "".join(f"{stamp},{rest}\n" for stamp, rest in lines)
    log = read_log(write(tmp_path / "data.csv", f"#timestamp [ns],{names}\n{body}"))
    assert_poses(log)
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)
    short = "".join(",".join(line.split(",")[:4]) + "\n" for line in body.splitlines())
    seen = read_log(write(tmp_path / "b.csv", "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]\n" + short))
    assert seen.tracker_cp.quaternion is None
    np.testing.assert_allclose(seen.tracker_cp.position, POSE.position, rtol=1e-9)


def test_kitti_poses_need_a_rate(tmp_path: Path):
    path = write(tmp_path / "00.txt", text(np.concatenate([MATRIX, POSE.position[:, :, None]], axis=2).reshape(N, 12)))
    with pytest.raises(LogError, match=r"KITTI poses have no time.*rate = 10"):
        read_log(path)
    log = read_log(path, columns=write(tmp_path / "m.toml", "rate = 10.0\n"))
    assert_poses(log)
    np.testing.assert_allclose(log.time, np.arange(N) / 10)


@pytest.mark.parametrize(("arm", "place"), [("left", 38), ("right", 57)])
def test_jigsaws_kinematics_need_an_arm(tmp_path: Path, arm: str, place: int):
    table = np.random.default_rng(1).normal(size=(N, 76))
    for k in (0, 19, 38, 57):
        table[:, k + 3 : k + 12] = MATRIX[::-1].reshape(N, 9)
    table[:, place : place + 3], table[:, place + 3 : place + 12] = POSE.position, MATRIX.reshape(N, 9)
    path = write(tmp_path / "Suturing_B001.txt", text(table, "    "))
    with pytest.raises(LogError, match="two arms"):
        read_log(path)
    log = read_log(path, arm=arm)
    assert_poses(log, "measured_cp")
    np.testing.assert_allclose(np.diff(log.time), 1 / 30)


def test_a_table_like_none_of_them_still_needs_a_mapping(tmp_path: Path):
    rows = np.random.default_rng(2).normal(size=(N, 8))
    with pytest.raises(LogError, match="no column names"):
        read_log(write(tmp_path / "a.txt", text(rows)))


def test_a_mapping_comes_before_what_a_table_looks_like(tmp_path: Path):
    path = write(tmp_path / "a.txt", TUM)
    mapping = write(tmp_path / "m.toml", "time = 0\n[setpoint_cp]\nposition = [3, 2, 1]\n")
    log = read_log(path, columns=mapping)
    assert log.signals == ("setpoint_cp",)
    np.testing.assert_allclose(log.setpoint_cp.position, POSE.position[:, ::-1], rtol=1e-9)


def test_columns_between_blanks_keep_their_line_numbers(tmp_path: Path):
    """Comments and blanks are taken out before parsing; messages still name the line of the file."""
    content = "# a\n\n  time   tracker_cp_x tracker_cp_y  tracker_cp_z\n 0  1 2 3\n# b\n1  4 5 6\n 2  7 8 nine\n"
    with pytest.raises(LogError, match="'nine' at line 7"):
        read_log(write(tmp_path / "a.txt", content))
    log = read_log(write(tmp_path / "b.txt", content.replace("nine", "9")))
    np.testing.assert_array_equal(log.tracker_cp.position, [[1, 2, 3], [4, 5, 6], [7, 8, 9]])


def test_hdf5_of_other_programs_keeps_its_directions(tmp_path: Path):
    """Samples come first there, matrices row by row; a table of named columns is its columns."""
    T = np.zeros((N, 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = MATRIX, POSE.position, 1
    table = np.zeros(N, dtype=[("time", "f8"), ("setpoint_jp", "f8", 3), ("label", "S3")])
    table["time"], table["setpoint_jp"] = TIME, np.arange(3 * N).reshape(N, 3)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["tracker_cp"], file["note"] = TIME, T, "a text"
    with h5py.File(tmp_path / "b.hdf5", "w") as file:
        file["run"] = table
    log = read_log(tmp_path / "a.h5")
    assert_poses(log)
    assert any("note" in r for r in log.remarks)
    np.testing.assert_array_equal(read_log(tmp_path / "b.hdf5").setpoint_jp, table["setpoint_jp"])
