"""Static tables: measured poses that do not stand beside their commands are found, as they were left as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.errors import LogError
from gpcorrect.logs import refuse_misread, validate_log
from gpcorrect.logs.checks import Finding
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, PoseSignal


def table(n: int = 60, *, turned: float = 0.6, lever: float = 0.02, seed: int = 0) -> CalibrationLog:
    """Return poses without a clock, missed by 2 mm and 2 degrees, seen in another frame by a marker off the tip."""
    rng = np.random.default_rng(seed)
    T = se3.from_parts(
        0.05 * rng.uniform(-1, 1, (n, 3)), se3.quaternion_from_matrix(_turn(turned * rng.standard_normal((n, 3))))
    )
    missed = se3.from_parts(
        T[:, :3, 3] + 0.002 * rng.standard_normal((n, 3)),
        se3.quaternion_from_matrix(_turn(np.deg2rad(2) * rng.standard_normal((n, 3))) @ T[:, :3, :3]),
    )
    frame, mounted = se3.exp(np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.7])), se3.pose(np.eye(3), np.array([lever, 0, 0]))
    commanded, seen = (PoseSignal(*se3.to_parts(poses)) for poses in (T, frame @ missed @ mounted))
    count = np.arange(n)
    return CalibrationLog(
        count.astype(float), count, np.zeros(n), setpoint_cp=commanded, tracker_cp=seen, static=True, name="table"
    )


def _turn(rotvec: FloatArray) -> FloatArray:
    return se3.matrix_from_rotvec(rotvec)


def reordered(log: CalibrationLog, rows: IntArray) -> CalibrationLog:
    """Return the table with its measured poses from other rows."""
    return replace(log, tracker_cp=log.tracker_cp[rows])


def unrelated(log: CalibrationLog) -> list[Finding]:
    return [finding for finding in validate_log(log).findings if finding.code == "unrelated"]


@pytest.mark.parametrize("lever", [0.0, 0.02, 0.15])
@pytest.mark.parametrize("turned", [0.0, 0.6])
@pytest.mark.parametrize("seed", range(4))
def test_a_table_whose_rows_belong_together_is_left_alone(lever: float, turned: float, seed: int) -> None:
    """Whatever frames, mounting and the marker's lever arm are, and also where the tool is not turned."""
    assert not unrelated(table(25, lever=lever, turned=turned, seed=seed))


def test_poses_that_are_gone_through_twice_are_left_alone() -> None:
    """A second round of the same poses, and few poses many times, are no rows exchanged."""
    log = table(60)
    for rows in (np.tile(np.arange(30), 2), np.repeat(np.arange(6), 10)):
        assert not unrelated(replace(reordered(log, rows), setpoint_cp=log.setpoint_cp[rows]))  # type: ignore[index]


@pytest.mark.parametrize("turned", [0.0, 0.6])
@pytest.mark.parametrize("seed", range(4))
def test_permuted_rows_are_refused(turned: float, seed: int) -> None:
    """A table whose measured poses were sorted by something else stops the fit, as a log of another arm does."""
    log = table(40, turned=turned, seed=seed)
    wrong = reordered(log, np.random.default_rng(seed).permutation(40))
    assert unrelated(wrong)
    with pytest.raises(LogError, match="measured poses"):
        refuse_misread(wrong)


@pytest.mark.parametrize(("by", "other"), [(1, "k-1"), (-1, "k+1")])
def test_a_shift_by_a_row_is_named(by: int, other: str) -> None:
    """It is said to which row each measured pose belongs."""
    (found,) = unrelated(reordered(table(60), np.roll(np.arange(60), by)))
    assert f"belongs to row {other} of setpoint_cp" in found.message
    assert "from data row" not in found.message


@pytest.mark.parametrize("first", [40, 130, 180])
def test_a_reading_that_was_doubled_is_found_where_it_is(first: int) -> None:
    """Rows behind it are one late; how many they are does not matter."""
    rows = np.arange(200)
    (found,) = unrelated(reordered(table(200), np.where(rows < first, rows, rows - 1)))
    assert abs(found.rows[0] - first) <= 1
    assert "belongs to row k-1" in found.message


def test_outliers_do_not_make_a_table_unrelated() -> None:
    """A third of the measured poses may be wrong: they are for the cleaning to find."""
    rng = np.random.default_rng(4)
    rows, wrong = np.arange(60), rng.choice(60, 20, replace=False)
    rows[wrong] = rows[rng.permutation(wrong)]
    assert not unrelated(reordered(table(60), rows))
