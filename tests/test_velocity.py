"""Laws of velocities: exactness on polynomials, gaps, uneven times, spins, streams."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.velocity import CausalTwist, derivative, segment_labels, twists


def uneven_times(n, seed=0, step=0.01):
    """Return increasing times whose steps vary between 0.3 and 1.7 of `step`."""
    return np.cumsum(np.random.default_rng(seed).uniform(0.3 * step, 1.7 * step, n))


def assert_exact(coefficients, time, seed, step, tolerance):
    """Differentiate three random polynomials of so many coefficients."""
    rng = np.random.default_rng(seed)
    polynomials = [np.polynomial.Polynomial(rng.normal(size=coefficients), domain=[0, time[-1]]) for _ in range(3)]
    values = np.stack([p(time) for p in polynomials], axis=1)
    exact = np.stack([p.deriv()(time) for p in polynomials], axis=1)
    got = derivative(time, values, np.zeros(len(time), dtype=int), step)
    np.testing.assert_allclose(got, exact, atol=tolerance * max(1.0, np.abs(exact).max()))


@given(st.integers(0, 10_000), st.integers(5, 40), st.sampled_from([None, 0.005, 0.03]))
def test_quartics_are_differentiated_exactly(seed, n, step):
    """On any spacing, where a step holds no more than five samples, polynomials of degree four are exact everywhere."""
    assert_exact(5, uneven_times(n, seed, step=0.2), seed, step, 1e-8)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_short_runs_use_fewer_points(n):
    """A run of n < 5 samples is exact for polynomials of degree n - 1."""
    time = uneven_times(n, seed=n)
    polynomial = np.polynomial.Polynomial(np.arange(1.0, n + 1))
    got = derivative(time, polynomial(time)[:, None], np.zeros(n, dtype=int))
    np.testing.assert_allclose(got[:, 0], polynomial.deriv()(time), rtol=1e-9)


@given(st.integers(0, 10_000), st.integers(6, 300), st.sampled_from([0.4, 1.0, 10.0]))
def test_quadratics_are_differentiated_exactly(seed, n, step):
    """On any spacing, however many samples a step holds, the derivative of a parabola is exact everywhere."""
    assert_exact(3, uneven_times(n, seed, step=0.05), seed, step, 1e-9)


def slope_noise(rate, step):
    """Return the spread of the derivative of white noise of unit size, away from the ends."""
    time, noise = np.arange(8000) / rate, np.random.default_rng(3).normal(size=(8000, 1))
    return derivative(time, noise, np.zeros(8000, dtype=int), step)[50:-50].std()


def test_noise_of_a_step_is_that_of_a_line_through_all_samples():
    """At 100 Hz a step of 0.05 s, 21 samples, passes sqrt(12 / (21 (21^2 - 1))) of the noise over 0.01 s."""
    assert slope_noise(100, 0.05) == pytest.approx(np.sqrt(12 / (21 * 440)) / 0.01, rel=0.05)
    assert slope_noise(100, 0.05) < 0.05 * slope_noise(100, None)


def test_more_samples_in_a_step_pass_less_noise():
    """Twice the rate under the same step halves the variance of the derivative, but for the rim of the window."""
    assert slope_noise(200, 0.05) ** 2 / slope_noise(100, 0.05) ** 2 == pytest.approx(1 / 2, rel=0.1)


def test_any_rate_is_differentiated():
    """At ten thousand samples a second a parabola through a bounded number of them is still exact."""
    time = np.arange(3000) / 1e4
    got = derivative(time, (time**2)[:, None], np.zeros(3000, dtype=int), 0.05)
    np.testing.assert_allclose(got[:, 0], 2 * time, atol=1e-9)


def test_one_row_of_a_dense_path_is_that_of_numpy_polyfit():
    """An independent least-squares parabola, inside the run and at its end."""
    time, values = uneven_times(40, 5), np.random.default_rng(6).normal(size=40)
    got = derivative(time, values[:, None], np.zeros(40, dtype=int), 100.0)[:, 0]
    peer = np.polynomial.Polynomial.fit(time, values, 2).deriv()
    np.testing.assert_allclose(got, peer(time), rtol=1e-8)


def test_no_derivative_without_neighbours():
    """Label -1 and runs of one sample are NaN; their neighbours are not."""
    time = np.arange(6) * 0.1
    labels = np.array([0, 0, -1, 1, 2, 2])
    values = np.where(labels == -1, np.nan, time)[:, None]
    got = derivative(time, values, labels)[:, 0]
    np.testing.assert_array_equal(np.isnan(got), [False, False, True, True, False, False])
    np.testing.assert_allclose(got[[0, 1, 4, 5]], 1.0)


@given(st.integers(0, 1000), st.sampled_from([None, 0.03]))
def test_runs_do_not_see_each_other(seed, step):
    """Changing one run's values leaves every other run's derivative unchanged."""
    rng = np.random.default_rng(seed)
    time, values = uneven_times(60, seed), rng.normal(size=(60, 2))
    labels = segment_labels(time, np.arange(60) // 20, rng.random(60) > 0.1)
    changed = np.where(labels[:, None] == labels.max(), 1e6, values)
    others = labels != labels.max()
    before, after = derivative(time, values, labels, step), derivative(time, changed, labels, step)
    np.testing.assert_array_equal(before[others], after[others])


def test_derivative_commutes_with_shift_of_time_and_value():
    """Adding a constant to time or values changes nothing, even a Unix time."""
    time = uneven_times(50)
    values = np.sin(3 * time)[:, None]
    labels = np.zeros(50, dtype=int)
    base = derivative(time, values, labels)
    np.testing.assert_allclose(derivative(time + 1.7e9, values, labels), base, rtol=1e-3)
    np.testing.assert_allclose(derivative(time, values + 1e3, labels), base, atol=1e-8)


@pytest.mark.parametrize("bad", [0.02, 0.0])
def test_repeated_and_backward_times_are_refused_with_their_place(bad):
    """A stamp that does not advance raises and names the sample; across runs it is allowed."""
    time = np.array([0.0, 0.01, 0.02, bad, 0.04])
    with pytest.raises(DataError, match="sample 2"):
        derivative(time, np.zeros((5, 1)), np.zeros(5, dtype=int))
    apart = derivative(time, np.zeros((5, 1)), np.array([0, 0, 0, 1, 1]))
    np.testing.assert_array_equal(apart, 0.0)


def test_shapes_and_steps_are_checked():
    """Arrays of different lengths and a step of zero are refused."""
    with pytest.raises(DataError, match="must match"):
        derivative(np.arange(3.0), np.zeros((4, 1)), np.zeros(3, dtype=int))
    with pytest.raises(DataError, match="positive"):
        derivative(np.arange(3.0), np.zeros((3, 1)), np.zeros(3, dtype=int), step=0.0)
    with pytest.raises(DataError, match="rotations"):
        twists(np.arange(3.0), np.zeros((3, 3)), np.zeros((2, 3, 3)), np.zeros(3, dtype=int))


def test_empty_paths_stay_empty():
    """No samples give no labels and no derivatives."""
    assert segment_labels([], []).shape == (0,)
    assert derivative([], np.zeros((0, 3)), []).shape == (0, 3)


def test_labels_break_at_rejections_trajectories_and_gaps():
    """A rejected sample, a new trajectory and a long step each begin a new run."""
    time = np.array([0.0, 1, 2, 3, 4, 5, 6, 20, 21, 22]) * 0.01
    trajectory = np.array([0, 0, 0, 0, 0, 1, 1, 1, 1, 1])
    keep = np.array([True, True, False, True, True, True, True, True, True, True])
    np.testing.assert_array_equal(segment_labels(time, trajectory, keep), [0, 0, -1, 1, 1, 2, 2, 3, 3, 3])


def test_default_gap_follows_each_trajectory_own_rate():
    """Steps of 1 s are no gap in a 1 Hz trajectory beside one at 100 Hz."""
    time = np.concatenate([np.arange(50) * 0.01, 10 + np.arange(50.0)])
    trajectory = np.repeat([0, 1], 50)
    np.testing.assert_array_equal(segment_labels(time, trajectory), trajectory)


def test_labels_refuse_broken_input():
    """Unequal lengths and missing times raise."""
    with pytest.raises(DataError, match=r"\(n,\)"):
        segment_labels([0.0, 1.0], [0])
    with pytest.raises(DataError, match="sample 1 is not finite"):
        segment_labels([0.0, np.nan], [0, 0])


@given(st.integers(0, 10_000), st.sampled_from([None, 0.03]))
def test_constant_spin_is_exact_in_the_spatial_frame(seed, step):
    """R(t) = exp(t w) R_0 has spatial angular velocity w everywhere, on uneven times."""
    rng = np.random.default_rng(seed)
    time, spin, start = uneven_times(30, seed), rng.normal(size=3), se3.matrix_from_rotvec(rng.normal(size=3))
    rotations = se3.matrix_from_rotvec(time[:, None] * spin) @ start
    got = twists(time, time[:, None] * spin, rotations, np.zeros(30, dtype=int), step)
    np.testing.assert_allclose(got, np.tile(np.concatenate([spin, spin]), (30, 1)), atol=1e-9)


def test_spatial_twist_turns_with_the_world_and_not_with_the_body():
    """Q R turns the angular velocity by Q; R Q leaves it."""
    rng = np.random.default_rng(2)
    time = uneven_times(40)
    rotations = se3.matrix_from_rotvec(np.sin(time[:, None] * [3.0, 5.0, 7.0]))
    Q, labels, still = se3.matrix_from_rotvec(rng.normal(size=3)), np.zeros(40, dtype=int), np.zeros((40, 3))
    base = twists(time, still, rotations, labels)[:, 3:]
    np.testing.assert_allclose(twists(time, still, Q @ rotations, labels)[:, 3:], base @ Q.T, atol=1e-10)
    np.testing.assert_allclose(twists(time, still, rotations @ Q, labels)[:, 3:], base, atol=1e-10)


def test_varying_spin_agrees_with_the_matrix_derivative():
    """The angular velocity is the vee of dR/dt R^T, from an analytic R(t)."""
    time = np.linspace(0, 1, 401)
    roll = np.pad(np.sin(2 * time)[:, None], ((0, 0), (0, 2)))
    yaw = np.pad((time**2)[:, None], ((0, 0), (2, 0)))
    rotations = se3.matrix_from_rotvec(yaw) @ se3.matrix_from_rotvec(roll)
    exact = np.stack([np.cos(time**2), np.sin(time**2), 0 * time], axis=1) * (2 * np.cos(2 * time))[:, None]
    exact[:, 2] = 2 * time
    got = twists(time, np.zeros((401, 3)), rotations, np.zeros(401, dtype=int))
    np.testing.assert_allclose(got[:, 3:], exact, atol=1e-7)


def test_positions_alone_leave_the_angular_part_missing():
    """Without rotations the angular velocity is NaN and the linear is not."""
    time = np.arange(5.0)
    got = twists(time, np.outer(time, [1.0, 2.0, 3.0]), None, np.zeros(5, dtype=int))
    np.testing.assert_allclose(got[:, :3], np.tile([1.0, 2.0, 3.0], (5, 1)))
    assert np.isnan(got[:, 3:]).all()


def test_missing_poses_outside_runs_do_no_harm():
    """NaN poses labelled -1 neither raise nor spread."""
    time = np.arange(12) * 0.1
    rotations = se3.matrix_from_rotvec(time[:, None] * [0.0, 0.0, 1.0])
    positions = np.outer(time, [1.0, 0.0, 0.0])
    keep = np.arange(12) != 5
    rotations[5], positions[5] = np.nan, np.nan
    got = twists(time, positions, rotations, segment_labels(time, np.zeros(12), keep))
    np.testing.assert_allclose(got[keep], np.tile([1.0, 0, 0, 0, 0, 1.0], (11, 1)), atol=1e-12)
    assert np.isnan(got[5]).all()


def spinning_stream(time, velocity, spin):
    positions = 0.3 + time[:, None] * velocity
    return positions, se3.matrix_from_rotvec(time[:, None] * spin)


@given(st.integers(0, 10_000))
def test_stream_is_exact_on_straight_motion_and_constant_spin(seed):
    """From the second sample on, the causal estimate is the true twist, on uneven steps."""
    rng = np.random.default_rng(seed)
    time, velocity, spin = uneven_times(25, seed), rng.normal(size=3), rng.normal(size=3)
    estimator = CausalTwist()
    samples = zip(time, *spinning_stream(time, velocity, spin), strict=True)
    estimates = [estimator.update(*sample) for sample in samples]
    assert np.isnan(estimates[0]).all()
    np.testing.assert_allclose(estimates[1:], np.tile([*velocity, *spin], (24, 1)), atol=1e-8)


def test_stream_is_exact_on_constant_acceleration_from_the_third_sample():
    """A parabola's end slope is exact."""
    time = uneven_times(20)
    estimator = CausalTwist()
    got = np.array([estimator.update(t, [t**2, 0.0, -(t**2)])[0] for t in time])
    np.testing.assert_allclose(got[2:], 2 * time[2:], atol=1e-9)


