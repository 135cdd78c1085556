"""Planted faults are found, and good samples are left alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cleaning_synthetic import (
    FAULTS,
    World,
    _moved,
    flipped,
    frozen_block,
    make_log,
    occlusion_jumps,
    offset_block,
    scattered,
    shuffled,
    wandering_block,
)

from gpcorrect.cleaning import CleaningReport, CleaningSettings, FittedCleaner, Reason, clean_with, fit_cleaner
from gpcorrect.sim import debridement_log
from gpcorrect.types import BoolArray, CalibrationLog, PoseSignal

pytestmark = pytest.mark.slow
WORLD = World(reaches=30)
SEEDS = (0, 1)
HELD_OUT = 0.7  # share of trajectories before the held-out ones


def judged(log: CalibrationLog, settings: CleaningSettings | None = None) -> CleaningReport:
    return fit_cleaner(log, settings, rng=np.random.default_rng(7))[1]


def assert_found(report: CleaningReport, faulty: BoolArray, recall: float = 0.95, false: float = 0.01) -> None:
    assert (~report.keep)[faulty].mean() >= recall
    assert (~report.keep)[~faulty].mean() <= false


@pytest.fixture(scope="module")
def trained() -> tuple[FittedCleaner, CalibrationLog]:
    """Return a cleaner that learned from the first trajectories, and a fault-free log of the others."""
    log = make_log(WORLD, np.random.default_rng(5))
    early = log.trajectory < HELD_OUT * WORLD.reaches
    cleaner, _ = fit_cleaner(log.select(early), rng=np.random.default_rng(7))
    return cleaner, log.select(~early)


@pytest.mark.parametrize("seed", SEEDS)
def test_scattered_gross_outliers_are_found(seed: int) -> None:
    """Single samples that are off by 1 to 20 cm are rejected, their neighbours kept."""
    rng = np.random.default_rng(seed)
    log, faulty = scattered(make_log(WORLD, rng), rng)
    assert_found(judged(log), faulty)


@pytest.mark.parametrize("share", [0.02, 0.04])
def test_a_long_block_with_a_constant_offset_is_found(share: float) -> None:
    """A lost fiducial shifts and turns one block of 2 to 4 %: it is rejected whole."""
    rng = np.random.default_rng(2)
    log, faulty = offset_block(make_log(WORLD, rng), rng, share)
    assert_found(judged(log), faulty)


def test_a_long_block_that_wanders_is_found() -> None:
    """A marker taken for another body, which moves by itself, is rejected whole."""
    rng = np.random.default_rng(1)
    log, faulty = wandering_block(make_log(WORLD, rng), rng)
    assert_found(judged(log), faulty)


def test_a_frozen_tracker_is_found_and_named() -> None:
    """A tracker that repeats its value while the arm is commanded to travel is rejected, mostly as frozen."""
    rng = np.random.default_rng(0)
    log, faulty = frozen_block(make_log(WORLD, rng), rng)
    report = judged(log)
    assert_found(report, faulty)
    assert (report.reason[faulty] == Reason.FROZEN.value).mean() > 0.9


@pytest.mark.parametrize("plant", [scattered, offset_block, wandering_block, frozen_block, occlusion_jumps])
def test_faults_that_lie_in_held_out_data_only_are_found(
    plant: object, trained: tuple[FittedCleaner, CalibrationLog]
) -> None:
    """A cleaner that never saw the fault finds it in other trajectories of the same arm and tracker."""
    cleaner, held_out = trained
    assert callable(plant)
    log, faulty = plant(held_out, np.random.default_rng(3))
    assert_found(clean_with(cleaner, log), faulty, false=0.02)


def test_held_out_data_without_faults_are_kept(trained: tuple[FittedCleaner, CalibrationLog]) -> None:
    """What training data taught rejects no more than 2 % of good samples elsewhere."""
    cleaner, held_out = trained
    assert clean_with(cleaner, held_out).keep.mean() >= 0.98


@pytest.mark.parametrize("seed", SEEDS)
def test_occlusion_jumps_are_found(seed: int) -> None:
    """Steps of 4 to 20 mm that last 3 to 30 samples and go back are rejected."""
    rng = np.random.default_rng(seed)
    log, faulty = occlusion_jumps(make_log(WORLD, rng), rng)
    assert_found(judged(log), faulty)


def test_good_motion_between_two_occlusions_is_no_occlusion() -> None:
    """However many occlusions there are, the motion between them is kept: once an occlusion is out, its sides join."""
    rng = np.random.default_rng(2)
    log, faulty = occlusion_jumps(make_log(World(), rng), rng)
    assert_found(judged(log), faulty)


@pytest.mark.parametrize("seed", SEEDS)
def test_flipped_orientations_are_found(seed: int) -> None:
    """Orientations turned by 90 or 180 degrees are rejected though the positions are true."""
    rng = np.random.default_rng(seed)
    log, faulty = flipped(make_log(WORLD, rng), rng)
    assert_found(judged(log), faulty)


def test_impossible_speeds_are_found_and_named() -> None:
    """Shuffled samples, each of which is possible by itself, are rejected (recall 0.9), nearly all by their steps."""
    rng = np.random.default_rng(0)
    log, faulty = shuffled(make_log(WORLD, rng), rng)
    report = judged(log)
    assert_found(report, faulty, recall=0.9)
    assert {Reason.SPEED.value, Reason.ANGULAR_SPEED.value} & set(report.counts)


def test_a_sample_far_outside_the_workspace_is_named_so() -> None:
    """A sample a metre away carries the first rule that it breaks: the workspace."""
    log = make_log(WORLD, np.random.default_rng(0))
    far = _moved(log, np.array([500]), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))
    assert judged(far).reason[500] == Reason.WORKSPACE.value


@pytest.mark.parametrize("seed", SEEDS)
def test_a_large_smooth_miss_is_no_fault(seed: int) -> None:
    """An arm that misses smoothly by 2 cm and 20 degrees keeps 98 % of its samples."""
    world = replace(WORLD, field_m=0.02, field_rad=float(np.radians(20)))
    assert judged(make_log(world, np.random.default_rng(seed))).keep.mean() >= 0.98


@pytest.mark.parametrize("name", ["scattered", "offset block", "occlusion jumps"])
def test_positions_alone_suffice(name: str) -> None:
    """Without orientations there is one scale, in metres; faults are found, at up to 2 % false rejection."""
    rng = np.random.default_rng(1)
    log, faulty = FAULTS[name](make_log(replace(WORLD, position_only=True), rng), rng)
    cleaner, report = fit_cleaner(log, rng=np.random.default_rng(7))
    assert_found(report, faulty, false=0.02)
    assert cleaner.thresholds.scales.shape == (1,)


def late_log(rng: np.random.Generator) -> CalibrationLog:
    """Make a log of an arm without any error but 30 ms of lag: 40 reaches of very different speed, and pauses."""
    targets, parts = rng.uniform(-0.05, 0.05, (41, 3)), []
    for number, (start, goal) in enumerate(pairwise(targets)):
        duration = rng.uniform(0.5, 3.0)
        time = np.arange(0, duration + 0.3, 0.01)
        part = np.clip(np.array([time, time - 0.03])[..., None] / duration, 0, 1)
        path, late = start + (10 * part**3 - 15 * part**4 + 6 * part**5) * (goal - start)
        parts.append(np.column_stack([np.full(len(time), number), path, late]))
    table = np.vstack(parts)
    return CalibrationLog(
        time=0.01 * np.arange(len(table)),
        trajectory=table[:, 0].astype(np.int64),
        session=np.zeros(len(table), dtype=np.int64),
        setpoint_cp=PoseSignal(table[:, 1:4]),
        tracker_cp=PoseSignal(table[:, 4:] + 2e-4 * rng.normal(size=(len(table), 3))),
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_an_arm_that_only_follows_late_has_no_faults(seed: int) -> None:
    """A lag makes the error proportional to velocity: fast samples differ most from the rest, and are as good."""
    assert judged(late_log(np.random.default_rng(seed))).keep.mean() > 0.999


def test_of_few_reaches_most_are_kept() -> None:
    """Ten simulated reaches are too few to surround each other; they and the two after them are not condemned."""
    log = debridement_log(reaches=12)
    later = np.isin(log.trajectory, log.trajectory_ids[-2:])
    cleaner, report = fit_cleaner(log.select(~later), rng=np.random.default_rng(0))
    assert report.keep.mean() > 0.8
    assert clean_with(cleaner, log.select(later)).keep.mean() > 0.8
