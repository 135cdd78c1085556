"""Linear models beside each other: many candidates' gains at once, and slopes that a step brings up to date."""

import numpy as np
import pytest

from gpcorrect.discrepancy.evidence.linear import Beside, fold_of, grams, held_out_nats, solve
from gpcorrect.discrepancy.search.linearisation import _Secant


@pytest.mark.parametrize("in_order", [True, False])
@pytest.mark.parametrize(("known", "sets", "size"), [(0, 4, 2), (5, 7, 1), (8, 5, 3)])
def test_gains_of_many_candidates_are_those_of_each_set_alone(known, sets, size, in_order):
    """One Schur complement each says what least squares on all columns does: of dead, tiny and doubled ones as well."""
    rng = np.random.default_rng(known)
    block = np.sort(rng.integers(0, 23, 2000))
    if not in_order:
        rng.shuffle(block)
    columns = rng.normal(size=(2000, known))
    columns[:, -1:] *= 1e-9
    new = rng.normal(size=(2000, sets, size)) * 10.0 ** rng.normal(size=(sets, size))
    new[:, 1, 0] = 0.0
    if known:
        new[:, 2, 0] = columns[:, 0] + 1e-5 * rng.normal(size=2000)
    residual = rng.normal(size=2000) + 0.3 * new[:, 0, 0]
    fold = fold_of(23)

    rows = rng.random(2000) < 0.4 if in_order else np.ones(2000, dtype=bool)
    new[~rows] = 0.0
    factors, nats = Beside(columns, residual, block).gains(new[rows], rows)

    before = held_out_nats(grams(columns, residual, block), fold).sum() if known else 0.0
    for i in range(sets):
        both = grams(np.hstack([columns, new[:, i]]), residual, block)
        alone = solve(both.gram.sum(axis=0), both.moment.sum(axis=0))[known:]
        assert nats[i] == pytest.approx(held_out_nats(both, fold).sum() - before, abs=1e-8)
        assert factors[i] == pytest.approx(alone, rel=1e-6, abs=1e-9)


def test_slopes_are_taken_anew_only_where_a_step_was_not_foretold():
    """A bent law near its best numbers needs its slopes once; far from them, each step needs new ones."""
    x = np.linspace(0.0, 1.0, 200)
    taken = []

    def errors(u):
        return u[0] * np.exp(u[1] * x) - 2.0 * np.exp(0.5 * x)

    def slopes(u):
        taken.append(u)
        return np.stack([np.exp(u[1] * x), u[0] * x * np.exp(u[1] * x)], axis=1)

    near = _Secant(errors, slopes)
    near(np.array([2.01, 0.51]))
    moved = near(np.array([2.001, 0.501]))
    assert len(taken) == 1
    assert moved @ np.array([-0.009, -0.009]) == pytest.approx(errors([2.001, 0.501]) - errors([2.01, 0.51]))
    near(np.array([8.0, 3.0]))
    assert len(taken) == 2
    assert near(np.array([2.0, 0.5])) == pytest.approx(slopes(np.array([2.0, 0.5])))


def test_a_number_that_one_block_alone_shows_is_not_foretold_from_traces() -> None:
    """A homing of a lone motion left a trace in others, which said -144,000 nats; two slips were EXACT in its place."""
    rng = np.random.default_rng(2)
    block = np.repeat(np.arange(6), 200)
    columns = np.where(block == 5, 1.0, 0.02 * rng.normal(size=1200))[:, None]
    target = 3.0 * columns[:, 0] + rng.normal(size=1200) + np.where(block < 5, 5.0 * columns[:, 0] / 0.02, 0.0)
    sums, folds = grams(columns, target, block), fold_of(6)
    assert held_out_nats(sums, folds)[5] < -1e5
    assert held_out_nats(sums, folds, least=0.05)[5] == 0.0
    shared = grams(np.ones((1200, 1)), target, block)
    np.testing.assert_array_equal(held_out_nats(shared, folds, least=0.05), held_out_nats(shared, folds))
