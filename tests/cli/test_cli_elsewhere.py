"""A model measured where it does not hold, as after another homing: what its figures hide is said beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from support import small_log

from gpcorrect.logs import write_log
from gpcorrect.types import PoseSignal

FEW, NARROW = "samples pass cleaning by the training's thresholds", "95 % intervals cover only"


@pytest.mark.parametrize(("moved", "said"), [(0.0, ()), (0.0006, (NARROW,)), (0.001, (FEW, NARROW))])
def test_figures_that_hold_for_few_samples_are_not_left_alone(
    gpcorrect: CommandLine, small_model: Path, tmp_path: Path, moved: float, said: tuple[str, ...]
) -> None:
    """A zero that moved by 0.6 mm on average breaks the intervals; by 1 mm, most samples do not pass as well."""
    log = small_log(seed=2, trajectories=8)
    shift = moved * np.array([1.0, -1.0, 1.0]) * (0.5 + log.trajectory[:, None] / 8)  # some trajectories still pass
    command = PoseSignal(log.setpoint_cp.position + shift, log.setpoint_cp.quaternion)
    write_log(replace(log, setpoint_cp=command), tmp_path / "moved.csv")
    result = gpcorrect("evaluate", small_model, tmp_path / "moved.csv")
    assert result.code == 0
    for sentence in (FEW, NARROW):
        assert (sentence in result.said) == (sentence in said)
    assert "of all samples)" in result.out
