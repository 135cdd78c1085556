"""Laws of updating: data in parts are data at once, what changed is followed, and what got worse is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_logs import joint_log
from scipy.special import stdtrit
from support import small_log

from gpcorrect import se3
from gpcorrect.calibration import (
    CommandCorrector,
    FitSettings,
    JointCorrector,
    Update,
    evaluate_model,
    fit_corrector,
    fit_model,
    load,
    save,
    update_model,
)
from gpcorrect.calibration.dataset import Samples
from gpcorrect.errors import DataError, LogError
from gpcorrect.gpr import SparseGPR
from gpcorrect.gpr.statistics import Points, resting_on
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal, Progress

SAG = 0.0068  # m: more than the smooth model explains, little more than the registration leaves


def aged_log(seed: int, amount: float, trajectories: int = 10) -> CalibrationLog:
    """Return a recording whose commands miss by further `amount` metres, wavelike over the workspace."""
    log = small_log(seed, trajectories, samples=40)
    p = log.tracker_cp.position
    extra = amount * np.sin(40 * p[:, [1, 2, 0]])
    return replace(log, setpoint_cp=PoseSignal(log.setpoint_cp.position + extra, log.setpoint_cp.quaternion))


@pytest.fixture(scope="module")
def corrector() -> CommandCorrector:
    return fit_corrector(
        aged_log(0, 0.0, trajectories=12), FitSettings(inducing=150, search_samples=150, marker="none")
    )


def mirrored(log: CalibrationLog) -> CalibrationLog:
    """Return a recording whose tracker has its first axis the other way."""
    p, q = log.tracker_cp.position * [-1, 1, 1], log.tracker_cp.quaternion * [1, 1, -1, -1]
    return replace(log, tracker_cp=PoseSignal(p, q))


def rmse(evaluation: object) -> float:
    table = evaluation.clean_errors["corrected"]  # type: ignore[attr-defined]
    return float(table["position_mm"]["norm"]["rmse"])


def test_data_in_two_parts_are_data_at_once() -> None:
    """Statistics of halves add up to those of all, what was added can be taken away, and predictions agree."""
    rng = np.random.default_rng(0)
    X = rng.normal(size=(400, 3))
    Y = np.column_stack([np.sin(X[:, 0]), X[:, 1] * X[:, 2]]) + 0.1 * rng.normal(size=(400, 2))
    model = SparseGPR(60, 40, n_learn=200).fit(X, Y)
    (part,), (whole,) = model.predictor_.parts, model.statistics_
    halves = (slice(250), slice(250, None))
    first, second = (Points.of(part).collect(X[rows], Y[rows], Progress()) for rows in halves)
    together = Points.of(part).posterior(first.plus(second))
    added, once = together.mean_std_batch(X), part.mean_std_batch(X)
    np.testing.assert_allclose(added[0], once[0], rtol=1e-6, atol=1e-7)
    for a, b in zip(added[1:], once[1:], strict=True):  # differences of inverses, whose rounding depends on the machine
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-7)
    np.testing.assert_allclose(whole.minus(second).G, first.G, atol=1e-9 * len(X))


def test_statistics_survive_a_file(corrector: CommandCorrector, tmp_path: Path) -> None:
    """Saved and loaded, the same update gives the same model to the last bit."""
    save(corrector, tmp_path / "m.gpc")
    again = load(tmp_path / "m.gpc")
    one, other = (update_model(c, aged_log(1, 0.002)).corrector for c in (corrector, again))
    for a, b in zip(one.law.learned.predictor.parts, other.law.learned.predictor.parts, strict=True):
        np.testing.assert_array_equal(a.alpha, b.alpha)


def test_a_changed_robot_is_followed(corrector: CommandCorrector) -> None:
    """After a change of 3 mm the update takes two fifths of the held-out error away, and covers what is left."""
    found = update_model(corrector, aged_log(1, 0.003, trajectories=15))
    assert rmse(found.after) < 0.6 * rmse(found.before)
    assert found.worse == ()
    assert found.keep < 1.0
    assert np.nanmean(found.after.clean.coverage95) > np.nanmean(found.before.clean.coverage95)
    assert np.nanmean(found.after.clean.coverage95) > 0.85


def test_an_unchanged_robot_loses_nothing_and_the_size_stays(corrector: CommandCorrector) -> None:
    """More of the same changes the error by less than a tenth for the worse; every array keeps its shape."""
    found = update_model(corrector, aged_log(2, 0.0))
    assert rmse(found.after) < 1.1 * rmse(found.before)
    twice = update_model(found.corrector, aged_log(3, 0.0)).corrector
    sizes = [[part.basis.shape for part in c.law.learned.predictor.parts] for c in (corrector, twice)]
    assert sizes[0] == sizes[1]
    assert [part.G.shape for part in twice.law.learned.statistics] == [
        part.G.shape for part in corrector.law.learned.statistics
    ]
    assert len(twice.summary["updates"]) == 2


def test_few_new_motions_promise_no_more_than_they_know(
    corrector: CommandCorrector, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Intervals are widened by Student's t as a fit's are; outside the region they stay as wide as they were."""
    few = aged_log(4, 0.001, trajectories=6)
    law = update_model(corrector, few, holdout=0.0).corrector.law
    monkeypatch.setattr(Samples, "widening", 1.0)
    plain = update_model(corrector, few, holdout=0.0).corrector.law
    ratio = law.intervals.factor / plain.intervals.factor
    np.testing.assert_allclose(ratio, stdtrit(5, 0.975) * np.sqrt(1 + 1 / 6) / 1.959964, rtol=1e-5)
    for updated in (law, plain):
        width = updated.domain.spread * updated.intervals.factor
        np.testing.assert_allclose(width, corrector.law.domain.spread * corrector.law.intervals.factor)