def test_stream_looks_only_back():
    """An estimate does not change with what comes later, and equals a fresh estimator's on the same past."""
    time = uneven_times(30)
    positions = np.random.default_rng(1).normal(size=(30, 3))
    long, short = CausalTwist(), CausalTwist()
    whole = np.array([long.update(t, p) for t, p in zip(time, positions, strict=True)])
    part = np.array([short.update(t, p) for t, p in zip(time[:17], positions[:17], strict=True)])
    np.testing.assert_array_equal(whole[:17], part)


def test_stream_forgets_what_is_older_than_its_window():
    """A jump leaves the estimate once it has left the window."""
    estimator = CausalTwist(window=0.05)
    time = np.arange(40) * 0.01
    got = np.array([estimator.update(t, [100.0 if t < 0.1 else t, 0, 0])[0] for t in time])
    assert np.abs(got[10:14]).max() > 100
    np.testing.assert_allclose(got[16:], 1.0, atol=1e-9)


def test_stream_starts_afresh_after_a_gap():
    """The first sample after a pause has no twist, the next is not drawn towards the time before."""
    estimator = CausalTwist(max_gap=0.5)
    for t in np.arange(5) * 0.01:
        estimator.update(t, [0.0, 0.0, 0.0])
    assert np.isnan(estimator.update(2.0, [1.0, 0.0, 0.0])[:3]).all()
    np.testing.assert_allclose(estimator.update(2.01, [1.02, 0.0, 0.0])[:3], [2.0, 0.0, 0.0])


