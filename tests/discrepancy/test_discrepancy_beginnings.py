"""Motions that begin as no log says: a play at one end of its gap, a joint held where it came to rest."""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy_core import NOISE, RUNS, SAMPLES, joint_log, motors
from discrepancy_support import nominal

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.search.prepared import open_beginnings, prepare_data
from gpcorrect.sim.effects import Backlash, CableCoupling, CoulombFriction, Effect, HomingOffset, Hysteresis, play
from gpcorrect.types import CalibrationLog, FloatArray

RADIUS = 40 * NOISE


def _from_the_end() -> CalibrationLog:
    """Return a recording of a play of joint 1 that stands at one end of its gap when each motion begins."""
    path = motors(np.random.default_rng(3))[1][..., 0]
    ended = play(np.concatenate([path[:1] - 1.0, path]), RADIUS)[1:]
    more = np.zeros((SAMPLES, RUNS, 2))
    more[..., 0] = ended - path
    return joint_log(3, more=more)


def test_a_play_that_begins_at_an_end_of_its_gap_leaves_nothing_unknown() -> None:
    """Its samples before the joint has gone through the gap are off by the whole gap, and count for nothing."""
    found = find_discrepancy(nominal(), _from_the_end())
    assert [(e.name, e.joint, e.level) for e in found.effects] == [("backlash", 1, "EXACT")]
    assert found.level == "EXACT"
    assert {v.place: v.remaining < 0.3 for v in found.verdict.places} == {1: True, 2: True}
    (remark,) = [r for r in found.provenance.remarks if "how the motion began" in r]
    part = float(remark.split(" %")[0])
    assert 1.0 < part < 15.0


@pytest.mark.parametrize(
    ("effect", "needed"),
    [
        (Backlash(1, 0.02), {1: 0.04}),
        (Hysteresis(1, 0.02, depth=0.5), {1: 0.08}),
        (CoulombFriction(1, torque=0.3), {1: 0.0}),
        (CoulombFriction(1, torque=0.3, rest="elastic", bristle=60.0), {1: 0.01}),
        (CableCoupling(2, source=1, coefficient=0.1, drag=0.2, drag_radius=0.05), {1: 0.1}),
        (CableCoupling(2, source=1, coefficient=0.1), {}),
        (HomingOffset(1, 0.1), {}),
    ],
)
def test_what_has_a_memory_says_when_it_has_forgotten(effect: Effect, needed: dict[int, float]) -> None:
    """A play its gap, a hysteresis the way on which it turns round, friction any move; geometry remembers nothing."""
    assert effect.forgets_after() == pytest.approx(needed)


def test_samples_count_once_the_joint_has_gone_through_the_gap() -> None:
    """From there on in every motion, and always in the channel that the play does not change."""
    dataset = prepare_data(joint_log(3), nominal(), np.random.default_rng(0)).dataset
    left_open = open_beginnings(dataset, [Backlash(1, RADIUS)], [ChannelNoise(NOISE, 0.0, 1.0)] * 2)
    path: FloatArray = motors(np.random.default_rng(3))[1][..., 0]
    way = np.maximum.accumulate(path) - np.minimum.accumulate(path)
    assert (left_open[:, 0] == (way <= 2 * RADIUS).T.ravel()).all()
    assert not left_open[:, 1].any()
