"""The region of trust: what laws that extrapolate read of inputs outside it, and what poses outside it are answered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_logs import joint_log
from support import real_data, small_log

from gpcorrect.calibration import CommandCorrector, FitSettings, JointCorrector, evaluate_model
from gpcorrect.calibration.domain import Domain, Surroundings
from gpcorrect.calibration.fit import fit_model
from gpcorrect.calibration.model_file import load, save
from gpcorrect.correction import Correction
from gpcorrect.errors import DataError
from gpcorrect.logs import read_log
from gpcorrect.types import FloatArray, IntArray, PoseSignal

REGION = Domain.of(
    np.random.default_rng(0).uniform(-1.0, 3.0, (2000, 2)),
    np.zeros(2),
    1.0,
    np.ones((2000, 1)),
    fading=np.array([1]),
)


def test_rates_fade_to_the_middle_and_positions_stay_at_the_edge() -> None:
    """Inside the training range nothing changes; outside the region a rate is at its middle, a position at the edge."""
    inside = np.random.default_rng(1).uniform(-0.9, 2.9, (100, 2))
    np.testing.assert_allclose(REGION.clip(inside), inside, atol=1e-12)
    far = np.array([[9.0, 9.0], [-9.0, -9.0], [9.0, REGION.high[1]]])
    read = REGION.clip(far)
    np.testing.assert_allclose(read[:, 0], np.where(far[:, 0] > 0, REGION.high[0], REGION.low[0]))
    np.testing.assert_allclose(read[:, 1], (REGION.low[1] + REGION.high[1]) / 2)


def test_what_a_law_reads_of_a_rate_never_jumps() -> None:
    """Along a rate's line steps stay below a few times the line's own, and it never goes beyond its training range."""
    line = np.linspace(-8.0, 8.0, 4001)
    read = REGION.clip(np.column_stack([np.ones_like(line), line]))[:, 1]
    assert np.abs(np.diff(read)).max() < 2.5 * np.diff(line).max()
    assert read.min() > -1.1
    assert read.max() < 3.1


def test_a_region_from_before_rates_faded_clips_as_it_did() -> None:
    """Model files without the list of rates answer as they were fitted."""
    before = replace(REGION, fading=np.zeros(0, dtype=np.int64), kept=np.zeros(0))
    assert before.clip(np.array([[0.0, 9.0]]))[0, 1] == REGION.high[1]


def test_rates_that_training_knew_do_not_fade() -> None:
    """Rates whose fastest hundredth lies beyond the range of the rest are read as they are, wild ones not."""
    rng = np.random.default_rng(2)
    rates = rng.laplace(size=(5000, 1))
    region = Domain.of(rates, np.zeros(1), 1.0, np.ones((5000, 1)), fading=np.array([0]))
    ends = 0.75 * region.high[0]
    known = rates[np.abs(rates[:, 0]) < ends]
    assert np.abs(known).max() > 1.3 * np.percentile(np.abs(rates), 99)
    np.testing.assert_allclose(region.clip(known), known, atol=1e-2 * ends)
    wild = Domain.of(np.vstack([rates, [[1e3]]]), np.zeros(1), 1.0, np.ones((5001, 1)), fading=np.array([0]))
    assert np.abs(wild.clip(np.linspace(-50, 50, 999)[:, None])).max() < 1.1 * ends


def test_what_no_training_sample_was_near_is_outside() -> None:
    """Inputs that moved together in training are known where they do, not wherever each alone is in its range."""
    rng = np.random.default_rng(3)
    along = rng.uniform(-1.0, 1.0, (3000, 1))
    X, number = along + 0.02 * rng.standard_normal((3000, 3)), np.arange(3000) // 300
    near = Surroundings.of(X, number)
    assert near.hold(X).mean() > 0.98
    apart = rng.permuted(X, axis=0)
    away = np.ptp(apart, axis=1) > 0.5
    assert not near.hold(apart[away]).any()
    assert near.joined(apart[:400]).hold(apart[:400]).all()
    far = np.full((1, 3), 1e150)
    assert not near.hold(far).any()


def test_a_place_that_no_training_sample_was_near_is_outside_however_many_other_inputs_are_usual() -> None:
    """Two joints beyond the training are not lost among forty inputs that are as ever."""
    rng = np.random.default_rng(4)
    X, number, place = rng.uniform(-1.0, 1.0, (3000, 42)), np.arange(3000) // 300, np.arange(2)
    near = Surroundings.of(X, number, place)
    assert near.hold(X).mean() > 0.98
    away = X.copy()
    away[:, place] = 1.4 * np.sign(away[:, place])
    assert Surroundings.of(X, number).hold(away).any()
    assert not near.hold(away).any()
    joined = near.joined(away)
    assert joined.hold(away).mean() > 0.5
    with pytest.raises(DataError, match="places"):
        replace(near, place=np.array([42]))


@pytest.mark.parametrize("place", [np.arange(0), np.array([3, 1])])
def test_an_input_is_near_where_some_point_is(place: IntArray) -> None:
    """As all distances say, one after the other; the compiled search stops at the first."""
    rng = np.random.default_rng(7)
    X = rng.standard_normal((1200, 5)) @ rng.standard_normal((5, 5))
    near = Surroundings.of(X, np.arange(1200) // 100, place)
    asked = rng.permuted(1.4 * X, axis=0)[:, ::-1][:, :5]  # a view: neither its order nor its flags matter
    away = (near.scaler.apply(asked)[:, None] - near.points) ** 2
    expected = (away.sum(axis=2) <= near.farthest**2).any(axis=1)
    expected &= (away[..., place].sum(axis=2) <= near.farthest_place**2).any(axis=1)
    assert 0.05 < expected.mean() < 0.95
    np.testing.assert_array_equal(near.hold(asked), expected)


def test_points_that_do_not_fit_the_inputs_are_refused() -> None:
    """A damaged file compares no inputs with points of another size."""
    near = Surroundings.of(np.random.default_rng(0).standard_normal((100, 2)), np.arange(100) // 10)
    with pytest.raises(DataError, match="surround"):
        replace(near, points=near.points[:, :1])
    with pytest.raises(DataError, match="surround"):
        replace(near, points=near.points[:0])
    with pytest.raises(DataError, match="bounded inputs"):
        replace(REGION, near=Surroundings.of(np.zeros((100, 3)), np.arange(100) // 10))


@pytest.mark.parametrize("method", ["linear", "gp", "trees"])
def test_a_motion_of_another_kind_is_outside_whatever_was_learned(method: str, tmp_path: Path) -> None:
    """Learned where joint 2 follows joint 1 and used where it does not, each in its range; a model file keeps that."""
    other = joint_log(4, trajectories=8)
    together = other.measured_jp.copy()
    together[:, 1] = 0.4 + together[:, 0] + 0.02 * (other.measured_jp[:, 1] - other.measured_jp[:, 1].mean())
    log = replace(other, measured_jp=together, external_jp=other.external_jp + together - other.measured_jp)
    last = log.trajectory >= 6
    settings = FitSettings(method=method, features=("position",), inducing=60)
    fitted = fit_model(log.select(~last), settings, task=JointCorrector).corrector
    save(fitted, tmp_path / "model.gpc")
    corrector = load(tmp_path / "model.gpc", JointCorrector)
    own, foreign = (corrector.correct_log(part) for part in (log.select(last), other.select(last)))
    assert own.in_domain.mean() > 0.97
    apart = np.abs(np.diff(other.measured_jp[last][:, :2], axis=1)[:, 0] - 0.4) > 0.3
    ranges = replace(corrector, law=replace(corrector.law, domain=replace(corrector.law.domain, near=None)))
    assert ranges.correct_log(other.select(last)).in_domain[apart].mean() > 0.3
    assert not foreign.in_domain[apart].any()
    assert (foreign.std[apart] >= corrector.law.domain.spread).all()


@pytest.mark.slow
def test_a_faster_recording_is_not_made_worse_by_what_slow_motion_taught() -> None:
    """Joint 1 of the dVRK, learned from slow random motion and used on fast picking, was 2.3 times worse than raw."""
    slow, fast = read_log(real_data("dvrk_random.csv")), read_log(real_data("dvrk_pick_place.parquet"))
    corrector = fit_model(slow, FitSettings(method="linear"), task=JointCorrector).corrector
    errors = evaluate_model(corrector, fast).dirty_errors
    ratio = [c["rmse"] / r["rmse"] for c, r in zip(errors["corrected"], errors["raw"], strict=True)]
    assert ratio[0] < 1.05
    assert max(ratio[3], ratio[5]) < 0.5


@pytest.mark.slow
def test_a_model_of_one_task_does_not_claim_to_know_any_motion() -> None:
    """Of random motion, a model of pick-and-place said that 97 % was inside, where 37 % of wrist intervals held."""
    fast, random = read_log(real_data("dvrk_pick_place.parquet")), read_log(real_data("dvrk_random.csv"))
    corrector = fit_model(fast, task=JointCorrector).corrector
    measured = evaluate_model(corrector, random).dirty
    assert measured.in_domain.mean() < 0.5
    assert (measured.coverage95 > 0.9).all()


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


def test_surroundings_that_are_joined_stay_as_many_and_hold_both() -> None:
    """However often a model is updated, no more training inputs are kept: those farthest from each other."""
    rng = np.random.default_rng(3)
    here, there = (rng.standard_normal((2000, 2)) + np.array([shift, 0.0]) for shift in (0.0, 12.0))
    near = Surroundings.of(here, np.arange(2000) // 100)
    assert not near.hold(there).any()
    for _ in range(3):
        near = near.joined(there)
        assert len(near.points) == 500
    assert near.hold(here).mean() > 0.99
    assert near.hold(there).mean() > 0.99
