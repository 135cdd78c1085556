"""What is named is the same in every motion, and of two laws of one family the fuller one has its say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import RUNS, SAMPLES, joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy import Level, find_discrepancy
from gpcorrect.sim.effects import Hysteresis, PulleyEccentricity
from gpcorrect.types import CalibrationLog

ERROR, WAVES = 0.01, 6.0


def _wave(spread: float) -> CalibrationLog:
    """A wave of joint 1 over its position, whose size differs from motion to motion by that part of itself."""
    plain = joint_log(3)
    seen = joint_log(3, PulleyEccentricity(joint=1, amplitude=ERROR, waves=WAVES, phase=0.3))
    of_run = 1.0 + spread * np.random.default_rng(5).standard_normal(RUNS)
    assert plain.external_jp is not None and seen.external_jp is not None
    size = np.repeat(of_run, SAMPLES)[:, None]
    return replace(seen, external_jp=plain.external_jp + size * (seen.external_jp - plain.external_jp))


@pytest.mark.parametrize(("spread", "level"), [(0.0, Level.EXACT), (0.6, Level.UNKNOWN)])
def test_a_size_that_differs_from_motion_to_motion_is_no_name(spread: float, level: Level) -> None:
    """The same wave is named where it is as large in every motion, and is something unknown where it is not."""
    found = find_discrepancy(nominal(), _wave(spread))
    assert found.level == level
    assert {e.name for e in found.effects} == ({"pulley_eccentricity"} if level == Level.EXACT else set())
    if level == Level.UNKNOWN:
        assert any("from trajectory to trajectory" in r for n in found.not_named for r in n.reasons)


def test_a_slack_of_half_the_motion_is_a_hysteresis() -> None:
    """After a reversal half of the motion is lost, with a corner where it ends: no backlash, which loses all of it."""
    hidden = Hysteresis(joint=1, radius=0.004, sharpness=8.0, depth=0.5, law="plays")
    (effect,) = find_discrepancy(nominal(), joint_log(4, hidden)).effects
    assert (effect.name, effect.level) == ("hysteresis", Level.EXACT)
