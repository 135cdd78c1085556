"""Laws of the time offset: planted offsets come back, whatever the frames, rates and faults."""

from __future__ import annotations

import numpy as np
import pytest
from sync_support import Recording, one_run, sines, wandering

from gpcorrect import se3
from gpcorrect.errors import DataError, LogError
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.logs.sync import Motion, MotionPair, estimate, estimate_offset, log_offset, stream_offset
from gpcorrect.types import CalibrationLog, PoseSignal

TWO_MS = 2e-3


@pytest.mark.parametrize("offset", [-0.8, -0.31, -0.005, 0.0, 0.0123, 0.4, 0.8])
def test_planted_offset_comes_back_within_two_milliseconds(offset):
    """100 Hz against 60 Hz, 0.15 mm noise, unrelated frames: the offset is found to 2 ms."""
    rng = np.random.default_rng(int(1e4 * (offset + 1)))
    found = estimate_offset([Recording().pair(wandering(rng), offset, rng)])
    assert found.observable, found.reason
    assert abs(found.offset - offset) < TWO_MS
    assert found.ci95[0] < found.offset < found.ci95[1]


@pytest.mark.parametrize(
    "recording",
    [
        Recording(jitter=0.45),
        Recording(outliers=0.05),
        Recording(dropout=0.25),
        Recording(outliers=0.05, dropout=0.1, jitter=0.4),
        Recording(scale=1000.0),
        Recording(reference_rate=30.0, observed_rate=250.0),
        Recording(seconds=8.0),
    ],
    ids=["uneven", "outliers", "dropout", "all three", "millimetres", "slow reference", "short"],
)
def test_faults_do_not_move_the_offset(recording):
    """Uneven stamps, 5 % outliers of 5 cm, lost blocks, other units and rates leave the error below 2 ms."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        offset = rng.uniform(-0.8, 0.8)
        found = estimate_offset([recording.pair(wandering(rng), offset, rng)])
        assert found.observable, found.reason
        assert abs(found.offset - offset) < TWO_MS


def test_many_samples_are_fitted_evenly_spread():
    """Of an hour at a kilohertz a part says as much: the offset of a minute at 1 kHz is that of all its samples."""
    rng = np.random.default_rng(5)
    pair = Recording(observed_rate=1000.0, seconds=60.0).pair(wandering(rng), 0.2, rng)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimate, "MOST", 6000)
        found = estimate_offset([pair])
    assert 5900 < found.samples < 12000  # less what is seen beside the reference
    assert abs(found.offset - 0.2) < TWO_MS
    assert found.ci95[0] < estimate_offset([pair]).offset < found.ci95[1]


def test_registration_does_not_matter():
    """Moving the observer's frame, mirroring or scaling it changes the offset by less than its noise."""
    rng = np.random.default_rng(1)
    pair = Recording().pair(wandering(rng), 0.2, rng)
    first = estimate_offset([pair]).offset
    seen = pair.observed
    for matrix in (
        se3.matrix_from_rotvec(np.array([0.3, -2.0, 1.0])),
        np.diag([1.0, 1.0, -1.0]),
        1e3 * np.eye(3),
    ):
        moved = Motion(seen.time, seen.values @ matrix.T + np.array([5.0, -1.0, 2.0]))
        assert estimate_offset([MotionPair(pair.reference, moved)]).offset == pytest.approx(first, abs=2e-5)


def test_shifting_the_observers_clock_shifts_the_offset():
    """Adding s to the observer's stamps adds s to the offset and to its interval."""
    rng = np.random.default_rng(2)
    pair = Recording().pair(wandering(rng), -0.1, rng)
    first = estimate_offset([pair])
    later = MotionPair(pair.reference, Motion(pair.observed.time + 0.25, pair.observed.values))
    second = estimate_offset([later])
    np.testing.assert_allclose([second.offset, *second.ci95], np.array([first.offset, *first.ci95]) + 0.25, atol=2e-6)


