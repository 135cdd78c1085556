"""Rows side by side: nothing is lost, and the smaller grid is taken."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.discrepancy.recording.layout import layout_of

ALIKE = np.repeat(np.arange(4), 2000)  # whole motions pad nothing, pieces would repeat their warm-ups
ONE_LONG = np.repeat(np.arange(21), [6000, *[100] * 20])  # whole motions would be padded to the long one


@pytest.mark.parametrize("label", [ALIKE, ONE_LONG], ids=["alike", "one long"])
def test_every_row_comes_back(label: np.ndarray) -> None:
    """What is spread over the grid is gathered again, row by row."""
    layout, values = layout_of(label, piece=200, warm_up=400), np.arange(float(len(label)))
    np.testing.assert_array_equal(layout.gather(layout.spread(values), len(label)), values)


def test_the_smaller_grid_is_taken() -> None:
    """Motions of one length stay whole; one long motion among short ones is cut, each piece after its warm-up."""
    assert layout_of(ALIKE, piece=200, warm_up=400).rows.shape == (2000, 4)
    cut = layout_of(ONE_LONG, piece=200, warm_up=400)
    assert cut.rows.shape == (600, 30 + 20)
    assert cut.rows.size < layout_of(ONE_LONG).rows.size
    np.testing.assert_array_equal(cut.rows[cut.valid[:, 5], 5], np.arange(1000, 1200))
    assert cut.rows[0, 5] == 600
