"""Where nothing is hidden, the product's nominal model explains MuJoCo's recording to well below its noise."""

from __future__ import annotations

import numpy as np
import pytest
from mujoco_cases import in_rows, product_run, truth

from gpcorrect.arms import arm_named

MOTOR = 0.1  # of the noise's RMS: most that the motors may differ by, RMS
LINK = 0.15  # the same of links and tool: the machine's table has small errors of its own that nobody declares


CASES = [("raven2_left", 11), ("raven2_left", 13), ("raven2_left", 18)]
CASES += [("dvrk_psm", 12), ("dvrk_psm", 13), ("dvrk_psm", 14)]


@pytest.mark.parametrize(("arm", "seed"), CASES)
def test_motors_and_links_move_as_the_nominal_model_says(arm: str, seed: int) -> None:
    """Gravity, inertia, feedforward, gains and payload agree: all differ by small parts of the noise."""
    case = truth(arm, "both", seed)
    log, readings, rows = case.case.log, case.readings, case.setting.reference.logged
    outcome = product_run(dict(case.case.nominal), log)
    noise = np.array(case.case.labels["nuisance"]["joint_noise_rms"])
    for ours, theirs, most in (
        (outcome.motion.position, readings.reported[rows], MOTOR),
        (outcome.q, readings.outside[rows], LINK),
    ):
        left = in_rows(ours) - theirs
        assert (np.sqrt(np.mean(left**2, axis=0)) < most * noise).all()
    effort = in_rows(outcome.torque) - log.measured_jf
    assert (np.sqrt(np.mean(effort**2, axis=0)) < 0.02 * np.std(log.measured_jf, axis=0) + 0.01).all()


@pytest.mark.parametrize("arm", ["raven2_left", "dvrk_psm"])
def test_every_sort_of_feedforward_is_compared(arm: str) -> None:
    """The cases above cover what a controller may feed forward."""
    drawn = {truth(arm, "both", s).case.nominal["controller"]["feedforward"] for a, s in CASES if a == arm}
    assert drawn == {"none", "gravity", "rigid-body"}


@pytest.mark.parametrize("arm", ["raven2_left", "dvrk_psm"])
def test_tool_poses_are_the_arms_own(arm: str) -> None:
    """MuJoCo's kinematics of the links and the product's differ by the machine's undeclared table errors only."""
    case = truth(arm, "both", 11)
    rows = case.setting.reference.logged[::50]
    q = case.readings.outside[rows]
    ours = arm_named(arm).chain.forward(np.column_stack([q, np.zeros((len(q), 3))]))
    theirs = case.readings.tip[rows]
    assert np.abs(ours[:, :3, 3] - theirs[:, :3, 3]).max() < 5 * 8e-5
    assert np.abs(ours[:, :3, :3] - theirs[:, :3, :3]).max() < 6 * 6e-5 * 2


def test_bare_joints_show_where_the_motors_are() -> None:
    """Of the industrial arm only joints are known: outside sensors see the motors and their own noise."""
    case = truth("ur5", "bare", 11)
    log = case.case.log
    assert "controller" not in case.case.nominal
    noise = np.array(case.case.labels["nuisance"]["joint_noise_rms"])
    residual = log.external_jp - log.measured_jp
    spread = 1.4826 * np.nanmedian(np.abs(residual), axis=0)
    assert (spread < 1.25 * noise).all()
    assert (np.abs(np.nanmedian(residual, axis=0)) < 0.3 * noise).all()