def test_clocks_with_other_origins_need_a_rough_offset():
    """Around a rough offset of 1.7e9 s the result is the same as on one origin."""
    rng = np.random.default_rng(3)
    pair = Recording().pair(wandering(rng), 0.3, rng)
    unix = MotionPair(pair.reference, Motion(pair.observed.time + 1.7e9, pair.observed.values))
    assert estimate_offset([unix]).verdict == "too_few"
    found = estimate_offset([unix], centre=1.7e9)
    assert found.offset - 1.7e9 == pytest.approx(estimate_offset([pair]).offset, abs=1e-5)
    assert found.lags[0] == pytest.approx(1.7e9 - 2.0)


def test_trajectories_are_pooled():
    """Ten short trajectories give a narrower interval than one of them, and each its own estimate."""
    rng = np.random.default_rng(4)
    whole = Recording(seconds=60.0).pair(wandering(rng), 0.15, rng)

    def cut(motion, start):
        return motion.rows((motion.time >= start) & (motion.time < start + 6))

    pairs = [MotionPair(cut(whole.reference, a), cut(whole.observed, a)) for a in range(0, 60, 6)]
    many = estimate_offset(pairs)
    assert np.ptp(many.ci95) < np.ptp(estimate_offset(pairs[:1]).ci95)
    assert many.per_trajectory.shape == (10,)
    np.testing.assert_allclose(many.per_trajectory, 0.15, atol=2e-3)


