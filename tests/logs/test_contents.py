"""What is in a recording, and mapping files that are proposed: they are accepted and read what was planted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mocap_support import moving_tool, write_motive, write_ndi, write_trc
from read_support import POSE, TICKS, N, joint_state, moving, poses, write, write_bag

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.logs.contents import contents_of
from gpcorrect.types import CalibrationLog


def read_as_proposed(path: Path) -> CalibrationLog:
    return read_log(path, columns=write(path.parent / "proposed.toml", contents_of(path).mapping))


def test_topics_are_listed_with_type_count_and_rate(tmp_path: Path):
    told = poses("/PSM1/setpoint_cp")
    joints = [joint_state("/joint_states", POSE.position[k], t) for k, t in enumerate(TICKS)]
    moved = moving("a", "b")
    bag = write_bag(tmp_path / "r", told + joints + moved, "mcap")
    found = contents_of(bag)
    listed = {part.name: (part.kind, part.samples) for part in found.parts}
    assert listed["/PSM1/setpoint_cp"] == ("geometry_msgs/msg/PoseStamped", N)
    assert listed["/tf:a->b"] == ("transform", N)
    assert '# measured_js = "/joint_states"' in found.mapping
    assert '# tracker_cp = "/tf:a->b"' in found.mapping
    log = read_as_proposed(bag)
    np.testing.assert_array_equal(log.setpoint_cp.position, POSE.position)
    free = write(tmp_path / "all.toml", found.mapping.replace("# ", ""))
    assert read_log(bag, columns=free).signals == ("setpoint_cp", "tracker_cp", "measured_jp")


def test_bodies_and_markers_are_listed_and_one_is_proposed(tmp_path: Path):
    tool = moving_tool(1)
    two = write_ndi(tmp_path / "ndi.csv", tool, names=("tool", "base"))
    assert [part.name for part in contents_of(two).parts] == ["tool", "base"]
    assert contents_of(two).mapping == '[mocap]\nbody = "tool"\n# body = "base"\n'
    for path in (two, write_motive(tmp_path / "m.csv", tool), write_trc(tmp_path / "a.trc", tool)):
        assert read_as_proposed(path).tracker_cp is not None


@pytest.mark.parametrize(
    "names",
    [
        "stamp_ns,cmd_x,cmd_y,cmd_z,marker_x_mm,marker_y_mm,marker_z_mm,q1,q2,q3",
        "time [ns],goal.px,goal.py,goal.pz,vicon tx [mm],vicon ty [mm],vicon tz [mm],joint_1,joint_2,joint_3",
    ],
)
def test_columns_are_proposed_by_their_names(tmp_path: Path, names: str):
    """What the names say is mapped, with its unit; joints of which nothing is said are left to the user."""
    rows = np.column_stack([POSE.position, 1e3 * POSE.position, POSE.position])
    lines = [",".join([str(t), *map(repr, row.tolist())]) for t, row in zip(TICKS, rows, strict=True)]
    path = write(tmp_path / "lab.csv", "\n".join([names, *lines]) + "\n")
    log = read_as_proposed(path)
    np.testing.assert_allclose(np.diff(log.time), 0.01, atol=1e-6)
    np.testing.assert_allclose(log.setpoint_cp.position, POSE.position)
    np.testing.assert_allclose(log.tracker_cp.position, POSE.position, rtol=1e-12)
    assert "# [measured_jp]" in contents_of(path).mapping


def test_quaternions_go_with_their_position(tmp_path: Path):
    header = "sec,nanosec,pos_x,pos_y,pos_z,rot_w,rot_x,rot_y,rot_z"
    lines = [
        f"{k},500000000," + ",".join(map(repr, [*POSE.position[k].tolist(), *POSE.quaternion[k].tolist()]))
        for k in range(N)
    ]
    log = read_as_proposed(write(tmp_path / "a.csv", "\n".join([header, *lines]) + "\n"))
    np.testing.assert_allclose(log.time, np.arange(N) + 0.5)
    np.testing.assert_array_equal(log.tracker_cp.quaternion, POSE.quaternion)


def test_what_cannot_be_read_is_refused_by_name(tmp_path: Path):
    with pytest.raises(LogError, match=r"nothing\.xyz"):
        contents_of(write(tmp_path / "nothing.xyz", b"\0\1"))
    with pytest.raises(LogError, match=r"gone\.csv"):
        contents_of(tmp_path / "gone.csv")


@pytest.mark.parametrize(("name", "mark"), [("a.parquet", b"PAR1"), ("b.mat", b"MATLAB 5.0 MAT-file")])
def test_damage_is_said_in_words(tmp_path: Path, name: str, mark: bytes):
    damaged = write(tmp_path / name, mark + np.random.default_rng(0).bytes(1000))
    with pytest.raises(LogError, match=rf"{name}: .*may be damaged"):
        contents_of(damaged)


@pytest.mark.parametrize("unit", ["ms", "msec", "milliseconds"])
def test_units_in_names_become_scales(tmp_path: Path, unit: str):
    """Milliseconds by any name, and joints in degrees: read as they stood, they were off by 1000 and by 57."""
    head = f"time_{unit},actual_q1_deg,actual_q2_deg,actual_q3_deg"
    path = write(tmp_path / "a.csv", f"{head}\n0,90,0,0\n10,91,0,0\n20,92,0,0\n")
    log = read_as_proposed(path)
    np.testing.assert_allclose(log.time, [0.0, 0.01, 0.02])
    np.testing.assert_allclose(log.measured_jp[:, 0], np.deg2rad([90, 91, 92]), rtol=1e-6)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6, 1e-9])
def test_stamps_since_1970_are_scaled_by_their_size(tmp_path: Path, scale: float):
    """Those in milliseconds were taken for microseconds, and those in microseconds for nanoseconds."""
    rows = "".join(f"{round((1_700_000_000 + k) / scale)},0.1,0.2,{k}\n" for k in range(4))
    log = read_as_proposed(write(tmp_path / "a.csv", "stamp,marker_x,marker_y,marker_z\n" + rows))
    np.testing.assert_allclose(log.time, 1_700_000_000 + np.arange(4), rtol=0, atol=1e-6)
