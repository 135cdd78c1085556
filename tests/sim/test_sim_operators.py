"""Memory: the compiled operators against independent integrators, and their invariants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from gpcorrect.sim.effects.bouc_wen import bouc_wen
from gpcorrect.sim.effects.operators import HELD, PAUSES, lag, play, ring, shifted

values = st.floats(-10, 10, allow_nan=False)
paths = arrays(np.float64, st.integers(2, 30), elements=values)
widths = st.floats(0.01, 5)
sharpnesses = st.floats(0.5, 12)
radii = st.floats(0, 5)


def uneven(n=60, seed=0, mean=0.05):
    """Return times and a random path with uneven steps."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.exponential(mean, n))
    return time, np.cumsum(rng.standard_normal(n)) * 0.1


def solved(rates, start, time, path):
    """Integrate `rates(t, x, u, du/dt)` piece by piece along the piecewise linear path, with tight tolerances."""
    states = [np.asarray(start, dtype=np.float64)]
    for t0, t1, u0, u1 in zip(time[:-1], time[1:], path[:-1], path[1:], strict=True):
        slope = (u1 - u0) / (t1 - t0)

        def f(t, x, t0=t0, u0=u0, slope=slope):
            return rates(t, x, u0 + slope * (t - t0), slope)

        states.append(solve_ivp(f, (t0, t1), states[-1], rtol=1e-10, atol=1e-12, method="LSODA").y[:, -1])
    return np.array(states)


@pytest.mark.parametrize("sharpness", [0.7, 1.0, 2.0, 6.0])
def test_bouc_wen_agrees_with_an_ode_solver(sharpness):
    """The element integrated along the path is the textbook's differential equation in time."""
    time, path = uneven()
    width = 0.15

    def rates(_, z, __, v):
        return v * (1.0 - np.abs(z / width) ** sharpness * (1.0 + np.sign(z * v)) / 2.0)

    exact = solved(rates, [0.0], time, path)[:, 0]
    assert np.abs(exact).max() > 0.9 * width
    np.testing.assert_allclose(bouc_wen(path, width, sharpness), exact, atol=1e-5 * width)


@pytest.mark.parametrize("time_constant", [0.01, 0.3, 20.0])
def test_lag_agrees_with_an_ode_solver(time_constant):
    """A first-order lag on uneven samples is exact."""
    time, path = uneven()
    exact = solved(lambda _, x, u, __: (u - x) / time_constant, [path[0]], time, path)[:, 0]
    np.testing.assert_allclose(lag(path, time, time_constant), exact, atol=1e-7)


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.7, 1.0, 2.5])
@pytest.mark.parametrize("frequency", [1.0, 8.0])
def test_ring_agrees_with_an_ode_solver(frequency, damping):
    """A second-order response on uneven samples is exact, under, at and over critical damping."""
    time, path = uneven()
    omega = 2 * np.pi * frequency
    exact = solved(
        lambda _, x, u, __: [x[1], omega**2 * (u - x[0]) - 2 * damping * omega * x[1]], [path[0], 0.0], time, path
    )[:, 0]
    np.testing.assert_allclose(ring(path, time, frequency, damping), exact, atol=1e-6)


@pytest.mark.parametrize("delay", [-0.4, 0.03, 0.2, 9.0])
def test_a_shifted_path_is_the_monotone_cubic(delay):
    """Between uneven samples, over repeated moments and missing values, the curve is SciPy's."""
    time, path = uneven()
    path[7:11], path[20], time[-5:] = path[7], np.nan, time[-6]
    known = np.isfinite(path) & np.r_[True, np.diff(time) > 0]
    at = np.clip(time - delay, time[known][0], time[known][-1])
    expected = PchipInterpolator(time[known], path[known])(at)
    np.testing.assert_allclose(shifted(path[:, None], time[:, None], delay)[:, 0], expected, atol=1e-13)


@given(paths, widths, sharpnesses)
def test_bouc_wen_stays_within_its_width(path, width, sharpness):
    """The state never leaves [-w, w], and never moves further than the input."""
    z = bouc_wen(path, width, sharpness)
    assert (np.abs(z) <= width * (1 + 1e-12)).all()
    assert (np.abs(np.diff(z)) <= np.abs(np.diff(path)) + 1e-9).all()


@given(paths, widths, sharpnesses)
def test_bouc_wen_never_gives_energy_back_over_a_loop(path, width, sharpness):
    """Round any closed path repeated until it closes, the element takes work and returns less (dissipation >= 0)."""
    fine = np.interp(np.linspace(0, len(path), 60 * len(path) + 1), np.arange(len(path) + 1), [*path, path[0]])
    loops = np.concatenate([fine] + [fine[1:]] * 4)
    z = bouc_wen(loops, width, sharpness)
    last = slice(-len(fine), None)
    u, force = loops[last], z[last]
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(u))
    assert work >= -0.02 * width * (1.0 + np.abs(np.diff(u)).sum())


