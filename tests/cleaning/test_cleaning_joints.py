"""Faults of outside joint encoders, and of a tracker beside a reported position, are found as those of poses are."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cleaning_synthetic import World, make_log, scattered
from joint_logs import joint_log
from support import real_data

from gpcorrect.cleaning import TOOL, CleaningReport, FittedCleaner, Reason, clean_with, fit_cleaner, joint_pair
from gpcorrect.codec import pack, unpack
from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, LogMeta, PoseSignal

RATE = 50.0
REPORTED = joint_pair("measured_jp")
SCALE = np.array([1.0, 1.0, 0.05])  # of a fault: rad and m


def joint_world(seed: int, sessions: int = 1) -> CalibrationLog:
    """Return smooth motion of two revolute joints and a slide with coupling, stretch, play and a zero a session."""
    rng = np.random.default_rng(seed)
    n = 12 * 300
    time = np.arange(n) / RATE
    rates, phases = rng.uniform(0.3, 2.0, (4, 3)), rng.uniform(0, 2 * np.pi, (4, 3))
    q = np.sin(time[:, None, None] * rates + phases).sum(axis=1) / 4 * SCALE * np.array([1.0, 1.0, 2.0])
    session = np.arange(n) * sessions // n
    lag = 0.03 * SCALE * np.tanh(np.gradient(q, time, axis=0) / (0.2 * SCALE))
    zero = np.array([0.03, -0.14, 0.01]) + (rng.normal(0, 0.1, (sessions, 3)) * SCALE)[session]
    bend = 0.05 * q[:, [1, 0, 1]] * SCALE * np.array([1, 1, 0.2]) + 0.03 * SCALE * np.sin(2 * q / SCALE)
    noise = rng.normal(size=q.shape) * np.array([5e-4, 5e-4, 2e-5])
    return CalibrationLog(
        time=time,
        trajectory=np.arange(n) // 300,
        session=session,
        measured_jp=q,
        external_jp=q - lag + zero + bend + noise,
        meta=LogMeta(joint_types="RRP"),
    )


@cache
def world(sessions: int = 1) -> CalibrationLog:
    return joint_world(0, sessions=sessions)


def labelled(log: CalibrationLog) -> tuple[FittedCleaner, CleaningReport]:
    return fit_cleaner(log, rng=np.random.default_rng(0), pair=REPORTED)


def with_truth(log: CalibrationLog, truth: FloatArray) -> CalibrationLog:
    return replace(log, external_jp=truth)


def planted(log: CalibrationLog, kind: str, seed: int) -> tuple[CalibrationLog, BoolArray]:
    """Return a log with faults of one kind in its outside encoders, and the mask of faulty samples."""
    assert log.external_jp is not None
    rng = np.random.default_rng(seed)
    truth, faulty = np.array(log.external_jp), np.zeros(len(log), dtype=bool)
    size = np.ptp(truth, axis=0) / 4
    if kind == "single samples":
        rows = rng.choice(len(log), len(log) // 50, replace=False)
        joint = rng.integers(0, truth.shape[1], len(rows))
        truth[rows, joint] += rng.choice([-1, 1], len(rows)) * rng.uniform(0.5, 2, len(rows)) * size[joint]
        faulty[rows] = True
    elif kind == "bursts":
        for start in rng.choice(len(log) // 40 - 1, 10, replace=False) * 40:
            rows = slice(start, start + int(rng.integers(3, 20)))
            joint = rng.integers(0, truth.shape[1])
            truth[rows, joint] += rng.choice([-1, 1]) * rng.uniform(0.5, 1) * size[joint]
            faulty[rows] = True
    else:
        rows = np.flatnonzero(log.trajectory == log.trajectory_ids[4])
        shuffled = truth[rng.permutation(rows)]
        faulty[rows] = (np.abs(shuffled - truth[rows]) > 0.2 * size).any(axis=1)
        truth[rows] = shuffled
    return with_truth(log, truth), faulty


@pytest.mark.parametrize("sessions", [1, 3])
def test_a_log_without_faults_is_kept(sessions: int) -> None:
    """Play, coupling, stretch and a zero that moves from session to session are no faults: 99.5 % is kept."""
    assert labelled(world(sessions))[1].keep.mean() >= 0.995


@pytest.mark.parametrize("kind", ["single samples", "bursts", "a shuffled trajectory"])
def test_planted_faults_are_found(kind: str) -> None:
    """At least 95 % of the faulty samples are rejected, and at most 0.5 % of the others."""
    log, faulty = planted(world(), kind, 1)
    rejected = ~labelled(log)[1].keep
    assert rejected[faulty].mean() >= 0.95
    assert rejected[~faulty & (log.trajectory != 4)].mean() <= 0.005


def test_a_frozen_encoder_of_one_joint_is_found_and_named() -> None:
    """An encoder that repeats its value while its joint moves is rejected as frozen, whatever the others say."""
    assert world().external_jp is not None
    truth = np.array(world().external_jp)
    truth[900:1000, 1] = truth[900, 1]
    report = labelled(with_truth(world(), truth))[1]
    assert (report.reason[901:1000] == Reason.FROZEN.value).mean() > 0.9


@pytest.mark.parametrize("kind", ["single samples", "bursts"])
def test_faults_in_held_out_data_only_are_found(kind: str) -> None:
    """A packed and rebuilt cleaner that never saw the fault finds it in other trajectories of the same arm."""
    early = world().trajectory < 8
    data, arrays = pack(labelled(world().select(early))[0], "cleaner")
    cleaner = unpack(FittedCleaner, json.loads(json.dumps(data)), arrays)
    held_out = world().select(~early)
    assert clean_with(cleaner, held_out).keep.mean() >= 0.99
    log, faulty = planted(held_out, kind, 2)
    assert (~clean_with(cleaner, log).keep)[faulty].mean() >= 0.95


def test_joints_whose_truth_is_missing_are_invalid() -> None:
    """A sample with NaN in any joint's truth is invalid, as one with a missing pose is."""
    assert world().external_jp is not None
    truth = np.array(world().external_jp)
    truth[100:110, 2] = np.nan
    report = labelled(with_truth(world(), truth))[1]
    assert (report.reason[100:110] == Reason.INVALID.value).all()
    assert report.counts[Reason.INVALID.value] == 10


