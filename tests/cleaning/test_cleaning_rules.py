"""What cleaning does beside finding faults: whole trajectories, the hand, velocities, reports, bad input."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cleaning_synthetic import World, _moved, make_log, scattered
from support import real_data

from gpcorrect.cleaning import (
    CleaningReport,
    CleaningSettings,
    FittedCleaner,
    Reason,
    Segment,
    clean_with,
    fit_cleaner,
)
from gpcorrect.codec import pack, unpack
from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal
from gpcorrect.velocity import segment_labels

WORLD = World(reaches=16)


def judged(log: CalibrationLog, settings: CleaningSettings | None = None, seed: int = 7) -> CleaningReport:
    return fit_cleaner(log, settings, rng=np.random.default_rng(seed))[1]


def flipped_share(log: CalibrationLog, number: int, share: float) -> CalibrationLog:
    """Turn the last share of a trajectory's samples upside down."""
    rows = np.flatnonzero(log.trajectory == number)
    rows = rows[len(rows) - round(share * len(rows)) :]
    return _moved(log, rows, np.zeros((len(rows), 3)), np.tile([np.pi, 0.0, 0.0], (len(rows), 1)))


def with_positions(log: CalibrationLog, position: FloatArray) -> CalibrationLog:
    return replace(log, tracker_cp=PoseSignal(position, log.tracker_cp.quaternion))


@pytest.fixture(scope="module")
def log() -> CalibrationLog:
    """Return a fault-free log."""
    return make_log(WORLD, np.random.default_rng(0))


@pytest.fixture(scope="module")
def fitted() -> tuple[FittedCleaner, CleaningReport, CalibrationLog]:
    """Return a cleaner and a report of a log with scattered outliers."""
    rng = np.random.default_rng(0)
    dirty, _ = scattered(make_log(WORLD, rng), rng)
    return *fit_cleaner(dirty, rng=np.random.default_rng(7)), dirty


def test_the_same_seed_gives_the_same_report(fitted: tuple[FittedCleaner, CleaningReport, CalibrationLog]) -> None:
    """Cleaning is a function of log, settings and random state."""
    _, report, dirty = fitted
    again = judged(dirty)
    np.testing.assert_array_equal(again.reason, report.reason)
    np.testing.assert_array_equal(again.value, report.value)


def test_the_callers_arrays_are_left_alone(log: CalibrationLog) -> None:
    """Cleaning changes nothing in the log."""
    before = np.array(log.tracker_cp.position)
    judged(log)
    np.testing.assert_array_equal(log.tracker_cp.position, before)


def test_a_trajectory_with_more_than_p_rejected_is_dropped_whole(log: CalibrationLog) -> None:
    """At P = 50 %, a trajectory with 70 % faults goes whole and says so; one with 30 % loses the faults only."""
    dirty = flipped_share(flipped_share(log, 4, 0.7), 9, 0.3)
    report = judged(dirty, CleaningSettings(trajectory_share=0.5))
    assert set(log.trajectory[report.reason == Reason.TRAJECTORY.value]) == {4}
    assert not report.keep[log.trajectory == 4].any()
    assert report.keep[log.trajectory == 9].mean() > 0.6


def test_segments_by_hand_beat_every_rule_and_are_reported(log: CalibrationLog) -> None:
    """Faulty samples kept by hand are kept and say what the rule found; good ones dropped by hand are manual."""
    dirty = flipped_share(log, 4, 1.0)
    report = judged(dirty, CleaningSettings(keep=(Segment(4),), drop=(Segment(2),)))
    four, two = log.trajectory == 4, log.trajectory == 2
    assert report.keep[four].all()
    assert (report.overruled[four] == Reason.ROTATION.value).all()
    assert (report.reason[two] == Reason.MANUAL.value).any()
    assert not report.keep[two].any()
    assert sum(row["kept_by_hand"] for row in report.to_table()) == four.sum()


def test_keep_beats_drop(log: CalibrationLog) -> None:
    """A sample in a segment to keep and in one to drop is kept."""
    start, stop = log.time[log.trajectory == 2][[5, 10]]
    report = judged(log, CleaningSettings(keep=(Segment(2, start, stop),), drop=(Segment(2),)))
    assert report.keep[log.trajectory == 2].sum() == 6


def test_no_hand_keeps_a_missing_number(log: CalibrationLog) -> None:
    """Invalid samples stay rejected inside a segment to keep: nothing can be learned from them."""
    position = np.array(log.tracker_cp.position)
    position[100] = np.nan
    report = judged(with_positions(log, position), CleaningSettings(keep=(Segment(int(log.trajectory[100])),)))
    assert report.reason[100] == Reason.INVALID.value
    assert report.keep[log.trajectory == log.trajectory[100]].sum() == (log.trajectory == log.trajectory[100]).sum() - 1


def test_no_velocity_crosses_a_rejected_sample(fitted: tuple[FittedCleaner, CleaningReport, CalibrationLog]) -> None:
    """Two samples share a label only where all between them are kept and of one trajectory."""
    _, report, dirty = fitted
    labels = segment_labels(report.time, report.trajectory, report.keep)
    np.testing.assert_array_equal(labels == -1, ~report.keep)
    for label in np.unique(labels[labels >= 0]):
        rows = np.flatnonzero(labels == label)
        assert len(rows) == rows[-1] - rows[0] + 1
        assert len(np.unique(dirty.trajectory[rows])) == 1