def test_slow_streams_keep_three_samples():
    """At 5 Hz, slower than the window, the estimate still fits a parabola."""
    estimator = CausalTwist(window=0.05)
    got = [estimator.update(t, [t**2, 0.0, 0.0])[0] for t in np.arange(6) * 0.2]
    np.testing.assert_allclose(got[2:], 2 * 0.2 * np.arange(2, 6))


def test_stream_rotation_may_come_and_go():
    """Without a rotation the angular part is NaN; samples that have one are used again when it returns."""
    estimator = CausalTwist()
    turn = se3.matrix_from_rotvec(np.arange(4)[:, None] * [0.0, 0.0, 0.02])
    got = [estimator.update(0.01 * i, [0.0, 0.0, 0.0], None if i == 2 else turn[i])[5] for i in range(4)]
    np.testing.assert_allclose(got, [np.nan, 2.0, np.nan, 2.0])


def test_stream_refuses_bad_samples_and_goes_on():
    """A repeated stamp, NaN and wrong shapes raise; the past stays usable."""
    estimator = CausalTwist()
    estimator.update(0.0, [0.0, 0.0, 0.0])
    for time, position, rotation in [
        (0.0, [0, 0, 0], None),
        (-1.0, [0, 0, 0], None),
        (np.nan, [0, 0, 0], None),
        (1.0, [np.nan, 0, 0], None),
        (1.0, [0, 0], None),
        (1.0, [0, 0, 0], np.full((3, 3), np.nan)),
        (1.0, [0, 0, 0], np.eye(4)),
    ]:
        with pytest.raises(DataError):
            estimator.update(time, position, rotation)
    np.testing.assert_allclose(estimator.update(0.1, [0.2, 0, 0])[:3], [2.0, 0, 0])
    with pytest.raises(DataError, match="positive"):
        CausalTwist(window=0.0)


def test_callers_arrays_are_left_alone():
    """Neither paths nor stream samples are written to, and later changes of a sample are not seen."""
    estimator, sample = CausalTwist(), np.zeros(3)
    estimator.update(0.0, sample)
    sample[:] = 99.0
    np.testing.assert_allclose(estimator.update(1e-2, np.zeros(3))[:3], 0.0)
