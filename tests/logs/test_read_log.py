from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from read_support import assert_same_log, random_log, write
from support import real_data

from gpcorrect.errors import LogError
from gpcorrect.logs import join_logs, read_log, validate_log, write_log
from gpcorrect.logs.table import pose_names
from gpcorrect.types import CalibrationLog
from gpcorrect.velocity import segment_labels, twists


@pytest.mark.parametrize("name", ["a.dat", "a.csv"])
def test_the_content_decides_the_format_where_the_name_is_unknown_or_says_otherwise(tmp_path: Path, name: str):
    log = random_log(0)
    write_log(log, tmp_path / "a.parquet")
    (tmp_path / "a.parquet").rename(tmp_path / name)
    np.testing.assert_array_equal(read_log(tmp_path / name).time, log.time)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.xlsx", b"PK\x03\x04", r"ends in \.xlsx and the content is unknown.*Known formats: .*CSV \(\.csv"),
        ("noname", b"abc", "ends in nothing"),
        ("a.bag", b"time,payload\n0,1\n", "the name says ROS 1 bag, but the file does not begin like one"),
        ("a.mcap", b"\0" * 100, "the name says MCAP"),
        ("a.parquet", b"", "the file is empty"),
        ("a.npy", b"", "the file is empty"),
        ("a.bag", b"", "cannot be read"),
        ("a.npy", b"\x93NUMPY\x01\x00", "cannot be read"),
        ("a.parquet", b"PAR1 and no more", "Parquet file cannot be read"),
    ],
)
def test_what_is_no_recording_is_refused_with_the_formats_that_are(
    tmp_path: Path, name: str, content: bytes, message: str
):
    path = write(tmp_path / name, content)
    with pytest.raises(LogError, match=message) as caught:
        read_log(path)
    assert caught.value.path == str(path)


def test_a_missing_file_and_an_unknown_folder_are_reported(tmp_path: Path):
    with pytest.raises(LogError, match=r"none\.csv: cannot be read: No such file"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(LogError, match=r"found no metadata\.yaml"):
        read_log(tmp_path)


@pytest.mark.parametrize("suffix", [".parquet", ".npy"])
def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path, suffix: str):
    path = tmp_path / f"a{suffix}"
    if suffix == ".npy":
        np.save(path, np.zeros(50, dtype=[("time", "f8"), ("payload", "f8")]))
    else:
        write_log(random_log(0), path)
    whole = path.read_bytes()
    for size in np.linspace(1, len(whole) - 1, 50).astype(int):
        with pytest.raises(LogError):
            read_log(write(path, whole[:size]))


def test_the_input_is_never_touched(tmp_path: Path):
    write_log(random_log(0), tmp_path / "a.csv")
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in tmp_path.iterdir()}
    read_log(tmp_path / "a.csv")
    assert {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in tmp_path.iterdir()} == before


def test_a_mapping_file_named_like_the_sidecar_is_not_taken_for_one(tmp_path: Path):
    write(tmp_path / "a.csv", "time,u\n0,1\n")
    mapping = write(tmp_path / "a.toml", '[payload]\ncolumns = ["u"]\n')
    assert read_log(tmp_path / "a.csv", columns=mapping).payload.tolist() == [1.0]


def test_the_real_random_motion_is_read_as_its_readme_says():
    log = read_log(real_data("dvrk_random.csv"))
    assert len(log) == 5531
    assert log.signals == ("setpoint_cp", "tracker_cp", "setpoint_jp", "external_jp")
    assert log.meta.robot == "dVRK"
    assert log.meta.joint_types == "RRPRRR"
    assert np.median(np.diff(log.time)) == pytest.approx(0.43, abs=0.01)
    assert log.setpoint_cp.finite.all()
    assert log.remarks == ()


def test_the_real_bag_is_read_as_its_readme_says():
    log = read_log(real_data("dvrk_motion_1.bag"))
    assert log.signals == (
        "setpoint_cp",
        "measured_cp",
        "setpoint_jp",
        "measured_jp",
        "measured_jv",
        "measured_jf",
    )
    assert len(log) >= 3419
    assert log.time[-1] - log.time[0] == pytest.approx(34.4, abs=0.1)
    assert log.measured_jp.shape[1] == 6
    assert np.isfinite(log.measured_jp).all(axis=1).mean() > 0.999
    assert np.abs(log.setpoint_jp - log.measured_jp).max() < 0.2


