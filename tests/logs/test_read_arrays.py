from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from read_support import write

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log


def save(path: Path, array: np.ndarray, **options: object) -> Path:
    np.save(path, array, **options)
    return path


def test_a_plain_array_is_read_by_column_numbers(tmp_path: Path):
    data = save(tmp_path / "a.npy", np.arange(8, dtype=np.float32).reshape(2, 4))
    mapping = write(tmp_path / "m.toml", "time = 0\n[tracker_cp]\nposition = [3, 2, 1]\n")
    np.testing.assert_array_equal(read_log(data, columns=mapping).tracker_cp.position, [[3, 2, 1], [7, 6, 5]])


def test_a_structured_array_is_read_by_its_names(tmp_path: Path):
    kind = [("time", "<f8"), ("trajectory", "<i2"), ("setpoint_jp", "<f4", (6,)), ("payload", ">f8")]
    array = np.zeros(3, dtype=kind)
    array["time"], array["setpoint_jp"][:, 4], array["payload"] = [0, 1, 2], [7, 8, 9], 0.25
    log = read_log(save(tmp_path / "a.npy", array))
    assert log.signals == ("setpoint_jp", "payload")
    np.testing.assert_array_equal(log.setpoint_jp[:, 4], [7, 8, 9])
    np.testing.assert_array_equal(log.payload, [0.25] * 3)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 3)), "does not say which column is which.*mapping file"),
        (np.zeros(3), r"expected an \(n, columns\) array of numbers, got float64 of shape \(3,\)"),
        (np.zeros((2, 2), dtype=complex), "expected an .* got complex128"),
        (np.zeros(2, dtype=[("time", "f8"), ("name", "U3")]), "got name of <U3"),
        (np.array([{}]), "Arrays of objects are not read"),
    ],
)
def test_an_array_that_is_no_table_is_refused(tmp_path: Path, array: np.ndarray, message: str):
    data = save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(LogError, match=message):
        read_log(data)


def test_nulls_and_whole_numbers_in_parquet_become_numbers(tmp_path: Path):
    table = pa.table(
        {
            "time": pa.array([0, 1, 2], pa.int32()),
            "payload": pa.array([1.5, None, 2.5], pa.float32()),
            "who": pa.array(["a", "b", "c"]),
        }
    )
    parquet.write_table(table, tmp_path / "a.parquet")
    log = read_log(tmp_path / "a.parquet")
    np.testing.assert_array_equal(log.payload, [1.5, np.nan, 2.5])
    assert log.remarks == ("columns without numbers are left out: who.",)


def test_time_stamps_in_parquet_become_seconds(tmp_path: Path):
    stamps = pa.array([1_000_000, 1_500_000], pa.timestamp("us"))
    parquet.write_table(pa.table({"time": stamps, "payload": [0.0, 0.0]}), tmp_path / "a.parquet")
    np.testing.assert_allclose(read_log(tmp_path / "a.parquet").time, [1.0, 1.5])


def test_disordered_time_in_parquet_names_the_row(tmp_path: Path):
    parquet.write_table(pa.table({"time": [0.0, 1.0, 0.5], "payload": [0.0] * 3}), tmp_path / "a.parquet")
    with pytest.raises(LogError, match=r"time at row 1 \(1 s\) is out of order"):
        read_log(tmp_path / "a.parquet")


def test_columns_of_one_name_in_parquet_are_refused(tmp_path: Path):
    arrays = [pa.array([0.0]), pa.array([1.0])]
    parquet.write_table(pa.Table.from_arrays(arrays, names=["time", "time"]), tmp_path / "a.parquet")
    with pytest.raises(LogError, match="more than one column of the same name"):
        read_log(tmp_path / "a.parquet")


@pytest.mark.parametrize("numbers", [["a", "a", "b"], [False, False, True]])
def test_trajectories_without_numbers_are_not_merged(tmp_path: Path, numbers: list[object]):
    """A text table refused such a column, a Parquet table left it out and took all motions for one."""
    columns = {"time": [0.0, 1.0, 2.0], "trajectory": numbers, "payload": [0.0] * 3}
    parquet.write_table(pa.table(columns), tmp_path / "a.parquet")
    with pytest.raises(LogError, match="column trajectory must hold a number for every sample"):
        read_log(tmp_path / "a.parquet")


def test_a_time_of_text_is_not_needed_at_a_rate(tmp_path: Path):
    parquet.write_table(pa.table({"time": ["noon", "later"], "payload": [0.0] * 2}), tmp_path / "a.parquet")
    log = read_log(tmp_path / "a.parquet", columns=write(tmp_path / "m.toml", "rate = 2.0\n"))
    np.testing.assert_array_equal(log.time, [0.0, 0.5])
