"""Nothing happens at +-180 degrees: a corrector learned around there is as smooth as elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import short_search, small_log

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, FitSettings, fit_corrector
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

HALF_TURNS = {"about z": [0, 0, np.pi], "slanted": [2.2, -1.3, 1.8]}


def turned(log: CalibrationLog, R: FloatArray) -> CalibrationLog:
    """Return the log with the tool held differently: every orientation of both signals times R."""
    signals = {}
    for name in ("tracker_cp", "setpoint_cp"):
        signal: PoseSignal = getattr(log, name)
        assert signal.quaternion is not None
        quaternion = se3.quaternion_from_matrix(se3.matrix_from_quaternion(signal.quaternion) @ R)
        signals[name] = PoseSignal(signal.position, quaternion)
    return replace(log, **signals)


@pytest.fixture(scope="module", params=list(HALF_TURNS))
def around_half_a_turn(request: pytest.FixtureRequest) -> tuple[CommandCorrector, FloatArray]:
    """Return a corrector learned around half a turn, and the turn."""
    R = se3.matrix_from_rotvec(np.array(HALF_TURNS[request.param]))
    with short_search():
        return fit_corrector(turned(small_log(), R), FitSettings(marker="none", inducing=300)), R


@pytest.mark.parametrize("axis", range(3))
def test_corrections_are_continuous_across_half_a_turn(
    around_half_a_turn: tuple[CommandCorrector, FloatArray], axis: int
) -> None:
    """Along +-20 degrees in steps of a tenth no correction moves by more than 20 um or 0.05 degrees a step."""
    corrector, R = around_half_a_turn
    path = se3.matrix_from_rotvec(np.deg2rad(np.linspace(-20, 20, 401))[:, None] * np.eye(3)[axis]) @ R
    quaternions = se3.quaternion_from_matrix(path)
    answers = [corrector.correct(np.concatenate([[0.1, 0.0, -0.1], q]), np.zeros(6)) for q in quaternions]
    residual = se3.rotvec_from_matrix(
        se3.matrix_from_quaternion(np.array([a.quaternion for a in answers])) @ np.swapaxes(path, -1, -2)
    )
    positions, widths = np.array([a.position for a in answers]), np.array([a.interval95 for a in answers])
    assert np.abs(np.diff(positions, axis=0)).max() < 2e-5
    assert np.rad2deg(np.abs(np.diff(residual, axis=0)).max()) < 0.05
    assert np.abs(np.diff(np.log(widths), axis=0)).max() < 0.2


def test_the_way_the_tool_is_held_does_not_matter(
    around_half_a_turn: tuple[CommandCorrector, FloatArray], small_corrector: CommandCorrector
) -> None:
    """Learned around half a turn the errors on other trajectories are those learned around none."""
    from gpcorrect.calibration import evaluate_model

    corrector, R = around_half_a_turn
    there = evaluate_model(corrector, turned(small_log(seed=1), R)).dirty_errors["corrected"]
    here = evaluate_model(small_corrector, small_log(seed=1)).dirty_errors["corrected"]
    for part in ("position_mm", "rotation_deg"):
        assert there[part]["norm"]["rmse"] < 1.2 * here[part]["norm"]["rmse"]
