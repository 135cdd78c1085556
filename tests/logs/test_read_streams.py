from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from read_support import random_log, random_pose
from scipy.spatial.transform import Rotation

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import Stream, combine, interpolate
from gpcorrect.logs.order import rising
from gpcorrect.types import PoseSignal


def line(t: np.ndarray) -> np.ndarray:
    return np.column_stack([2 * t - 1, -t])


def spin(t: np.ndarray) -> PoseSignal:
    """Constant velocity and constant angular velocity."""
    turn = Rotation.from_rotvec(t[:, None] * np.array([0.3, -0.5, 0.9]))
    return PoseSignal(t[:, None] * np.array([1.0, 2.0, 3.0]), turn.as_quat(scalar_first=True))


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    left, right = Rotation.from_quat(a, scalar_first=True), Rotation.from_quat(b, scalar_first=True)
    return (left * right.inv()).magnitude()


def test_linear_signals_are_reproduced_between_uneven_samples():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 10, 200))
    at = np.linspace(t[0], t[-1], 500)
    values = interpolate(Stream("setpoint_jp", t, line(t)), at, max_gap=10.0)
    np.testing.assert_allclose(values, line(at), atol=1e-12)


def test_constant_angular_velocity_is_reproduced_between_samples():
    t = np.linspace(0, 10, 40)
    at = np.linspace(0, 10, 333)
    pose = interpolate(Stream("tracker_cp", t, spin(t)), at)
    np.testing.assert_allclose(pose.position, spin(at).position, atol=1e-12)
    assert angles(pose.quaternion, spin(at).quaternion).max() < 1e-7


def test_a_sample_hit_exactly_is_returned_bit_for_bit():
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0, 10, 50))
    pose = random_pose(rng, 50)
    back = interpolate(Stream("tracker_cp", t, pose), t[::-1])
    np.testing.assert_array_equal(back.position, pose.position[::-1])
    np.testing.assert_array_equal(back.quaternion, pose.quaternion[::-1])


def test_the_sign_of_a_quaternion_does_not_matter():
    rng = np.random.default_rng(2)
    t, pose = np.arange(30.0), spin(np.arange(30.0) / 10)
    flipped = PoseSignal(pose.position, pose.quaternion * rng.choice([-1, 1], size=(30, 1)))
    at = rng.uniform(0, 29, 200)
    one, two = (interpolate(Stream("tracker_cp", t, p), at) for p in (pose, flipped))
    assert angles(one.quaternion, two.quaternion).max() < 1e-7


def test_nothing_is_invented_outside_the_recording_or_inside_a_gap():
    t = np.concatenate([np.arange(0, 1, 0.01), np.arange(2, 3, 0.01)])
    at = np.array([-0.001, 0.005, 0.99, 0.995, 1.5, 1.999, 2.0, 2.985, 2.991])
    values = interpolate(Stream("setpoint_jp", t, line(t)), at)
    np.testing.assert_array_equal(np.isnan(values[:, 0]), [True, False, False, True, True, True, False, False, True])
    assert np.isfinite(interpolate(Stream("setpoint_jp", t, line(t)), at[1:-1], max_gap=2.0)).all()


def test_a_missing_sample_is_as_if_it_had_not_been_recorded():
    t = np.arange(0, 1, 0.1)
    values = line(t)
    values[4] = np.nan
    whole, thinned = (
        Stream("setpoint_jp", t, values),
        Stream("setpoint_jp", np.delete(t, 4), np.delete(line(t), 4, 0)),
    )
    at = np.linspace(0, 0.9, 91)
    np.testing.assert_array_equal(interpolate(whole, at, 0.25), interpolate(thinned, at, 0.25))
    assert np.isnan(interpolate(whole, np.array([0.4]), 0.15)).all()


def test_columns_miss_samples_each_for_itself():
    t = np.arange(5.0)
    values = np.column_stack([t, t])
    values[2, 1] = np.nan
    np.testing.assert_array_equal(
        interpolate(Stream("measured_jf", t, values), np.array([2.0]), 1.5), np.array([[2.0, np.nan]])
    )


