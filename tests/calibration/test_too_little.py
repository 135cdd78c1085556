"""Few motions: intervals are as wide as little knowledge is, and the clock of held-out truth is never moved unasked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log
from support import real_data, short_search, small_log

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model, run_experiment
from gpcorrect.errors import LogError
from gpcorrect.logs import align, read_log
from gpcorrect.logs.validate import validate_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog

LATE = 0.4


@pytest.fixture(scope="module")
def reaches() -> CalibrationLog:
    """Return 14 simulated reaches without faults."""
    return debridement_log(3, reaches=14, faults=False)


@pytest.mark.parametrize("count", [1, 3])
def test_few_motions_promise_no_more_than_they_know(reaches: CalibrationLog, count: int) -> None:
    """Errors on other motions lie inside the intervals of a model of one or three, which says that these are few."""
    with short_search(60):
        result = fit_model(reaches.select(reaches.trajectory < count), FitSettings(inducing=30, marker="none"))
    assert any("motion" in remark and "widened" in remark for remark in result.remarks)
    others = reaches.select(reaches.trajectory >= 6)
    measured = result.corrector.measure(others, np.ones(len(others), dtype=bool))
    inside = np.abs(measured.corrected) <= measured.interval95
    near = inside[measured.in_domain]
    assert inside.mean() > 0.9
    assert near.size == 0 or near.mean() > 0.9


def test_enough_motions_need_no_warning() -> None:
    """Ten motions are called few by nobody."""
    result = fit_model(joint_log(1), FitSettings(method="linear"), task=JointCorrector)
    assert not any("widened" in remark for remark in result.remarks)


def test_held_out_truth_stays_as_it_was_stamped() -> None:
    """What the training's motion says of the clock is not done to the held-out part; what the user states is."""
    log = align(joint_log(4), -LATE, signals=("external_jp",))
    settings = FitSettings(method="offset")
    found, stated = (
        run_experiment(log, replace(settings, time_offset=mode), task=JointCorrector) for mode in ("auto", str(LATE))
    )
    assert found.fit.clocks.applied == pytest.approx(LATE, abs=0.1)
    rows = np.flatnonzero(log.trajectory >= 8)[found.evaluation.dirty.rows]
    np.testing.assert_array_equal(found.evaluation.dirty.raw, (log.external_jp - log.measured_jp)[rows])
    assert "--time-offset 0.4" in found.evaluation.cautions[0]
    assert not any("shifted" in caution for caution in stated.evaluation.cautions)
    assert np.abs(stated.evaluation.clean.raw).mean() < np.abs(found.evaluation.clean.raw).mean()


def test_a_model_is_measured_on_truth_as_it_was_stamped() -> None:
    """Of another recording's clock a model says what the motion suggests, and leaves it as it is."""
    corrector = fit_model(joint_log(1), FitSettings(method="offset"), task=JointCorrector).corrector
    log = align(joint_log(5), -LATE, signals=("external_jp",))
    same, clocks = corrector.on_one_clock(log, "auto")
    assert same is log
    assert clocks.applied == 0.0
    assert "left as they are" in clocks.remark
    assert corrector.on_one_clock(log, str(LATE))[1].applied == LATE


@pytest.mark.parametrize("stated", ["none", "0.05"])
def test_a_clock_is_compared_with_that_of_the_training(stated: str) -> None:
    """What the training's sensor was late by is no news; 50 ms more are, though a servo may lag as much."""
    late = align(joint_log(1), -0.05, signals=("external_jp",))
    settings = FitSettings(method="offset", time_offset=stated)
    corrector = fit_model(late, settings, task=JointCorrector).corrector
    another = joint_log(5)
    same, more = (
        align(another, -seconds, signals=("external_jp",)) for seconds in ((0.05, 0.1), (0.0, 0.05))[stated != "none"]
    )
    assert corrector.on_one_clock(same, "auto")[1].notes == ()
    (said,) = corrector.on_one_clock(more, "auto")[1].notes
    assert "ms later than in the training" in said
    size = float(said.split("--time-offset ")[1])
    assert size == pytest.approx(0.05, abs=0.01)
    assert corrector.on_one_clock(align(more, size, signals=("external_jp",)), "auto")[1].notes == ()


def test_motion_that_looks_early_is_no_other_clock() -> None:
    """A recording that follows sooner than the training did is called one of another clock where that mends its errors.

    The model's lag is set as if the training's had been 20 ms longer: what it learned fits the stamps as they are.
    """
    corrector = fit_model(joint_log(1), FitSettings(method="linear"), task=JointCorrector).corrector
    summary = {**corrector.summary, "fit": {**corrector.summary["fit"]}}
    summary["fit"]["tracker_lag"] = {name: lag + 0.02 for name, lag in summary["fit"]["tracker_lag"].items()}
    log = joint_log(5)
    assert replace(corrector, summary=summary).on_one_clock(log, "auto")[1].notes == ()
    late = align(log, -0.05, signals=("external_jp",))
    (said,) = corrector.on_one_clock(late, "auto")[1].notes
    assert "later than in the training" in said


@pytest.mark.parametrize("clean", [True, False])
def test_too_few_static_poses_say_how_many_to_record(clean: bool) -> None:
    """A person with a dozen poses is told how many to record, and not to switch off a cleaning that rejected none."""
    log = small_log(trajectories=1, samples=12)
    with pytest.raises(LogError, match="at least 20 are needed") as refused:
        fit_model(replace(log, static=True, trajectory=np.arange(12)), FitSettings(clean=clean))
    assert "Record 30 poses" in refused.value.hint
    assert "--no-clean" not in refused.value.hint


def test_learning_that_takes_away_little_is_said(reaches: CalibrationLog) -> None:
    """A twentieth less than registration leaves is said of poses, with the number; a third less is not."""
    with short_search(60):
        corrector = fit_model(reaches, FitSettings(inducing=30, marker="none")).corrector
    measured = evaluate_model(corrector, reaches)
    for part, count in ((0.95, 2), (0.67, 0)):
        clean = replace(measured.clean, corrected=part * measured.clean.registered)
        said = [caution for caution in replace(measured, clean=clean).cautions if "takes away only 5%" in caution]
        assert len(said) == count


def test_a_motion_of_a_lone_sample_stops_no_comparison_of_clocks() -> None:
    """Halves of a recording of which one holds a lone sample of a motion are compared all the same."""
    assert validate_log(read_log(real_data("mrdlab_spindle.parquet"))).ok