def test_joints_that_move_further_are_learned_there() -> None:
    """Where joint 1 leaves the old region, what the linear law says at its edge was learned from as its error."""
    settings = FitSettings(time_offset="none")
    corrector = fit_model(joint_log(1, 8, 12.0, first=0.3), settings, task=JointCorrector).corrector
    found = update_model(corrector, joint_log(2, 12, 12.0), holdout=0.25)
    assert found.before is not None
    assert found.after is not None
    before, after = (np.sqrt(np.nanmean(e.clean.corrected[:, 0] ** 2)) for e in (found.before, found.after))
    assert after < before


@pytest.fixture(scope="module")
def joints() -> JointCorrector:
    settings = FitSettings(time_offset="none")
    found: JointCorrector = fit_model(joint_log(11, 16, 12.0), settings, task=JointCorrector).corrector
    return found


def errors_of(found: Update) -> tuple[FloatArray, FloatArray]:
    """Root mean square errors `(3,)` of joints at held-out new trajectories, before and after an update."""
    assert found.before is not None
    assert found.after is not None
    before, after = (np.sqrt((e.clean.corrected**2).mean(axis=0)) for e in (found.before, found.after))
    return before, after


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_another_zero_is_followed_everywhere(joints: JointCorrector, seed: int) -> None:
    """Of a zero moved by .03 rad a dozen trajectories leave less than a twentieth; other joints are as healthy."""
    (before, after), (_, healthy) = (
        errors_of(update_model(joints, joint_log(seed, 12, 12.0, shift=shift), holdout=0.25)) for shift in (0.03, 0.0)
    )
    assert after[1] < before[1] / 20
    assert (after[[0, 2]] < 1.02 * healthy[[0, 2]]).all()


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_joints_that_did_not_change_are_no_worse_and_seen(joints: JointCorrector, seed: int) -> None:
    """Motion of the same kind makes no joint worse, and none of it is called new; a joint that goes further is."""
    found = update_model(joints, joint_log(seed, 12, 12.0), holdout=0.25)
    before, after = errors_of(found)
    assert found.worse == ()
    assert (after < 1.05 * before).all()
    assert found.unseen < 0.05


def test_noise_is_not_learned_where_the_fit_found_no_field(joints: JointCorrector) -> None:
    """A joint that the regression was of no use to stays with its linear law."""
    learned = joints.law.learned
    statistics = tuple(replace(part, Vy=0.0 * part.Vy) for part in learned.statistics)
    points = tuple(map(Points.of, learned.predictor.parts))
    without = replace(learned, statistics=statistics, predictor=resting_on(points, statistics))
    plain = replace(joints, law=replace(joints.law, learned=without))
    log = joint_log(5, 12, 12.0)
    rng = np.random.default_rng(0)
    # Each trajectory errs by itself, as by its slack: no field says anything of the next.
    own = 0.02 * rng.standard_normal((12, 3))[log.trajectory] * (1 + 0.5 * np.sin(8 * log.external_jp[:, [1]]))
    found = update_model(plain, replace(log, external_jp=log.external_jp + own), holdout=0.25)
    assert not any(part.Vy.any() for part in found.corrector.law.learned.statistics)


