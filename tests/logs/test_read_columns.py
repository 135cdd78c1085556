from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from read_support import random_log, write
from scipy.spatial.transform import Rotation

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log, write_log
from gpcorrect.logs.columns import ColumnMap, load_columns

TURNS = Rotation.random(6, rng=np.random.default_rng(0))
FORMS = {
    "quat_wxyz": TURNS.as_quat(scalar_first=True),
    "quat_xyzw": TURNS.as_quat(),
    "rotvec": TURNS.as_rotvec(),
    "rpy": TURNS.as_euler("xyz"),
    "rpy_deg": TURNS.as_euler("xyz", degrees=True),
    "matrix": TURNS.as_matrix().reshape(-1, 9),
}


def table(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows.tolist())]
    return write(path, "\n".join(lines) + "\n")


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_orientation_is_the_same_rotation(tmp_path: Path, form: str):
    values = FORMS[form]
    names = [f"o{k}" for k in range(values.shape[1])]
    data = table(tmp_path / "a.csv", {"t": np.arange(6), "p": np.zeros(6)} | dict(zip(names, values.T, strict=True)))
    mapping = f'time = "t"\n[tracker_cp]\nposition = ["p", "p", "p"]\n{form} = {names}\n'
    pose = read_log(data, columns=write(tmp_path / "m.toml", mapping)).tracker_cp
    back = Rotation.from_quat(pose.quaternion, scalar_first=True)
    assert (back * TURNS.inv()).magnitude().max() < 1e-12
    assert np.isfinite(pose.quaternion).all()


@pytest.mark.parametrize("form", ["rotvec", "rpy"])
def test_angles_in_degrees_are_not_read_as_radians(tmp_path: Path, form: str) -> None:
    """Angles of which most are more than a full turn are refused by name; a lone one of more is read."""
    mapping = write(
        tmp_path / "m.toml", f'time = "t"\n[tracker_cp]\nposition = ["p", "p", "p"]\n{form} = ["a", "b", "c"]\n'
    )
    for factor, refused in ((57.3, True), (1.0, False)):
        values = factor * FORMS[form]
        values[0] += 7.0
        columns = {"t": np.arange(6), "p": np.zeros(6)} | dict(zip("abc", values.T, strict=True))
        data = table(tmp_path / f"{factor}.csv", columns)
        if refused:
            with pytest.raises(LogError, match="looks like degrees"):
                read_log(data, columns=mapping)
        else:
            assert read_log(data, columns=mapping).tracker_cp is not None


def test_units_are_scaled_and_offsets_added(tmp_path: Path):
    data = table(
        tmp_path / "a.csv",
        {
            "ns": np.array([0, 2e9]),
            "mm": np.array([1.0, 2.0]),
            "deg": np.array([180.0, 90.0]),
            "kg": np.array([0.1, 0.2]),
        },
    )
    mapping = """
time = "ns"
time_scale = 1e-9
time_offset = 5
[setpoint_cp]
position = ["mm", "mm", "mm"]
position_scale = 1e-3
[measured_jp]
columns = ["deg", "mm"]
scale = [0.017453292519943295, 1e-3]
offset = [0.5, 0.0]
[payload]
columns = ["kg"]
scale = 2
"""
    log = read_log(data, columns=write(tmp_path / "m.toml", mapping))
    np.testing.assert_allclose(log.time, [5, 7])
    np.testing.assert_allclose(log.setpoint_cp.position[1], [2e-3] * 3)
    np.testing.assert_allclose(log.measured_jp, [[np.pi + 0.5, 1e-3], [np.pi / 2 + 0.5, 2e-3]])
    np.testing.assert_allclose(log.payload, [0.2, 0.4])


def test_a_headerless_table_is_read_by_column_numbers(tmp_path: Path):
    data = write(tmp_path / "a.csv", "4,0,1,2,3\n4,0.1,5,6,7\n5,0,8,9,10\n")
    mapping = "time = 1\ntrajectory = 0\n[tracker_cp]\nposition = [2, 3, 4]\n"
    log = read_log(data, columns=write(tmp_path / "m.toml", mapping))
    np.testing.assert_array_equal(log.tracker_cp.position, [[1, 2, 3], [5, 6, 7], [8, 9, 10]])
    assert log.trajectory.tolist() == [4, 4, 5]


def test_a_headerless_table_has_the_width_of_its_first_line(tmp_path: Path):
    data = write(tmp_path / "a.csv", "0,1,2\n1,2,3\n2,3\n")
    with pytest.raises(LogError, match=r"line 3 has 2 cells, expected 3.*cut off"):
        read_log(data, columns=write(tmp_path / "m.toml", "time = 0\n[payload]\ncolumns = [1]\n"))