def test_the_order_in_which_samples_arrive_does_not_matter():
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0, 1, 50))
    order = rng.permutation(50)
    at = rng.uniform(t[0], t[-1], 80)
    np.testing.assert_array_equal(
        interpolate(Stream("a", t, line(t)), at, 1.0),
        interpolate(Stream("a", t[order], line(t)[order]), at, 1.0),
    )


@settings(max_examples=50, deadline=None)
@given(arrays(np.float64, 12, elements=st.floats(-1e6, 1e6)), st.floats(0, 11))
def test_a_value_lies_between_its_neighbours(values: np.ndarray, at: float):
    found = float(interpolate(Stream("payload", np.arange(12.0), values), np.array([at]))[0])
    near = values[[int(np.floor(at)), int(np.ceil(at))]]
    slack = 1e-9 * (1 + np.abs(near).max())
    assert near.min() - slack <= found <= near.max() + slack


def test_streams_refuse_columns_of_another_length():
    with pytest.raises(DataError, match="3 values for 2 stamps"):
        Stream("setpoint_jp", np.zeros(2), np.zeros((3, 6)))


def test_the_tracker_gives_the_rows_and_the_others_are_interpolated_onto_it():
    fast, slow = np.arange(0, 5, 0.002), np.arange(0.0005, 5, 0.01)
    log = combine([Stream("setpoint_jp", fast, line(fast)), Stream("tracker_cp", slow, spin(slow))])
    np.testing.assert_array_equal(log.time, slow[slow <= fast[-1]])
    np.testing.assert_allclose(log.setpoint_jp, line(log.time), atol=1e-12)
    np.testing.assert_array_equal(log.tracker_cp.position, spin(log.time).position)


def test_any_stream_can_give_the_rows():
    fast, slow = np.arange(0, 5, 0.002), np.arange(0.0005, 5, 0.01)
    streams = [Stream("setpoint_jp", fast, line(fast)), Stream("tracker_cp", slow, spin(slow))]
    log = combine(streams, base="setpoint_jp")
    inside = (fast >= slow[0]) & (fast <= slow[-1])
    np.testing.assert_array_equal(log.time, fast[inside])
    np.testing.assert_allclose(log.tracker_cp.position, spin(log.time).position, atol=1e-12)


def test_a_shift_undoes_the_offset_of_a_clock():
    t = np.arange(0, 5, 0.01)
    log = combine(
        [Stream("tracker_cp", t + 1234.5, spin(t)), Stream("setpoint_jp", t, line(t))],
        shifts={"tracker_cp": -1234.5},
    )
    assert len(log) >= 499
    np.testing.assert_allclose(log.setpoint_jp, line(log.tracker_cp.position[:, 0]), atol=1e-9)


def test_rows_without_any_partner_are_dropped_and_reported():
    t = np.arange(0, 4, 0.01)
    middle = t[(t > 1) & (t < 2)]
    log = combine([Stream("tracker_cp", t, spin(t)), Stream("setpoint_jp", middle, line(middle))])
    np.testing.assert_array_equal(log.time, middle)
    assert "301 of 400 samples of tracker_cp" in log.remarks[0]


def test_a_signal_that_alone_is_missing_is_nan():
    t = np.arange(0, 4, 0.01)
    early = t[t < 1]
    log = combine(
        [
            Stream("tracker_cp", t, spin(t)),
            Stream("setpoint_cp", t, spin(t)),
            Stream("setpoint_jp", early, line(early)),
        ]
    )
    assert len(log) == len(t)
    np.testing.assert_array_equal(np.isfinite(log.setpoint_jp[:, 0]), t < 1)


def test_streams_that_share_no_time_are_refused():
    t = np.arange(0, 4, 0.01)
    with pytest.raises(LogError, match=r"share no time.*tracker_cp 1000 to 1003\.99 s"):
        combine([Stream("tracker_cp", t + 1000, spin(t)), Stream("setpoint_jp", t, line(t))])