def reaching_log(offset, restart):
    """Return forty reaches of 0.8 s on a clock that runs on or starts anew, the tracker `offset` s ahead."""
    rng = np.random.default_rng(14)
    way = rng.uniform(-0.04, 0.04, (42, 3))

    def path(t):
        k = np.clip(np.floor(t / 0.8 + 1e-9).astype(int), 0, 40)
        u = np.clip(t / 0.8 - k, 0, 1)[:, None]
        return way[k] + (way[k + 1] - way[k]) * u**3 * (10 - 15 * u + 6 * u**2)

    time = np.arange(3200) / 100
    seen = path(time - offset) @ se3.matrix_from_rotvec(np.array([1.0, 0.3, -2.0])).T
    return CalibrationLog(
        time - 0.8 * (np.arange(3200) // 80) * restart,
        np.arange(3200) // 80,
        np.zeros(3200),
        setpoint_cp=PoseSignal(path(time)),
        tracker_cp=PoseSignal(seen + 1e-4 * rng.normal(size=seen.shape)),
    )


@pytest.mark.parametrize("offset", [-0.7, 0.047, 1.2])
def test_offsets_longer_than_a_trajectory_are_found_where_the_clock_runs_on(offset):
    """A recording cut into short reaches is searched as one, and each reach has its own estimate."""
    found = log_offset(reaching_log(offset, restart=0))
    assert found.offset == pytest.approx(offset, abs=5e-4)
    assert found.trajectories.tolist() == list(range(40))
    np.testing.assert_allclose(found.per_trajectory[2:-2], offset, atol=5e-3)


def test_a_clock_that_starts_anew_limits_the_search():
    """Reaches that each start at time zero show an offset within a reach, and say so beyond."""
    assert log_offset(reaching_log(0.3, restart=1)).offset == pytest.approx(0.3, abs=5e-4)
    assert not log_offset(reaching_log(1.2, restart=1)).observable


def test_a_marker_off_the_tip_does_not_bias_the_offset():
    """A lever arm of 6 cm on a turning tool goes into the orientation columns, not into a shift in time."""
    rng = np.random.default_rng(6)
    path, turn = wandering(rng), wandering(rng, size=0.4)
    t, s = np.arange(0, 30, 0.01), np.arange(0, 30, 1 / 60)
    rotation = se3.matrix_from_rotvec(turn(s - 0.12))
    marker = path(s - 0.12) + rotation @ np.array([0.06, 0.0, 0.02]) + 1.5e-4 * rng.normal(size=(len(s), 3))
    lever = se3.matrix_from_rotvec(turn(t)).reshape(-1, 9)
    found = estimate_offset([MotionPair(Motion(t, path(t), lever), Motion(s, marker))])
    blind = estimate_offset([MotionPair(Motion(t, path(t)), Motion(s, marker))])
    assert abs(found.offset - 0.12) < 5e-4
    assert np.ptp(found.ci95) < 0.2 * np.ptp(blind.ci95)


def test_drift_is_reported_only_where_there_is_one():
    """A clock that is 80 ppm fast is found within its interval; two equal clocks have no drift."""
    for ppm in (0.0, 80.0):
        rng = np.random.default_rng(7)
        path = wandering(rng)
        t, s = np.arange(0, 200, 0.02), np.arange(0, 200, 1 / 60)
        seen = path((s - 0.1) * (1 - 1e-6 * ppm)) + 1.5e-4 * rng.normal(size=(len(s), 3))
        found = estimate_offset([MotionPair(Motion(t, path(t)), Motion(s, seen))])
        assert found.observable, found.reason
        if ppm == 0:
            assert found.drift is None
            continue
        assert found.drift is not None
        assert found.drift.ci95[0] - 1 < ppm < found.drift.ci95[1] + 1
        np.testing.assert_allclose(found.at(np.array([0.0, 200.0])), [0.1, 0.116], atol=5e-4)


def test_parts_that_are_early_and_late_by_turns_are_no_drift():
    """Delays of 30 ms that differ by 6 ms from motion to motion are no fast clock: 3 of 60 are taken for one."""
    drifts = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        path = wandering(rng)
        t, s = np.arange(0, 64, 0.02), np.arange(0, 64, 1 / 60)
        late = 0.03 + 0.006 * rng.standard_normal(20)[(s // 12).astype(int)]
        seen = path(s - late) + 1e-3 * rng.normal(size=(len(s), 3))
        found = estimate_offset([MotionPair(Motion(t, path(t)), Motion(s, seen))])
        assert found.observable, found.reason
        drifts.append(found.drift is not None)
    assert sum(drifts) <= 1


def test_joints_are_compared_joint_by_joint():
    """Joints of rad and m, coupled and biased, give the planted offset too."""
    rng = np.random.default_rng(8)
    path = wandering(rng, 0.3)
    time = np.arange(0, 30, 0.02)
    unit = np.array([1.0, 1.0, 0.1])
    true = path(time) * unit
    seen = path(time - 0.07) * unit @ np.array([[1, 0.1, 0], [0, 0.98, 0.01], [0, 0, 1]]) + 0.02
    log = one_run(time, setpoint_jp=true, external_jp=seen + 2e-4 * rng.normal(size=seen.shape) * unit)
    found = log_offset(log)
    assert (found.observed, found.reference) == ("external_jp", "setpoint_jp")
    assert abs(found.offset - 0.07) < TWO_MS


def test_the_preferred_reference_is_what_the_robot_reports():
    """With a reported pose in the log the servo lag stays out of the tracker's offset."""
    rng = np.random.default_rng(9)
    path, time = wandering(rng), np.arange(0, 30, 0.02)
    log = one_run(
        time,
        setpoint_cp=PoseSignal(path(time)),
        measured_cp=PoseSignal(path(time - 0.05)),
        tracker_cp=PoseSignal(path(time - 0.05 - 0.2) + 1e-4 * rng.normal(size=(len(time), 3))),
    )
    assert log_offset(log).offset == pytest.approx(0.2, abs=1e-3)
    assert log_offset(log, "tracker_cp", "setpoint_cp").offset == pytest.approx(0.25, abs=1e-3)
    assert log_offset(log, "measured_cp", "setpoint_cp").offset == pytest.approx(0.05, abs=1e-3)


def test_disordered_and_missing_samples_are_left_out():
    """Backward stamps and NaN rows among good samples change nothing."""
    rng = np.random.default_rng(10)
    pair = Recording().pair(wandering(rng), 0.3, rng)
    seen = pair.observed
    time = np.insert(seen.time, [100, 500], [seen.time[50], np.nan])
    values = np.insert(seen.values, [100, 500], [[9.0, 9.0, 9.0], [1.0, 2.0, 3.0]], axis=0)
    dirty = estimate_offset([MotionPair(pair.reference, Motion(time, values))])
    assert dirty.offset == pytest.approx(estimate_offset([pair]).offset, abs=1e-9)


def test_an_offset_beyond_the_search_is_not_invented():
    """A shift of 5 s is not found within 2 s, and is found within 8 s."""
    rng = np.random.default_rng(11)
    pair = Recording(seconds=60.0).pair(wandering(rng), 5.0, rng)
    assert not estimate_offset([pair]).observable
    assert estimate_offset([pair], max_lag=8.0).offset == pytest.approx(5.0, abs=TWO_MS)


def test_streams_meet_on_one_clock():
    """Two streams at 100 and 60 Hz, 0.3 s apart: shifted back by the offset, one interpolates to the other."""
    rng = np.random.default_rng(13)
    path = wandering(rng)
    t, s = np.arange(0, 30, 0.01), np.arange(0, 30, 1 / 60)
    robot = Stream("setpoint_cp", t, PoseSignal(path(t)))
    tracker = Stream("tracker_cp", s, PoseSignal(path(s - 0.3) + 1e-4 * rng.normal(size=(len(s), 3))))
    found = stream_offset(tracker, robot)
    assert (found.observed, found.reference) == ("tracker_cp", "setpoint_cp")
    left = interpolate(tracker.shifted(-found.offset), t).position - path(t)
    assert np.sqrt(np.nanmean(left**2)) < 1.5e-4
    with pytest.raises(LogError, match="one is a pose"):
        stream_offset(tracker, Stream("setpoint_jp", t, path(t)))


def test_joints_are_weighed_where_the_reference_is_whole():
    """Numbers that a joint gives while another one is unknown, as before homing, say nothing of how far it moves."""
    rng = np.random.default_rng(8)
    path = wandering(rng)
    t, s = np.arange(0, 30, 0.01), np.arange(0, 30, 1 / 60)
    commanded, seen = path(t), path(s - 0.3)[:, :2]
    commanded[:, 0] = seen[:, 0] = 0.1  # the first joint rests
    commanded[:100, 0], commanded[:100, 2] = 2.0**31, np.nan
    found = stream_offset(Stream("external_jp", s, seen), Stream("setpoint_jp", t, commanded))
    assert found.observable, found.reason
    assert abs(found.offset - 0.3) < TWO_MS


def test_bad_requests_are_refused():
    """A search width of zero, an absent signal, a pose against joints: each says what is wrong."""
    log = one_run(np.arange(5.0), setpoint_cp=PoseSignal(np.zeros((5, 3))), setpoint_jp=np.zeros((5, 2)))
    with pytest.raises(DataError, match="max_lag must be positive"):
        estimate_offset([], max_lag=0.0)
    with pytest.raises(LogError, match="two signals of one motion"):
        log_offset(log)
    with pytest.raises(LogError, match="no motion signal tracker_cp"):
        log_offset(log, "tracker_cp", "setpoint_cp")
    with pytest.raises(LogError, match="one is a pose"):
        log_offset(log, "setpoint_jp", "setpoint_cp")
    with pytest.raises(DataError, match="a motion is time"):
        Motion(np.zeros(3), np.zeros((2, 3)))


def test_the_summary_is_plain_json():
    """What is known comes out as numbers, what is not as None; never NaN."""
    import json

    rng = np.random.default_rng(12)
    found = estimate_offset([Recording().pair(wandering(rng), 0.3, rng)])
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["offset_s"] == found.offset
    nothing = estimate_offset([Recording().pair(sines((0, 0, 0), (1, 1, 1)), 0.3, rng)])
    assert json.loads(json.dumps(nothing.to_dict(), allow_nan=False))["offset_s"] is None