def test_the_report_is_strict_json(fitted: tuple[FittedCleaner, CleaningReport, CalibrationLog]) -> None:
    """The table passes through JSON without NaN, and has a row for each that is rejected or kept by hand."""
    _, _, dirty = fitted
    report = judged(dirty, CleaningSettings(keep=(Segment(1),), drop=(Segment(2),)))
    table = json.loads(json.dumps(report.to_table(), allow_nan=False))
    assert np.count_nonzero(~report.keep) == sum(report.counts.values())
    assert len(table) == sum(report.counts.values()) + sum(row["kept_by_hand"] for row in table)


def test_a_value_in_the_report_broke_its_limit(fitted: tuple[FittedCleaner, CleaningReport, CalibrationLog]) -> None:
    """Each rejected sample shows what was measured, and it is beyond the limit that it broke."""
    _, report, _ = fitted
    rejected = ~report.keep
    assert rejected.any()
    assert (report.value[rejected] > report.limit[rejected]).all()


def test_every_reason_has_a_sentence_and_a_unit() -> None:
    """Each code explains itself."""
    assert all(reason.sentence.endswith(".") and isinstance(reason.unit, str) for reason in Reason)


def test_a_fitted_cleaner_judges_its_training_log_as_in_training(
    fitted: tuple[FittedCleaner, CleaningReport, CalibrationLog],
) -> None:
    """Judging the training log again agrees with the training's report on 99 % of the samples."""
    cleaner, report, dirty = fitted
    assert (clean_with(cleaner, dirty).keep == report.keep).mean() >= 0.99


def test_a_packed_cleaner_labels_as_before(fitted: tuple[FittedCleaner, CleaningReport, CalibrationLog]) -> None:
    """A cleaner that was taken apart into JSON and arrays and rebuilt labels as before."""
    cleaner, _, dirty = fitted
    data, arrays = pack(cleaner, "cleaner")
    rebuilt = unpack(FittedCleaner, json.loads(json.dumps(data)), arrays)
    np.testing.assert_array_equal(clean_with(rebuilt, dirty).reason, clean_with(cleaner, dirty).reason)


def test_a_log_without_a_usable_sample_is_judged_all_invalid(
    fitted: tuple[FittedCleaner, CleaningReport, CalibrationLog], log: CalibrationLog
) -> None:
    """A held-out log whose tracker saw nothing is rejected whole, without an error."""
    report = clean_with(fitted[0], with_positions(log, np.full((len(log), 3), np.nan)))
    assert report.counts == {Reason.INVALID.value: len(log)}


def test_too_few_samples_to_learn_from_are_refused(log: CalibrationLog) -> None:
    """The error says how many samples are needed and how many came."""
    position = np.array(log.tracker_cp.position)
    position[3:] = np.nan
    with pytest.raises(DataError, match=rf"at least 4 complete samples .* got 3 of {len(log)}"):
        judged(with_positions(log, position))


def test_a_log_without_a_tracker_is_refused(log: CalibrationLog) -> None:
    """The error names the signal that is missing."""
    with pytest.raises(LogError, match="no tracker_cp"):
        judged(replace(log, tracker_cp=None))


@pytest.mark.parametrize(
    "wrong",
    [
        {"outlier_factor": 0.0},
        {"outlier_factor": -1.0},
        {"outlier_factor": True},
        {"outlier_factor": "8"},
        {"outlier_factor": None},
        {"step_factor": np.float32("nan")},
        {"trajectory_share": 1.5},
        {"field_samples": 3},
        {"field_samples": 800.5},
        {"max_speed": np.nan},
        {"max_speed": [0.1]},
        {"drop": (3,)},
        {"keep": Segment(3)},
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    """A setting that makes no sense, or is of another type, is named."""
    with pytest.raises(DataError, match=next(iter(wrong))):
        CleaningSettings(**wrong)


def test_numbers_of_numpy_are_settings_too() -> None:
    settings = CleaningSettings(max_speed=np.float64(0.2), field_samples=np.int64(100), drop=[Segment(2)])  # type: ignore[arg-type]
    assert (settings.max_speed, settings.field_samples, settings.drop) == (0.2, 100, (Segment(2),))


def test_a_segment_that_runs_backward_is_refused() -> None:
    """A stop before the start is an error."""
    with pytest.raises(DataError, match="forward in time"):
        Segment(0, 2.0, 1.0)


def test_a_real_recording_is_mostly_kept() -> None:
    """A real dVRK recording without known faults loses at most 2 % of its samples."""
    log = read_log(real_data("dvrk_random.csv"))
    _, report = fit_cleaner(log, rng=np.random.default_rng(0))
    assert report.keep.mean() >= 0.98


@pytest.mark.parametrize("seed", [2, 6])
def test_commanded_orientations_explain_what_positions_alone_show(seed: int) -> None:
    """A tracker of positions sees errors that depend on how the tool was turned: they are no faults.

    In these worlds of fifteen reaches good samples at the rim were rejected when orientations were not looked at.
    """
    world = World(reaches=15, position_only=True)
    log = make_log(world, np.random.default_rng(seed))
    assert judged(log, seed=1).keep.all()
