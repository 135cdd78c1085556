"""A limit of torque that one motion of twelve reaches, on MuJoCo's machine: named from that motion alone."""

from __future__ import annotations

import mujoco_cases  # skips where MuJoCo is missing
import numpy as np
import pytest

from gpcorrect.discrepancy import Level, find_discrepancy
from gpcorrect.sim import model_from_dict


@pytest.mark.slow
def test_a_limit_that_is_reached_once_is_named() -> None:
    """No other motion shows it; within this one, what some of its pieces teach holds in the others."""
    spec = mujoco_cases.Spec(
        "one", "dvrk_psm", ("torque_saturation",), 2.0, signals="joints", trajectories=12, seconds=5.0
    )
    case = mujoco_cases.make_truth(spec, 1).case
    hidden = case.labels["effects"][0]
    found = find_discrepancy(model_from_dict(case.nominal), case.log)
    assert found.level == Level.EXACT
    (effect,) = found.effects
    assert (effect.name, effect.joint) == ("torque_saturation", hidden["joint"])
    low, high = effect.parameters["limit"].ci95
    assert low <= hidden["params"]["limit"] <= high
    assert any("cut into pieces" in remark for remark in found.provenance.remarks)
    np.testing.assert_allclose(effect.parameters["limit"].value, hidden["params"]["limit"], rtol=1e-2)


@pytest.mark.slow
def test_an_arm_that_sank_before_its_motions_began_is_named() -> None:
    """What the drive cannot hold sinks in the pauses that no log has: its motions begin millimetres off, and moving."""
    spec = mujoco_cases.Spec("one", "dvrk_psm", ("torque_saturation",), 2.0, trajectories=12, seconds=10.0)
    case = mujoco_cases.make_truth(spec, 3300108).case
    log = case.log
    first = np.flatnonzero(np.diff(log.trajectory, prepend=-1))
    assert np.abs(log.measured_jp - log.setpoint_jp)[first, 2].max() > 4e-3
    found = find_discrepancy(model_from_dict(case.nominal), log, seed=3300108)
    (effect,) = found.effects
    assert (effect.name, effect.joint, effect.level) == ("torque_saturation", 3, Level.EXACT)
    low, high = effect.parameters["limit"].ci95
    assert low <= case.labels["effects"][0]["params"]["limit"] <= high
    assert high - low < 0.05