@given(paths, widths, sharpnesses, st.integers(2, 4))
def test_bouc_wen_does_not_depend_on_speed(path, width, sharpness, repeats):
    """Cutting each monotone step into finer ones changes no value at the old samples."""
    fine = np.interp(np.arange(0, (len(path) - 1) * repeats + 1) / repeats, np.arange(len(path)), path)
    np.testing.assert_allclose(
        bouc_wen(fine, width, sharpness)[::repeats], bouc_wen(path, width, sharpness), atol=2e-5 * width
    )


def test_a_sharp_bouc_wen_element_is_a_play():
    """As the exponent grows, the input less the state becomes the play of the same radius."""
    path = np.sin(np.linspace(0, 20, 800)) * np.linspace(1, 0.1, 800)
    gaps = [np.abs(path - bouc_wen(path, 0.1, n) - play(path, 0.1)).max() for n in (2.0, 8.0, 200.0)]
    assert gaps[0] > gaps[1] > gaps[2]
    assert gaps[2] < 1e-3


def test_minor_loops_are_curved():
    """After a reversal beyond the straight return the state follows a curve, where a play has a corner."""
    path = np.concatenate([np.linspace(0, 1, 101), np.linspace(1, 0.6, 101)])
    curve = np.diff(bouc_wen(path, 0.1, 1.0)[102:], 2)
    assert (curve > 0).sum() > 30
    assert (np.abs(np.diff((path - play(path, 0.1))[102:], 2)) > 1e-12).sum() <= 2


@pytest.mark.parametrize("pause", PAUSES)
def test_a_lag_that_begins_beside_its_balance_forgets_it_exponentially(pause):
    """What is left of the beginning, also over a pause; the next session begins by its own balance."""
    time = np.stack([np.arange(0.0, 4.0, 0.1), np.arange(6.0, 10.0, 0.1), np.arange(1.0, 5.0, 0.1)], axis=1)
    force, session = 2.0 + np.sin(3.0 * time), np.array([0, 0, 1])
    settled, relaxed = (lag(force, time, 2.5, session, pause=pause, balance=b) for b in (1.0, 0.0))
    next_one = force[-1, 1] if pause == PAUSES[HELD] else force[0, 2]  # held: that of the last load
    expected = np.where(session == 0, force[0, 0], next_one) * np.exp(-(time - time[0, [0, 0, 2]]) / 2.5)
    np.testing.assert_allclose(settled - relaxed, expected, atol=1e-12)


@given(paths)
def test_limits_of_the_lag(path):
    """A lag of no time is the identity; an endless one never leaves its start."""
    time = np.arange(len(path)) * 0.1
    np.testing.assert_allclose(lag(path, time, 0.0), path)
    np.testing.assert_allclose(lag(path, time, 1e-9), path, atol=1e-6)
    np.testing.assert_allclose(lag(path, time, 1e12), path[0], atol=1e-9)


OPERATORS = {
    "play": lambda u, t, memory=None: play(u, 0.1, memory),
    "bouc_wen": lambda u, t, memory=None: bouc_wen(u, 0.1, 2.0, memory),
    "lag": lambda u, t, memory=None: lag(u, t, 0.2, memory=memory),
    "ring": lambda u, t, memory=None: ring(u, t, 5.0, 0.2, memory),
}


@pytest.mark.parametrize("operator", OPERATORS.values(), ids=OPERATORS)
def test_a_missing_sample_is_forgotten(operator):
    """A missing sample is missing in the output, and what follows is as if it had never been taken."""
    time, path = uneven()
    holed = path.copy()
    holed[20] = np.nan
    kept = np.arange(len(path)) != 20
    output = operator(holed, time)
    assert np.isnan(output[20])
    np.testing.assert_array_equal(output[kept], operator(path[kept], time[kept]))


@pytest.mark.parametrize("operator", OPERATORS.values(), ids=OPERATORS)
def test_columns_are_operated_on_each_by_itself(operator):
    """Runs side by side come out as each alone, and the input is left as it was."""
    pairs = [uneven(seed=s) for s in range(3)]
    time, path = (np.stack(arrays_, axis=1) for arrays_ in zip(*pairs, strict=True))
    before = path.copy()
    alone = np.stack([operator(u, t) for t, u in pairs], axis=1)
    np.testing.assert_array_equal(operator(path, time), alone)
    np.testing.assert_array_equal(path, before)


@pytest.mark.parametrize("operator", OPERATORS.values(), ids=OPERATORS)
def test_a_moment_given_twice_does_no_harm(operator):
    """Padded runs repeat their last sample: the output stays finite and stays where it was."""
    time, path = uneven()
    t, u = np.append(time, time[-1]), np.append(path, path[-1])
    output = operator(u, t)
    assert output[-1] == pytest.approx(output[-2], abs=1e-12)


