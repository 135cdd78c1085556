"""Linear models beside each other: many candidates' gains at once, and slopes that a step brings up to date."""

import numpy as np
import pytest

from gpcorrect.discrepancy.evidence.linear import Apart, Beside, fold_of, grams, held_out_nats, solve
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


def lone_motion() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return blocks of six motions, a load, an offset that the last has with traces elsewhere, and noise."""
    rng = np.random.default_rng(2)
    block = np.repeat(np.arange(6), 200)
    load = 4.0 + np.sin(np.arange(1200) / 20.0)
    offset = np.where(block == 5, 1.0, 0.02 * rng.normal(size=1200))
    return block, load, offset, rng.normal(size=1200)


def test_a_number_that_one_motion_alone_shows_is_not_foretold_from_traces() -> None:
    """A homing of a lone motion left a trace in others, which said -144,000 nats: two slips were EXACT in its place."""
    block, _, offset, noise = lone_motion()
    fold, target = fold_of(6), 3.0 * offset + noise + np.where(block < 5, 250.0 * offset, 0.0)
    assert held_out_nats(grams(offset[:, None], target, block), fold)[5] < -1e5
    apart = Apart.of(offset[:, None], target, fold[block], 0.05)
    assert held_out_nats(grams(apart.columns, apart.residual, block), fold)[5] == 0.0
    shared = np.ones((1200, 1))
    assert Apart.of(shared, target, fold[block], 0.05).columns is shared


def test_a_cable_is_found_beside_the_homing_of_a_lone_motion_that_took_its_mean() -> None:
    """Offsets held still while the load's mean moved: a cable of 38,000 nats was never tried."""
    block, load, _, noise = lone_motion()
    known = np.stack([np.where(block < 5, 1.0, 0.0), np.where(block == 5, 1.0, 0.0)], axis=1)
    target = 5.0 * load + noise
    left = target - known @ np.linalg.lstsq(known, target, rcond=None)[0]
    rows = np.ones(1200, dtype=bool)
    assert Beside(known, left, block).gains(load[:, None, None], rows)[1][0] < 0.0
    factors, nats = Beside(known, left, block, 0.05).gains(load[:, None, None], rows)
    assert factors[0, 0] == pytest.approx(5.0, abs=0.2)
    assert nats[0] == pytest.approx(0.5 * float(left @ left - noise @ noise), rel=0.02)
    some = load * (np.arange(1200) % 3 == 0)  # what is nothing in most rows gives the same without them
    alike = (Beside(known, left, block, 0.05).gains(some[r][:, None, None], r)[1] for r in (rows, some != 0.0))
    np.testing.assert_allclose(*alike)
