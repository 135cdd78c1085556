from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from read_support import NATIVE, write

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.logs.order import Disorder
from gpcorrect.types import CalibrationLog

ROWS = "0,0,0.1,0.2,0.3\n0.5,0,-0.1,1e-3,.5\n"
POSITIONS = [[0.1, 0.2, 0.3], [-0.1, 1e-3, 0.5]]


def positions(path: Path, **options: object) -> np.ndarray:
    return read_log(path, **options).tracker_cp.position


WAYS = {
    "plain": NATIVE + ROWS,
    "byte order mark": b"\xef\xbb\xbf" + (NATIVE + ROWS).encode(),
    "crlf": (NATIVE + ROWS).replace("\n", "\r\n"),
    "no last newline": (NATIVE + ROWS).rstrip("\n"),
    "blank lines": "\n\n" + NATIVE + "\n" + ROWS + "\n\n",
    "semicolons": (NATIVE + ROWS).replace(",", ";"),
    "tabs": (NATIVE + ROWS).replace(",", "\t"),
    "decimal commas": (NATIVE + ROWS).replace(",", ";").replace(".", ","),
    "tabs and decimal commas": (NATIVE + ROWS).replace(",", "\t").replace(".", ","),
    "utf-16": (NATIVE + ROWS).encode("utf-16"),
    "quotes": '"' + NATIVE.strip().replace(",", '","') + '"\n' + ROWS,
    "blanks around names": NATIVE.replace(",", " , ") + ROWS,
}


@pytest.mark.parametrize("text", WAYS.values(), ids=WAYS)
def test_the_same_numbers_come_from_every_way_to_write_a_table(tmp_path: Path, text: str | bytes):
    np.testing.assert_array_equal(positions(write(tmp_path / "a.csv", text)), POSITIONS)


def test_missing_cells_are_nan_and_keep_their_rows(tmp_path: Path):
    path = write(tmp_path / "a.csv", NATIVE + "0,0,,,\n1,0,nan,NaN,NULL\n2,0,1,2,3\n")
    np.testing.assert_array_equal(positions(path), [[np.nan] * 3, [np.nan] * 3, [1, 2, 3]])


def test_a_signal_is_present_when_all_of_its_columns_are(tmp_path: Path):
    names = "time,tracker_cp_x,tracker_cp_y,setpoint_jp_1,setpoint_jp_3,measured_jp_1,measured_jp_2\n"
    log = read_log(write(tmp_path / "a.csv", names + "0,1,2,3,4,5,6\n"))
    assert log.signals == ("measured_jp",)
    assert set(log.extra) == {"tracker_cp_x", "tracker_cp_y", "setpoint_jp_1", "setpoint_jp_3"}
    assert log.remarks == (
        "tracker_cp is left out: it lacks tracker_cp_z.",
        "setpoint_jp is left out: it lacks setpoint_jp_2.",
    )


def test_a_pose_without_its_whole_quaternion_is_a_position(tmp_path: Path):
    text = NATIVE.strip() + ",tracker_cp_qw\n0,0,1,2,3,1\n"
    log = read_log(write(tmp_path / "a.csv", text))
    assert log.tracker_cp.quaternion is None
    assert "positions only: its quaternion lacks tracker_cp_qx, tracker_cp_qy, tracker_cp_qz" in log.remarks[0]


def test_a_quaternion_far_from_unit_is_a_missing_rotation_and_counted(tmp_path: Path):
    names = ",".join(["time", *(f"tracker_cp_{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz"))]) + "\n"
    rows = "0,1,0,0,1.0009,0,0,0\n1,1,0,0,1.0011,0,0,0\n2,1,0,0,0,0,0,0\n3,1,0,0,,,,\n4,1,0,0,0,0,-1,0\n"
    log = read_log(write(tmp_path / "a.csv", names + rows))
    nothing = [np.nan] * 4
    np.testing.assert_allclose(log.tracker_cp.quaternion, [[1, 0, 0, 0], nothing, nothing, nothing, [0, 0, -1, 0]])
    assert np.isfinite(log.tracker_cp.position).all()
    assert log.remarks == ("2 samples of tracker_cp have no valid rotation; it counts as missing.",)


def test_extra_columns_of_numbers_stay_and_those_of_text_are_named(tmp_path: Path):
    text = NATIVE.strip() + ",grip,,comment\n0,0,1,2,3,0.5,9,go\n1,0,1,2,3,,8,\n"
    log = read_log(write(tmp_path / "a.csv", text))
    np.testing.assert_array_equal(log.extra["grip"], [0.5, np.nan])
    np.testing.assert_array_equal(log.extra["column_6"], [9, 8])
    assert log.remarks == ("columns without numbers are left out: comment.",)