def test_runs_cut_from_one_another_lag_as_the_whole_does():
    """Cut into runs with nothing between them, in any order of columns, a session's lag is that of the uncut path."""
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.01, 0.3, 400))
    path = np.cumsum(rng.normal(size=400))
    whole = lag(path, time, 7.0)
    order = [2, 0, 3, 1]
    cut = [column.reshape(4, 100).T[:, order] for column in (path, time)]
    through = lag(*cut, 7.0, np.zeros(4, dtype=np.int64))
    np.testing.assert_allclose(through, whole.reshape(4, 100).T[:, order], atol=1e-12)


def test_sessions_know_nothing_of_one_another():
    """The first run of a session starts in balance, whatever came before."""
    time = np.tile(np.linspace(0.0, 5.0, 50)[:, None], (1, 2)) + np.array([0.0, 6.0])
    path = np.tile(np.sin(time[:, :1]), (1, 2)) + np.array([0.0, 3.0])
    apart = lag(path, time, 4.0, np.array([0, 1]))
    np.testing.assert_allclose(apart, lag(path, time, 4.0))
    assert not np.allclose(lag(path, time, 4.0, np.array([0, 0])), apart)


@pytest.mark.parametrize(("pause", "between"), [("linear", (1.0, 3.0)), ("held", (1.0, 1.0)), ("at_once", (3.0, 3.0))])
def test_a_pause_is_as_if_what_it_says_had_been_logged(pause, between):
    """The second run begins as after a pause with a sample at either end of it; the lag of that is exact."""
    logged_time, logged = np.array([0.0, 1e-9, 6.0 - 1e-9, 6.0, 7.0]), np.array([1.0, *between, 3.0, 3.0])
    through = lag(np.array([[1.0, 3.0]] * 2), np.array([[-1.0, 6.0], [0.0, 7.0]]), 4.0, np.zeros(2, int), None, pause)
    np.testing.assert_allclose(through[:, 1], lag(logged, logged_time, 4.0)[3:], atol=1e-6)


def test_what_is_held_is_held_from_session_to_session():
    """A load that waits for the next motion has long settled when another session begins; its clock starts anew."""
    time, path = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([[1.0, 3.0], [2.0, 3.0]])
    first, second = lag(path, time, 4.0, np.array([0, 1]), None, "held").T
    assert first[0] == 1.0
    assert second[0] == 2.0
    assert second[1] == pytest.approx(3.0 - np.exp(-0.25))


@given(st.lists(st.integers(1, 59), max_size=4, unique=True).map(sorted), st.sampled_from(sorted(OPERATORS)))
def test_an_operator_goes_on_where_it_stopped(cuts, name):
    """With one memory, the stretches of a path, wherever it is cut, come out as the whole does."""
    time, path = uneven()
    path[[13, 30]] = np.nan
    memory = {}
    pieces = [slice(a, b) for a, b in zip([0, *cuts], [*cuts, 60], strict=True)]
    one_by_one = np.concatenate([OPERATORS[name](path[s], time[s], memory) for s in pieces])
    np.testing.assert_allclose(one_by_one, OPERATORS[name](path, time), atol=1e-12)


@given(paths)
def test_no_gap_is_no_play(path):
    """A play of radius zero is the identity."""
    np.testing.assert_array_equal(play(path, 0.0), path)


@given(paths, radii)
def test_a_play_stays_within_its_gap(path, radius):
    """The output is never further than the radius from the input."""
    assert (np.abs(play(path, radius) - path) <= radius + 1e-12).all()


@given(paths, radii, st.integers(1, 5))
def test_a_play_does_not_depend_on_speed(path, radius, repeats):
    """Running slower (each monotone step cut into finer ones) changes no value at the old samples."""
    fine = np.interp(np.arange(0, (len(path) - 1) * repeats + 1) / repeats, np.arange(len(path)), path)
    np.testing.assert_allclose(play(fine, radius)[::repeats], play(path, radius), atol=1e-12)


@given(paths, radii, values)
def test_an_excursion_wipes_the_memory_of_a_play_out(path, radius, later):
    """An excursion beyond everything before wipes the memory out: what follows depends on nothing older."""
    extreme = np.abs(path).max() + 2 * radius + 1.0
    after = np.array([extreme, later])
    other = np.array([0.0, *after])
    np.testing.assert_allclose(play(np.concatenate([path, after]), radius)[-2:], play(other, radius)[-2:], atol=1e-12)


@given(paths, radii, radii)
def test_plays_in_series_add_up(path, first, second):
    """A play behind a play is one play of both radii together."""
    np.testing.assert_allclose(play(play(path, first), second), play(path, first + second), atol=1e-9)


@given(paths, radii)
def test_a_play_knows_no_preferred_direction(path, radius):
    """A play knows no preferred direction."""
    np.testing.assert_array_equal(play(-path, radius), -play(path, radius))


def test_the_loop_of_a_play_is_as_wide_as_its_gap():
    """On a large enough sweep forth and back the branches lie two radii apart."""
    path = np.concatenate([np.linspace(-1, 1, 201), np.linspace(1, -1, 201)])
    output = play(path, 0.1)
    assert output[100] == pytest.approx(-0.1)
    assert output[301] == pytest.approx(0.1)
