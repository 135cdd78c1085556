"""Laws of the training region: inside, at the rim, far outside."""

from __future__ import annotations

import numpy as np
import pytest
from support import small_log

from gpcorrect.calibration import CommandCorrector, evaluate_model
from gpcorrect.correction import Correction
from gpcorrect.types import FloatArray, PoseSignal

CENTRE = np.array([0.1, 0.0, -0.1])
HALF_RANGE = 0.03  # m: how far the small recording goes along every axis


def at(corrector: CommandCorrector, position: FloatArray, angle: float = 0.0) -> Correction:
    return corrector.correct(np.concatenate([position, [np.cos(angle / 2), 0, 0, np.sin(angle / 2)]]), np.zeros(6))


RAYS = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]


def test_other_trajectories_of_the_same_motion_lie_inside(small_corrector: CommandCorrector) -> None:
    """Of samples at trajectories never seen at least 97 % are in domain."""
    inside = [evaluate_model(small_corrector, small_log(seed)).clean.in_domain.mean() for seed in (1, 2, 3)]
    assert np.mean(inside) > 0.97


@pytest.mark.parametrize("ray", RAYS, ids=str)
def test_every_way_out_crosses_the_rim_once(small_corrector: CommandCorrector, ray: FloatArray) -> None:
    """From the centre outward a pose is in domain up to the training's edge, out of it from some point on for good."""
    distance = np.linspace(0.0, 5 * HALF_RANGE, 151)
    inside = np.array([at(small_corrector, CENTRE + d * ray).in_domain for d in distance])
    assert inside[distance <= HALF_RANGE].all()
    assert not inside[distance >= 2.5 * HALF_RANGE].any()
    assert np.count_nonzero(np.diff(inside.astype(int))) == 1


@pytest.mark.parametrize("ray", RAYS, ids=str)
def test_intervals_widen_beyond_the_rim(small_corrector: CommandCorrector, ray: FloatArray) -> None:
    """From the training's edge outward intervals grow, but for two hundredths a step, to three times the rim's."""
    distance = np.linspace(1.2 * HALF_RANGE, 8 * HALF_RANGE, 40)
    rim = at(small_corrector, CENTRE + HALF_RANGE * ray).interval95[:3].mean()
    widths = np.array([at(small_corrector, CENTRE + d * ray).interval95[:3].mean() for d in distance])
    assert (np.diff(widths) > -0.02 * widths[1:]).all()
    assert widths[-1] > 3 * rim


def test_turning_the_tool_leads_out_of_the_region_too(small_corrector: CommandCorrector) -> None:
    """Turned by 10 degrees the tool is inside, by 120 outside, though orientation made no difference in training."""
    assert at(small_corrector, CENTRE, np.deg2rad(10)).in_domain
    turned = at(small_corrector, CENTRE, np.deg2rad(120))
    assert not turned.in_domain
    assert turned.status in ("EXTRAPOLATING", "LIMITED")
    assert "outside" in turned.reason


def test_speed_leads_out_of_the_region_too(small_corrector: CommandCorrector) -> None:
    """Ten times the fastest motion of the training is no more known than a far pose."""
    fast = small_corrector.correct(np.concatenate([CENTRE, [1, 0, 0, 0]]), np.array([0.8, 0.8, 0.8, 0, 0, 0]))
    assert not fast.in_domain


def test_far_from_everything_the_learned_part_is_its_mean(small_corrector: CommandCorrector) -> None:
    """Ten metres away every correction is the same within 1 %, as wide as the prior, and said to be extrapolated."""
    places = CENTRE + 10.0 * np.array(RAYS)  # as recorded: asked by a planner they are refused
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1))
    answers = small_corrector.correct_observed(PoseSignal(places, upright), np.zeros((len(places), 6)))
    assert not answers.in_domain.any()
    np.testing.assert_allclose(answers.interval95, answers.interval95[:1].repeat(len(places), 0), rtol=1e-2)
