from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from gpr_fields import planted

from gpcorrect.codec import pack, unpack
from gpcorrect.errors import DataError
from gpcorrect.gpr import ExactGPR, Predictor, SparseGPR

GROUPS = [(0, 1), (2,)]
MODELS = [ExactGPR(GROUPS), SparseGPR(60, 40, GROUPS), SparseGPR(60, 60), SparseGPR(60, 40, output_groups=(1, 1))]


@pytest.fixture(scope="module", params=MODELS, ids=str)
def predictor(request: pytest.FixtureRequest) -> Predictor:
    X, Y, _ = planted(150, seed=0)
    model: ExactGPR | SparseGPR = request.param
    return model.fit(X, Y).predictor_


def test_one_query_equals_the_batch(predictor: Predictor) -> None:
    """The hot path and the blocks give the same mean, deviation and novelty."""
    X, _, _ = planted(25, seed=1)
    mean, std, novelty = predictor.mean_std_batch(X)
    for i, x in enumerate(X):
        one = predictor.mean_std(x)
        np.testing.assert_allclose(one[0], mean[i], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(one[1], std[i], rtol=1e-8)
        assert one[2] == pytest.approx(novelty[i], abs=1e-8)


def test_novelty_is_small_amid_data_and_one_far_away(predictor: Predictor) -> None:
    """Far from all data the prediction is the prior: mean of the outputs, signal and noise together."""
    X, _, _ = planted(150, seed=0)
    assert np.median(predictor.mean_std_batch(X)[2]) < 0.1
    for distance in (1e3, 1e8):
        mean, std, novelty = predictor.mean_std(np.full(3, distance))
        assert novelty == pytest.approx(1.0)
        np.testing.assert_allclose(mean, np.concatenate([part.offset for part in predictor.parts]))
        np.testing.assert_allclose(std, np.sqrt(np.concatenate([part.signal + part.noise for part in predictor.parts])))


def test_deviation_is_at_least_the_noise(predictor: Predictor) -> None:
    """The latent variance never goes below zero, whatever rounding does."""
    X, _, _ = planted(150, seed=0)
    noise = np.concatenate([part.noise for part in predictor.parts])
    assert (predictor.mean_std_batch(X)[1] >= np.sqrt(noise) * (1 - 1e-12)).all()


def test_what_is_stored_holds_everything(predictor: Predictor) -> None:
    """Taken apart and rebuilt as a model file does it, a predictor answers bit for bit the same."""
    data, arrays = pack(predictor, "predictor")
    again = unpack(Predictor, data, {name: array.copy() for name, array in arrays.items()})
    x = np.array([0.3, -0.2, 1.1])
    for a, b in zip(predictor.mean_std(x), again.mean_std(x), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["basis", "alpha", "offset", "projection", "explained", "signal", "noise"])
def test_arrays_that_do_not_fit_together_are_refused(predictor: Predictor, name: str) -> None:
    """Compiled code does not look at shapes: one array of another shape is no predictor."""
    data, arrays = pack(predictor, "predictor")
    place = f"predictor.parts.0.{name}"
    wider = np.concatenate([arrays[place]] * 3, axis=-1)
    with pytest.raises(DataError, match="does not fit together"):
        unpack(Predictor, data, {**arrays, place: wider})


def test_nothing_can_be_changed_and_no_query_changes_anything(predictor: Predictor) -> None:
    """Arrays are read-only, and the query stays as it was."""
    with pytest.raises(ValueError, match="read-only"):
        predictor.parts[0].alpha[0, 0] = 0.0
    x = np.array([0.1, 0.2, 0.3])
    predictor.mean_std(x)
    np.testing.assert_array_equal(x, [0.1, 0.2, 0.3])


def test_threads_do_not_disturb_each_other(predictor: Predictor) -> None:
    """Queries from eight threads at once give what one thread gives."""
    X, _, _ = planted(400, seed=2)
    expected = [predictor.mean_std(x)[0] for x in X]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda x: predictor.mean_std(x)[0], X))
    np.testing.assert_array_equal(found, expected)


def test_the_mean_is_smooth_across_the_expansion_of_its_exponents(predictor: Predictor) -> None:
    """Expanding |u - z|^2 loses no digits: a finite difference of the mean is as steady as its second difference."""
    x, direction = np.array([0.4, -0.6, 0.2]), np.array([1.0, 0.5, -0.3])
    steps = np.array([predictor.mean_std(x + h * direction)[0] for h in 1e-3 * np.arange(-2, 3)])
    fourth = np.abs(np.diff(steps, 4, axis=0)).max()
    assert fourth < 1e-8
