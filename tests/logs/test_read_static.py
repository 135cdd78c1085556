"""Laws of tables without time: static poses, each row a motion of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from read_support import assert_same_log, random_log, write

from gpcorrect.errors import LogError
from gpcorrect.logs import join_logs, read_log, validate_log, write_log
from gpcorrect.types import CalibrationLog
from gpcorrect.velocity import segment_labels, twists


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
