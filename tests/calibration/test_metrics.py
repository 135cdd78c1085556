"""Laws of the error statistics."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.calibration.metrics import coverage, error_table, spread


def test_the_mean_is_of_absolute_values() -> None:
    """Errors of opposite sign do not cancel, and rmse^2 = mean^2 + sd^2."""
    leaf = spread(np.array([-3.0, 3.0, -1.0, 1.0]))
    assert leaf["mean"] == 2.0
    assert leaf["max"] == 3.0
    assert leaf["rmse"] ** 2 == pytest.approx(leaf["mean"] ** 2 + leaf["sd"] ** 2)


def test_missing_errors_are_left_out_and_none_at_all_is_nan() -> None:
    """NaN rows change nothing; without a single error every statistic is NaN."""
    assert spread(np.array([1.0, np.nan, 2.0])) == spread(np.array([1.0, 2.0]))
    assert all(np.isnan(v) for v in spread(np.array([np.nan])).values())


def test_units_are_millimetres_and_degrees() -> None:
    """A pose error of (3, 0, 4) mm and a quarter turn about z reads so in the table."""
    table = error_table(np.array([[3e-3, 0, 4e-3, 0, 0, np.pi / 2]]))
    assert table["position_mm"]["norm"]["mean"] == pytest.approx(5.0)
    assert table["position_mm"]["z"]["max"] == pytest.approx(4.0)
    assert table["rotation_deg"]["z"]["mean"] == pytest.approx(90.0)


def test_position_only_errors_have_no_rotation_table() -> None:
    """Where no orientation was measured the table does not invent one."""
    assert set(error_table(np.array([[1.0, 2.0, 3.0, np.nan, np.nan, np.nan]]))) == {"position_mm"}


def test_coverage_counts_the_fraction_inside() -> None:
    """Of ten errors uniform in steps of 0.1, half lie within 0.45."""
    errors = np.arange(10.0)[:, None] / 10
    assert coverage(errors, np.full((10, 1), 0.45))[0] == pytest.approx(0.5)
    assert np.isnan(coverage(np.full((3, 1), np.nan), np.ones((3, 1)))[0])