def test_signals_that_do_not_match_are_refused() -> None:
    """The error says how many joints each signal has, or which one is missing."""
    with pytest.raises(LogError, match="measured_jp has 3 joints, external_jp 2"):
        labelled(with_truth(world(), world().external_jp[:, :2]))
    with pytest.raises(LogError, match="no external_jp"):
        labelled(replace(world(), external_jp=None))


@pytest.mark.parametrize("kind", ["single samples", "bursts"])
def test_faults_in_a_real_recording_are_found(kind: str) -> None:
    """In a real dVRK recording 90 % of planted faults are found, and 2 % at most of its samples are lost besides."""
    log = read_log(real_data("dvrk_random.csv"))
    pair = joint_pair("setpoint_jp")
    clean = fit_cleaner(log, rng=np.random.default_rng(0), pair=pair)[1].keep
    dirty, faulty = planted(log, kind, 3)
    keep = fit_cleaner(dirty, rng=np.random.default_rng(0), pair=pair)[1].keep
    assert clean.mean() >= 0.98
    assert (~keep)[faulty].mean() >= 0.9
    assert keep[~faulty].mean() >= 0.98


def test_a_tracker_is_held_against_the_reported_position() -> None:
    """Faults of a tracker of positions are found beside `measured_cp`; without them nothing is lost."""
    log = make_log(World(reaches=30, position_only=True), np.random.default_rng(1))
    reported = replace(log, measured_cp=log.setpoint_cp, setpoint_cp=None)
    dirty, faulty = scattered(reported, np.random.default_rng(2))
    clean, found = (fit_cleaner(x, rng=np.random.default_rng(0), pair=TOOL)[1].keep for x in (reported, dirty))
    assert clean.mean() >= 0.995
    assert (~found)[faulty].mean() >= 0.95


def test_orientations_do_not_enter_a_comparison_of_positions() -> None:
    """A tracker whose orientations are all wrong gives the labels of one that reports positions only."""
    log = make_log(World(reaches=16), np.random.default_rng(1))
    reported = replace(log, measured_cp=log.setpoint_cp)
    alone = replace(reported, tracker_cp=PoseSignal(log.tracker_cp.position))
    first, second = (fit_cleaner(x, rng=np.random.default_rng(0), pair=TOOL)[1] for x in (reported, alone))
    np.testing.assert_array_equal(first.reason, second.reason)


def test_a_joint_that_hardly_moved_in_training_condemns_no_other_motion() -> None:
    """Its slope is noise: followed over ten training ranges, it had 77 % of a good recording rejected."""
    cleaner, _ = fit_cleaner(joint_log(1, trajectories=6, first=0.1), pair=REPORTED, rng=np.random.default_rng(0))
    assert clean_with(cleaner, joint_log(2, trajectories=3)).keep.mean() > 0.95


@pytest.mark.parametrize("seed", [7, 8, 9])
def test_slack_that_holds_a_joint_at_the_other_end_is_no_outlier(seed: int) -> None:
    """Most errors of one recording lie at one end of a joint's slack, those of the next at the other."""
    cleaner, report = fit_cleaner(joint_log(0, 10, 20.0), rng=np.random.default_rng(0), pair=REPORTED)
    assert report.keep.all()
    assert clean_with(cleaner, joint_log(seed, 6, 20.0)).keep.all()
    broken = joint_log(seed, 6, 20.0)
    off = broken.trajectory == 2
    outside = broken.external_jp.copy()
    outside[off, 2] += 0.02  # five times the slack
    found = clean_with(cleaner, replace(broken, external_jp=outside))
    assert not found.keep[off].any()
    assert found.keep[~off].all()
