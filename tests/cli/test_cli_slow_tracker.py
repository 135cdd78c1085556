"""A tracker slower than the log: between its samples the cells are empty, and nothing was lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, written
from support import small_log

from gpcorrect.types import CalibrationLog, PoseSignal


def between(log: CalibrationLog, every: int) -> CalibrationLog:
    """Return a log with as many rows for each sample of its tracker, whose cells are empty in all but the first."""
    rows = np.repeat(np.arange(len(log)), every)
    place = np.arange(len(rows)) % every
    fine = log.select(rows)
    assert fine.tracker_cp.quaternion is not None
    position, quaternion = (
        np.where(place[:, None] > 0, np.nan, part) for part in (fine.tracker_cp.position, fine.tracker_cp.quaternion)
    )
    return replace(fine, time=fine.time + 0.02 / every * place, tracker_cp=PoseSignal(position, quaternion))


@pytest.mark.parametrize("every", [3, 12])
def test_empty_cells_between_the_samples_of_a_tracker_cost_nothing(
    gpcorrect: CommandLine, tmp_path: Path, every: int
) -> None:
    """They are learned from and measured on as if they stood alone, where eleven rows of twelve are empty too."""
    log, errors = small_log(), []
    for number, recording in enumerate((log, between(log, every))):
        path, model = written(recording, tmp_path / f"{number}.csv"), tmp_path / f"{number}.gpc"
        done = gpcorrect("fit", path, "--output", model, "--json", "--time-offset", "none")
        assert done.code == 0, done.said
        again = gpcorrect("evaluate", model, path, "--json", "--time-offset", "none").json
        assert done.json["n_train"] > 700
        errors.append([found["errors"]["corrected"]["position_mm"]["norm"]["rmse"] for found in (done.json, again)])
    np.testing.assert_allclose(*errors, rtol=0.05)