def test_worse_by_chance_is_not_worse(joints: JointCorrector) -> None:
    """A growth that trajectories do not agree on is borne up to a twentieth; one that they agree on is not."""
    found = update_model(joints, joint_log(6, 12, 12.0), holdout=0.25)
    clean = found.before.clean
    place = np.searchsorted(np.unique(clean.trajectory), clean.trajectory)

    def grown(*factors: float) -> Update:
        errors = 0.01 * np.sqrt(factors)[place, None] * np.ones(3)
        return replace(
            found,
            before=replace(found.before, clean=replace(clean, corrected=np.full(errors.shape, 0.01))),
            after=replace(found.before, clean=replace(clean, corrected=errors)),
        )

    assert grown(1.2, 1.1, 0.78).worse == ()
    assert len(grown(1.05, 1.06, 1.04).worse) == 3
    assert len(grown(3.0, 1.0, 0.2).worse) == 3


def test_what_got_worse_is_said(corrector: CommandCorrector) -> None:
    """New data whose held-out trajectories contradict the others make the update call itself worse."""
    bad = aged_log(5, 0.004, trajectories=12)
    found = update_model(corrector, _spliced(bad, bad.trajectory >= 9), holdout=0.25)
    assert "position" in found.worse


def _spliced(log, held):  # type: ignore[no-untyped-def]
    """Return the log whose held-out trajectories show the robot as it was at the fit."""
    from gpcorrect.types import PoseSignal

    before = aged_log(5, 0.0, trajectories=12)
    position = np.where(held[:, None], before.setpoint_cp.position, log.setpoint_cp.position)  # type: ignore[union-attr]
    return replace(log, setpoint_cp=PoseSignal(position, log.setpoint_cp.quaternion))


def test_scores_are_about_one_while_the_model_holds(corrector: CommandCorrector) -> None:
    """Healthy trajectories score about as those left out at the fit, changed ones far more."""
    logs = [aged_log(6, amount) for amount in (0.0, 0.004)]
    healthy, changed = (corrector.measure(log, corrector.clean_afresh(log).keep).scores for log in logs)
    baseline = np.array(corrector.summary["baseline"])
    assert 0.3 < healthy.mean() / baseline.mean() < 1.5
    assert changed.mean() > 2 * healthy.mean()


def test_a_method_that_takes_no_more_data_is_refused() -> None:
    """Only a Gaussian process rests on sums that go on, and that is said."""
    linear = fit_corrector(aged_log(0, 0.0, trajectories=6), FitSettings(method="linear", marker="none"))
    with pytest.raises(DataError, match="take more data"):
        update_model(linear, aged_log(1, 0.0))


def sagging_log(seed: int, amount: float) -> CalibrationLog:
    """Return a recording of an arm that hangs lower by `amount` metres everywhere, as under a load."""
    log = aged_log(seed, 0.0, 15)
    down = np.array([0.0, 0.0, amount])
    return replace(log, tracker_cp=PoseSignal(log.tracker_cp.position - down, log.tracker_cp.quaternion))


def test_a_load_that_fails_all_samples_is_measured_and_learned(corrector: CommandCorrector) -> None:
    """Thresholds of the training pass none: the recording's own do, which is said first, and an update follows."""
    log = sagging_log(1, SAG)
    assert not corrector.clean(log).keep.any()
    measured = evaluate_model(corrector, log)
    assert len(measured.clean.rows) > 0.9 * len(log)
    assert "CHANGED" in measured.cautions[0]
    assert any("does not lessen" in caution or "takes away only" in caution for caution in measured.cautions)
    assert not any("rows were exchanged" in caution for caution in measured.cautions)  # the cause is known
    assert rmse(measured) > 0.8e3 * SAG
    assert rmse(update_model(corrector, log).after) < 0.5 * rmse(measured)


def test_a_tracker_that_was_moved_is_not_learned_as_the_robots_error(corrector: CommandCorrector) -> None:
    """A recording in another frame is refused, whatever is forced: the registration stays, and would be corrected."""
    log = aged_log(1, 0.0)
    assert log.tracker_cp.quaternion is not None
    turn = se3.matrix_from_rotvec(np.array([0.0, 0.0, np.deg2rad(20.0)]))
    turned = se3.quaternion_from_matrix(turn @ se3.matrix_from_quaternion(log.tracker_cp.quaternion))
    moved = replace(log, tracker_cp=PoseSignal(log.tracker_cp.position @ turn.T, turned))
    with pytest.raises(LogError, match="robot and frames"):
        update_model(corrector, moved)
    assert "CHANGED" in evaluate_model(corrector, moved).cautions[0]  # may be a heavy load: measured, not learned
    for other in (sagging_log(1, 0.3), mirrored(log)):
        with pytest.raises(LogError, match="robot and frames"):
            update_model(corrector, other)
        with pytest.raises(LogError, match="robot and frames"):
            evaluate_model(corrector, other)