def test_backward_stamps_are_refused_or_dropped_with_a_remark():
    t = np.arange(0, 1, 0.01)
    t[50] = 0.2
    streams = [
        Stream("tracker_cp", t, spin(t), source="/ndi"),
        Stream("setpoint_jp", np.arange(0, 1, 0.01), line(t)),
    ]
    with pytest.raises(LogError, match="/ndi run backwards, the first at sample 51"):
        combine(streams)
    dropped = combine(streams, disorder="drop")
    np.testing.assert_array_equal(dropped.time, np.delete(t, 50))
    assert "run backwards" in dropped.remarks[0]
    np.testing.assert_array_equal(combine(streams, disorder="keep").time, t)


def test_a_stamp_that_jumps_costs_a_partner_one_sample():
    t = np.arange(0, 1, 0.01)
    jumping, values = t.copy(), line(t)
    jumping[50], values[50] = 0.2051, 99.0
    streams = [Stream("tracker_cp", t, spin(t)), Stream("setpoint_jp", jumping, values)]
    np.testing.assert_allclose(combine(streams, disorder="drop").setpoint_jp, line(t), atol=1e-12)


def test_a_repeated_stamp_counts_once_and_is_reported():
    t = np.array([0.0, 0.1, 0.1, 0.2])
    log = combine([Stream("tracker_cp", t, spin(t)), Stream("setpoint_jp", np.arange(0, 0.3, 0.1), np.zeros((3, 2)))])
    np.testing.assert_array_equal(log.time, [0.0, 0.1, 0.2])
    assert "1 samples of tracker_cp repeat the stamp" in log.remarks[0]


@pytest.mark.parametrize(
    ("names", "options", "message"),
    [
        ([], {}, "at least one signal"),
        (["tracker_cp", "tracker_cp"], {}, "more than one stream for one signal"),
        (["tracker_cp"], {"base": "setpoint_cp"}, "there is no stream setpoint_cp"),
        (["tracker_cp"], {"shifts": {"measured_cp": 1.0}}, "there is no stream measured_cp"),
    ],
)
def test_what_cannot_be_combined_is_refused(names: list[str], options: dict, message: str):
    t = np.arange(3.0)
    with pytest.raises(LogError, match=message):
        combine([Stream(name, t, spin(t)) for name in names], **options)


def test_a_log_taken_apart_combines_to_itself():
    log = random_log(4)
    again = combine([Stream(name, log.time, getattr(log, name)) for name in log.signals], base="setpoint_cp")
    np.testing.assert_array_equal(again.time, log.time)
    for name in ("setpoint_jp", "payload"):
        np.testing.assert_array_equal(getattr(again, name), getattr(log, name))
    np.testing.assert_array_equal(again.setpoint_cp.quaternion, log.setpoint_cp.quaternion)


TIMES = st.lists(st.one_of(st.integers(0, 6).map(float), st.just(float("nan")), st.just(float("inf"))), max_size=8)


@settings(max_examples=200, deadline=None)
@given(TIMES)
def test_no_choice_of_rising_samples_is_larger(times: list[float]):
    time = np.array(times)
    mask = rising(time)
    assert np.all(np.diff(time[mask]) > 0)
    assert np.isfinite(time[mask]).all()
    chosen = ([t for k, t in enumerate(times) if bits >> k & 1] for bits in range(2 ** len(times)))
    best = max(len(c) for c in chosen if np.isfinite(c).all() and all(a < b for a, b in pairwise(c)))
    assert mask.sum() == best


def test_groups_are_looked_at_each_for_itself():
    time, group = np.array([0, 5, 1, 6, 0.5, 7]), np.array([1, 2, 1, 2, 1, 2])
    mask = rising(time, group)
    for g in (1, 2):
        np.testing.assert_array_equal(mask[group == g], rising(time[group == g]))
    assert mask[group == 2].all()


def test_of_equal_stamps_the_first_is_kept():
    assert rising(np.array([0.0, 1.0, 1.0, 2.0])).tolist() == [True, True, False, True]
