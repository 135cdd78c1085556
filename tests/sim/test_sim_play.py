import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gpcorrect.errors import DataError
from gpcorrect.sim.effects import play

values = st.floats(-10, 10, allow_nan=False)
paths = arrays(np.float64, st.integers(2, 40), elements=values)
radii = st.floats(0, 5)


@given(paths)
def test_no_gap_is_no_play(path):
    """A play of radius zero is the identity."""
    np.testing.assert_array_equal(play(path, 0.0), path)


@given(paths, radii)
def test_output_stays_within_the_gap(path, radius):
    """The output is never further than the radius from the input."""
    assert (np.abs(play(path, radius) - path) <= radius + 1e-12).all()


@given(paths, radii, st.integers(1, 5))
def test_rate_independence(path, radius, repeats):
    """Running slower (each monotone step cut into finer ones) changes no value at the old samples."""
    fine = np.interp(np.arange(0, (len(path) - 1) * repeats + 1) / repeats, np.arange(len(path)), path)
    np.testing.assert_allclose(play(fine, radius)[::repeats], play(path, radius), atol=1e-12)


@given(paths, radii, values)
def test_wiping_out(path, radius, later):
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
def test_odd_symmetry(path, radius):
    """A play knows no preferred direction."""
    np.testing.assert_array_equal(play(-path, radius), -play(path, radius))


def test_loop_width_is_the_gap():
    """On a large enough sweep forth and back the branches lie two radii apart."""
    path = np.concatenate([np.linspace(-1, 1, 201), np.linspace(1, -1, 201)])
    output = play(path, 0.1)
    assert output[100] == pytest.approx(-0.1)
    assert output[301] == pytest.approx(0.1)


@pytest.mark.parametrize("radius", [-0.1, float("nan")])
def test_a_negative_gap_is_refused(radius):
    with pytest.raises(DataError, match="half width"):
        play(np.zeros(3), radius)