def test_a_headerless_table_is_read_by_names_that_the_mapping_gives(tmp_path: Path):
    data = write(tmp_path / "a.txt", "# lab 3\n0;1,5\n1;2,5\n")
    mapping = '[csv]\nskip = 1\nheader = false\nnames = ["time", "payload"]\n'
    log = read_log(data, columns=write(tmp_path / "m.toml", mapping))
    np.testing.assert_array_equal(log.payload, [1.5, 2.5])


def test_what_the_mapping_says_of_the_form_of_a_table_comes_first(tmp_path: Path):
    data = write(tmp_path / "a.csv", "time|payload\n0|1,5\n1|2\n")
    mapping = '[csv]\ndelimiter = "|"\ndecimal = ","\n'
    np.testing.assert_array_equal(read_log(data, columns=write(tmp_path / "m.toml", mapping)).payload, [1.5, 2])


def test_signals_that_the_mapping_does_not_name_are_read_by_their_native_names(tmp_path: Path):
    data = table(tmp_path / "a.csv", {k: np.arange(2.0) for k in ("time", "u", "setpoint_jp_1", "measured_jp_1")})
    mapping = '[setpoint_jp]\ncolumns = ["u"]\n'
    log = read_log(data, columns=write(tmp_path / "m.toml", mapping))
    assert log.signals == ("setpoint_jp", "measured_jp")
    assert log.extra == {}
    assert "setpoint_jp_1" in log.remarks[0]


def test_a_scale_alone_leaves_columns_and_orientation_as_they_are(tmp_path: Path):
    log = random_log(3)
    write_log(log, tmp_path / "a.csv")
    scaled = read_log(tmp_path / "a.csv", columns=write(tmp_path / "m.toml", "[setpoint_cp]\nposition_scale = 1e-3\n"))
    np.testing.assert_allclose(1e3 * scaled.setpoint_cp.position, log.setpoint_cp.position, rtol=1e-12)
    np.testing.assert_array_equal(scaled.setpoint_cp.quaternion, read_log(tmp_path / "a.csv").setpoint_cp.quaternion)
    np.testing.assert_array_equal(scaled.tracker_cp.position, log.tracker_cp.position)
    bare = table(tmp_path / "bare.csv", {k: np.arange(2.0) for k in ("time", "payload")})
    with pytest.raises(LogError, match="scales setpoint_cp, which the recording does not hold"):
        read_log(bare, columns=tmp_path / "m.toml")


def test_matrices_that_are_no_rotation_are_missing_and_counted(tmp_path: Path):
    flat = np.stack([np.eye(3), 1.1 * np.eye(3), -np.eye(3), np.diag([1, 1, np.nan])]).reshape(4, 9)
    names = [f"r{k}" for k in range(9)]
    data = table(tmp_path / "a.csv", {"time": np.arange(4)} | dict(zip(names, flat.T, strict=True)))
    mapping = f'[tracker_cp]\nposition = ["r0", "r1", "r2"]\nmatrix = {names}\n'
    log = read_log(data, columns=write(tmp_path / "m.toml", mapping))
    assert np.isfinite(log.tracker_cp.quaternion).all(axis=1).tolist() == [True, False, False, False]
    assert "2 samples of tracker_cp" in log.remarks[0]


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ("tiem = 'x'", r"unknown key tiem. Did you mean time\?"),
        (
            "[tracker_cp]\npositon = ['x','y','z']\nposition = ['x','y','z']",
            r"tracker_cp.positon. Did you mean position\?",
        ),
        ("[csv]\nzzz = 1", "unknown key csv.zzz. Known keys here: delimiter, decimal"),
        ("[tracker_cp]\nrotvec = ['x','y','z']", "give the columns of its position, or position_scale alone"),
        ("[tracker_cp]", "give the columns of its position, or position_scale alone"),
        ("[tracker_cp]\nposition = ['x','y']", "key tracker_cp.position"),
        ("[tracker_cp]\nposition = ['x','y',-1]", "key tracker_cp.position.2"),
        (
            "[tracker_cp]\nposition=['x','y','z']\nrotvec=['x','y','z']\nrpy=['x','y','z']",
            "one orientation, not rotvec and rpy",
        ),
        ("[measured_jp]\ncolumns=['a','b']\nscale=[1,2,3]", "scale has 3 numbers for 2 columns"),
        ("[payload]\ncolumns=['a','b']", "payload is one column, not 2"),
        ("time_scale = 'ms'", r"key time_scale: .* \(got 'ms'\)"),
        ("time_scale = inf", "key time_scale"),
        ("time = ", "is not TOML"),
        (b"\xff\xfe", "is not TOML"),
    ],
)
def test_a_bad_mapping_is_refused_by_the_name_of_the_key(tmp_path: Path, mapping: str | bytes, message: str):
    path = write(tmp_path / "m.toml", mapping)
    with pytest.raises(LogError, match=message) as caught:
        load_columns(path)
    assert str(caught.value).startswith(str(path))