def test_the_real_wiggles_join_as_two_trajectories_of_one_robot():
    logs = [read_log(real_data(f"dvrk_wiggle_{k}.csv")) for k in (1, 2)]
    joined = join_logs(logs)
    assert [len(rows) for _, rows in joined.trajectories()] == [270, 270]
    assert joined.meta.robot == "dVRK"
    assert joined.session.tolist() == [0] * 270 + [1] * 270


def test_the_real_bag_survives_being_written_as_a_native_log(tmp_path: Path):
    log = read_log(real_data("dvrk_motion_1.bag"))
    write_log(log, tmp_path / "a.csv")
    back = read_log(tmp_path / "a.csv")
    np.testing.assert_array_equal(back.time, log.time)
    np.testing.assert_array_equal(back.measured_cp.quaternion, log.measured_cp.quaternion)
    np.testing.assert_array_equal(back.measured_jf, log.measured_jf)


@pytest.mark.parametrize("unseen", ["0,0,0,0,0,0,0", "0,0,0,1,0,0,0"])
def test_what_a_tracker_does_not_see_is_missing(tmp_path: Path, unseen: str):
    """Drivers write zeros, or the pose of the origin, where the tool is hidden; a frame may begin at the origin."""
    head = ",".join(["time", *pose_names("tracker_cp")])
    rows = [unseen, "0.1,0,0,1,0,0,0", "0,0,0,0.8,0.6,0,0", "0.2,0,0,1,0,0,0"]
    log = read_log(write(tmp_path / "a.csv", "\n".join([head, *(f"{k},{row}" for k, row in enumerate(rows * 2))])))
    assert np.flatnonzero(np.isnan(log.tracker_cp.position).any(axis=1)).tolist() == [0, 4]
    assert np.flatnonzero(~log.tracker_cp.finite).tolist() == [0, 4]
    assert any("2 samples of tracker_cp are at exactly 0, 0, 0" in remark for remark in log.remarks)
    once = read_log(write(tmp_path / "b.csv", "\n".join([head, *(f"{k},{row}" for k, row in enumerate(rows))])))
    assert np.isfinite(once.tracker_cp.position).all()


def static_log(seed: int = 0) -> CalibrationLog:
    rows = np.arange(20)
    return replace(random_log(seed), static=True, time=rows, trajectory=rows, remarks=())


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_static_poses_read_back_as_such(tmp_path: Path, suffix: str):
    write_log(static_log(), tmp_path / f"a{suffix}")
    back = read_log(tmp_path / f"a{suffix}")
    assert back.static
    assert "static poses" in back.remarks[-1]
    assert_same_log(back, static_log())


def test_static_poses_have_no_velocity():
    """Nor have those that are selected from them, or joined."""
    joined = join_logs([static_log(0), static_log(1)])
    for log in (static_log(), static_log().select(slice(3, 9)), joined):
        assert log.static
        labels = segment_labels(log.time, log.trajectory)
        assert np.isnan(twists(log.time, log.tracker_cp.position, None, labels)).all()


def test_the_clock_of_static_poses_is_not_validated():
    report = validate_log(static_log())
    assert [f.code for f in report.findings if f.signal in ("time", "trajectory")] == ["static"]
    assert report.offsets == ()
    assert report.facts["rate_hz"] is None


def test_trajectory_numbers_of_static_poses_are_no_motions(tmp_path: Path):
    write(tmp_path / "a.csv", "trajectory,setpoint_jp_1\n7,1\n7,2\n")
    assert read_log(tmp_path / "a.csv").trajectory.tolist() == [0, 1]


@pytest.mark.parametrize("clock", ["Time", "stamp_ns", "t", "seconds"])
def test_what_may_be_the_time_must_be_named(tmp_path: Path, clock: str):
    """A clock under another name is never passed over."""
    write(tmp_path / "a.csv", f"{clock},setpoint_jp_1\n0,1\n1,2\n")
    with pytest.raises(LogError, match=r"no column 'time'.*mapping file"):
        read_log(tmp_path / "a.csv")


def test_static_poses_do_not_join_recordings():
    with pytest.raises(LogError, match="static poses"):
        join_logs([static_log(), random_log(0)])