def test_absent_trajectory_and_session_are_one(tmp_path: Path):
    log = read_log(write(tmp_path / "a.csv", "time,payload\n0,1\n1,1\n"))
    assert log.trajectory.tolist() == log.session.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n \n", "found no line of text"),
        (NATIVE, "column names but no samples"),
        (NATIVE.strip(), "column names but no samples"),
        ("time,x,x\n0,1,2\n", "more than one column named x"),
        ("a,b\n0,1\n", r"no column 'time' of numbers.*Columns here: a, b"),
        ("Time,payload\n0,1\n", r"no column 'time'.*Did you mean Time\?"),
        (NATIVE + ROWS + "2,0,1,oops,3\n", r"tracker_cp_y must hold numbers, got 'oops' at line 4\."),
        ("\n\n" + NATIVE + "\n" + ROWS + "2,0,1,oops,3\n", "got 'oops' at line 7"),
        (NATIVE + ROWS + "2,0,1", r"line 4 has 3 cells, expected 5.*cut off"),
        (NATIVE + "0,0,0,1,0,2,0,3\n", r"line 2 has 8 cells, expected 5.*decimal commas"),
        (NATIVE + ROWS + "0.5,0,1,2,3\n", r"time at line 4 \(0.5 s\) is out of order inside trajectory 0"),
        (NATIVE + ROWS + ",0,1,2,3\n", "time at line 4 is missing inside trajectory 0"),
        (
            NATIVE + ROWS + "1,0.5,1,2,3\n",
            "trajectory must be a whole number for every sample, got 0.5 at line 4",
        ),
        (NATIVE + ROWS + "1,inf,1,2,3\n", "trajectory must be a whole number .* got inf at line 4"),
        (NATIVE + ROWS + "1,1e300,1,2,3\n", r"trajectory must be a whole number .* got 1e\+300 at line 4"),
        (
            NATIVE + ROWS + "1,,1,2,3\n",
            "trajectory must be a whole number for every sample, got nothing at line 4",
        ),
        (ROWS, r"5 numbers and no column names.*mapping file with column numbers"),
        (b"PK\x03\x04\0\0\0", "binary data"),
        (NATIVE.encode() + b"0,0,\xff\xfe,2,3\n", "tracker_cp_x must hold numbers"),
    ],
)
def test_a_bad_table_is_refused_with_the_reason_and_the_file(tmp_path: Path, text: str | bytes, message: str):
    path = write(tmp_path / "a.csv", text)
    with pytest.raises(LogError, match=message) as caught:
        read_log(path)
    assert str(caught.value).startswith(str(path))


def test_disordered_time_can_be_dropped_or_kept(tmp_path: Path):
    path = write(
        tmp_path / "a.csv",
        NATIVE + "0,0,1,0,0\n9,0,2,0,0\n1,0,3,0,0\n2,0,4,0,0\n,0,5,0,0\n2,0,6,0,0\n0,1,7,0,0\n",
    )
    dropped = read_log(path, disorder="drop")
    assert dropped.tracker_cp.position[:, 0].tolist() == [1, 3, 4, 7]
    assert dropped.remarks == ("time at line 3 (9 s) is out of order inside trajectory 0 (3 such samples); left out.",)
    assert len(read_log(path, disorder="keep")) == 7


@pytest.mark.parametrize("disorder", ["refuse", "drop", "keep"])
def test_a_time_of_day_runs_on_past_midnight(tmp_path: Path, disorder: Disorder):
    """Also in the motions that follow; what else is out of order still is."""
    clock = [86399.97, 86399.98, 86399.99, 0.005, 0.01, 0.02, 0.03, 0.04]
    rows = "".join(f"{time},{k // 5},{k},0,0\n" for k, time in enumerate(clock))
    log = read_log(write(tmp_path / "a.csv", NATIVE + rows), disorder=disorder)
    np.testing.assert_array_equal(log.time, [*clock[:3], *(time + 86400 for time in clock[3:])])
    assert len(log.remarks) == 1
    assert "past midnight" in log.remarks[0]
    with pytest.raises(LogError, match=r"line 6 \(86399\.[79]+ s\) is out of order"):
        read_log(write(tmp_path / "b.csv", NATIVE + rows.replace("0.01,0,", "-0.3,0,")))


def test_a_huge_table_is_refused_before_it_is_read(tmp_path: Path):
    path = tmp_path / "huge.csv"
    with path.open("wb") as file:
        file.truncate(5 * 1024**3)
    with pytest.raises(LogError, match=r"at most 2.15 GB, got 5.37 GB.*Parquet.*max_bytes"):
        read_log(path)


def test_the_size_limit_is_the_callers(tmp_path: Path):
    path = write(tmp_path / "a.csv", NATIVE + ROWS)
    with pytest.raises(LogError, match="expected at most"):
        read_log(path, max_bytes=10)
    assert len(read_log(path, max_bytes=1000)) == 2


def test_numbers_are_read_to_the_last_bit(tmp_path: Path):
    values = np.random.default_rng(0).normal(size=500) * 10.0 ** np.random.default_rng(1).integers(-300, 300, 500)
    text = "time,payload\n" + "".join(f"{k},{v!r}\n" for k, v in enumerate(values.tolist()))
    np.testing.assert_array_equal(read_log(write(tmp_path / "a.csv", text)).payload, values)


def test_a_column_that_turns_to_text_late_is_still_named(tmp_path: Path):
    text = "time,payload\n" + "".join(f"{k},1.5\n" for k in range(200_000)) + "200000,heavy\n"
    with pytest.raises(LogError, match="column payload must hold numbers, got 'heavy' at line 200002"):
        read_log(write(tmp_path / "a.csv", text))


CELLS = st.text(st.sampled_from(",;\t\n\r\"' .-+0123456789eExyzna\0µ\ufeff"), max_size=80)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.one_of(st.binary(max_size=80), CELLS.map(str.encode)), st.booleans())
def test_whatever_the_bytes_are_there_is_a_log_or_a_log_error(tmp_path: Path, data: bytes, named: bool):
    path = write(tmp_path / "a.csv", NATIVE.encode() * named + data)
    try:
        log = read_log(path)
    except LogError:
        return
    assert isinstance(log, CalibrationLog)