def test_a_missing_mapping_file_is_reported(tmp_path: Path):
    with pytest.raises(LogError, match="cannot read the mapping file"):
        load_columns(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ('time = "tme"', r"no column 'tme' of numbers. Did you mean time\?"),
        ("[setpoint_jp]\ncolumns = [9]", "no column 9: the table has 2, counted from 0"),
        ('[csv]\nheader = false\nnames = ["time"]', "csv.names gives 1 names, the table has 2 columns"),
    ],
)
def test_a_mapping_that_does_not_fit_the_table_is_refused(tmp_path: Path, mapping: str, message: str):
    data = write(tmp_path / "a.csv", "time,payload\n0,1\n")
    with pytest.raises(LogError, match=message):
        read_log(data, columns=write(tmp_path / "m.toml", mapping))


def test_a_column_of_text_that_the_mapping_needs_is_named(tmp_path: Path):
    data = write(tmp_path / "a.csv", "time,u\n0,1\n1,1;5\n")
    with pytest.raises(LogError, match="column u must hold numbers, got '1;5' at line 3"):
        read_log(data, columns=write(tmp_path / "m.toml", '[payload]\ncolumns = ["u"]'))


def test_an_empty_mapping_changes_nothing(tmp_path: Path):
    assert load_columns(write(tmp_path / "m.toml", "")) == ColumnMap()


def test_a_time_in_several_columns_is_their_scaled_sum(tmp_path: Path):
    """Seconds and nanoseconds are one time; numbers of scales that do not match are refused."""
    table = write(tmp_path / "a.csv", "sec,nanosec,x,y,z\n10,500000000,1,2,3\n11,0,4,5,6\n")
    text = 'time = ["sec", "nanosec"]\ntime_scale = [1, 1e-9]\n[tracker_cp]\nposition = ["x", "y", "z"]\n'
    log = read_log(table, columns=write(tmp_path / "m.toml", text))
    np.testing.assert_allclose(log.time, [10.5, 11.0])
    assert not log.extra
    with pytest.raises(LogError, match="time_scale has 3 numbers for 2 columns of time"):
        read_log(table, columns=write(tmp_path / "m.toml", text.replace("[1, 1e-9]", "[1, 1, 1]")))


def test_samples_without_a_time_follow_at_the_stated_rate(tmp_path: Path):
    """The mapping's rate makes the clock; beside a time it is refused."""
    table = write(tmp_path / "a.csv", "x,y,z\n1,2,3\n4,5,6\n7,8,9\n")
    text = 'rate = 50.0\n[tracker_cp]\nposition = ["x", "y", "z"]\n'
    log = read_log(table, columns=write(tmp_path / "m.toml", text))
    np.testing.assert_allclose(log.time, [0.0, 0.02, 0.04])
    assert not log.static
    with pytest.raises(LogError, match="the time or a rate, not both"):
        read_log(table, columns=write(tmp_path / "m.toml", 'time = "x"\n' + text))


def test_a_number_in_a_columns_name_is_no_size(tmp_path: Path):
    """A joint of a huge number leaves its signal out, names the first missing columns, and takes no memory."""
    table = "time,tracker_cp_x,tracker_cp_y,tracker_cp_z,measured_jp_1,measured_jp_611111111111\n0,0,0,0,1,2\n"
    log = read_log(write(tmp_path / "a.csv", table))
    assert log.measured_jp is None
    assert any("measured_jp is left out: it lacks measured_jp_2, " in remark for remark in log.remarks)


@pytest.mark.parametrize(("first", "why"), [("0", "there is measured_jp_0"), ("01", "it lacks measured_jp_1")])
def test_joints_that_are_not_counted_from_one_are_no_signal(tmp_path: Path, first: str, why: str):
    """Joints 0 to 2 were read as two joints, the second of them as the first."""
    numbers = [f"{int(first) + k:0{len(first)}}" for k in range(3)]
    data = table(tmp_path / "a.csv", {"time": np.arange(4.0)} | {f"measured_jp_{n}": np.ones(4) for n in numbers})
    log = read_log(data)
    assert log.measured_jp is None
    assert any("measured_jp is left out" in remark and why in remark for remark in log.remarks)
    names = [f"measured_jp_{n}" for n in numbers]
    mapped = read_log(data, columns=write(tmp_path / "m.toml", f"[measured_jp]\ncolumns = {names}\n"))
    assert mapped.measured_jp.shape == (4, 3)
