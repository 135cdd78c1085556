"""Laws of the data contracts."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.errors import DataError
from gpcorrect.types import CalibrationLog, PoseSignal


def make_log(n: int = 6) -> CalibrationLog:
    return CalibrationLog(
        time=np.arange(n, dtype=float),
        trajectory=np.repeat([7, 3], n // 2),
        session=np.zeros(n),
        tracker_cp=PoseSignal(np.arange(3.0 * n).reshape(n, 3)),
        external_jp=np.ones((n, 2)),
        extra={"note": np.arange(n, dtype=float)},
    )


def test_a_log_keeps_its_own_copy_and_cannot_be_changed() -> None:
    """Changing the caller's array later changes nothing, and the log's arrays are read-only."""
    time = np.arange(3.0)
    log = CalibrationLog(time=time, trajectory=np.zeros(3), session=np.zeros(3))
    time[0] = 99.0
    assert log.time[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        log.time[0] = 1.0


def test_select_takes_the_same_rows_of_every_signal() -> None:
    """Rows of time, poses, joints and extra columns stay together."""
    log = make_log().select(np.array([4, 1]))
    assert log.time.tolist() == [4.0, 1.0]
    assert log.tracker_cp.position[:, 0].tolist() == [12.0, 3.0]
    assert log.extra["note"].tolist() == [4.0, 1.0]
    assert log.setpoint_cp is None


def test_trajectories_come_in_recorded_order() -> None:
    """Numbers are labels: the first recorded comes first whatever its number."""
    assert [number for number, _ in make_log().trajectories()] == [7, 3]


def test_signals_of_another_length_are_refused() -> None:
    """A signal with more samples than times is an error that names it."""
    with pytest.raises(DataError, match="tracker_cp has 4 samples, time has 3"):
        CalibrationLog(np.arange(3.0), np.zeros(3), np.zeros(3), tracker_cp=PoseSignal(np.zeros((4, 3))))


def test_a_missing_number_makes_the_sample_not_finite() -> None:
    """Position or quaternion: one NaN is enough."""
    position, quaternion = np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 1))
    position[1, 2] = quaternion[2, 0] = np.nan
    assert PoseSignal(position, quaternion).finite.tolist() == [True, False, False]
    assert PoseSignal(position).finite.tolist() == [True, False, True]


@pytest.mark.parametrize("columns", [3, 7])
def test_a_table_of_poses_and_back_is_the_same(columns: int) -> None:
    """Poses with and without orientation are the table that they came from."""
    table = np.arange(4.0 * columns).reshape(4, columns)
    np.testing.assert_array_equal(PoseSignal.of(table).table, table)
