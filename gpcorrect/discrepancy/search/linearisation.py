"""A set of effects on the data: signatures and tangents through the simulator, refinement, held-out gain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from gpcorrect.discrepancy.evidence.linear import Apart, fold_of, grams, held_out_nats
from gpcorrect.discrepancy.evidence.whitener import DatasetWhitener
from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.scene import LOOP_STAGES
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.instants import with_best_instant
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.errors import DataError
from gpcorrect.parallel import each_here
from gpcorrect.types import BoolArray, FloatArray

STEP = 0.002  # of a coordinate, for finite differences: far below a wave's turn over the range of a joint
SMALLEST_STEP = 5e-4  # of a coordinate near zero
MAX_EVALUATIONS = 16  # of a set in a refinement: for time
HALVINGS = 8  # of sizes at which no machine could be
FTOL = 1e-5  # of the misfit: steps that change it less end a refinement
TRUST = 0.1  # of a step's change; slopes that foretell it better are not taken anew (Broyden 1965, Math. Comp. 19)
HOPE = 3.0  # times the last step's gain, which steps that gain three quarters of the one before come to in all


def signature(dataset: Dataset, base: FloatArray, candidate: Candidate) -> FloatArray | None:
    """Return the change of the channels when a candidate is inserted at its start.

    Parameters
    ----------
    dataset : Dataset, of m rows and c channels
    base : (m, c) array, channels without it, near the nominal machine as well
    candidate : Candidate

    Returns
    -------
    (m, c, a) array or None
        A column for each amplitude (or one); None when the simulator refuses the effect on this machine.
    """
    columns, nothing = [], [c.identity for c in candidate.coordinates]
    for i in candidate.amplitudes or (-1,):
        alone = [nothing[k] if k in candidate.amplitudes and k != i else u for k, u in enumerate(candidate.start)]
        try:
            columns.append(dataset.predict([candidate.build(np.array(alone))], near=()) - base)
        except DataError:
            return None
    return np.stack(columns, axis=2)


def _tangents(
    dataset: Dataset, fixed: Sequence[FittedEffect], free: Sequence[FittedEffect], known: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Channels `(m, c)` of a set, if they are not known, and their derivatives `(m, c, p)` along every coordinate."""
    base = [f.effect for f in (*fixed, *free)]
    sets, steps = [base], []
    for i, fit in enumerate(free):
        low, high = fit.candidate.bounds
        for j, u in enumerate(fit.u):
            step = max(STEP * abs(u), SMALLEST_STEP)
            ahead = u + step <= high[j] or high[j] - u > u - low[j]
            moved = fit.moved(j, min(u + step, high[j]) if ahead else max(u - step, low[j]))
            sets.append([f.effect for f in (*fixed, *free[:i], moved, *free[i + 1 :])])
            steps.append(np.inf if j == fit.candidate.instant else moved.u[j] - u)  # an instant has no slope
    at = dataset.predict(base) if known is None else known
    in_loop = any(f.candidate.kind.stage in LOOP_STAGES for f in free)
    unmoved, *others = each_here(partial(dataset.predict, near=base) if in_loop else dataset.predict, sets)
    columns = [(other - unmoved) / step for other, step in zip(others, steps, strict=True)]
    return at, np.stack(columns, axis=2) if columns else np.zeros((*at.shape, 0))


def refine(
    whitener: DatasetWhitener,
    fixed: Sequence[FittedEffect],
    free: Sequence[FittedEffect],
    evaluations: int = MAX_EVALUATIONS,
    worth: float = np.inf,
    channels: BoolArray | None = None,
) -> list[FittedEffect]:
    """Fit the free effects' numbers by bounded least squares through the simulator; the fixed ones stay.

    Parameters
    ----------
    whitener : DatasetWhitener, data, and the rows and noise to fit with
    fixed, free : sequences of FittedEffect, the set
    evaluations : int, of the set, at most
    worth : float
        Nats of misfit, half the sum of squares, that somebody asks for: a fit that will not come there ends early.
    channels : (c,) bool array, optional
        Those in which the free effects show, which alone are looked at then.

    Raises
    ------
    DataError
        The set is no machine that can be simulated, nor is it with smaller sizes of the free effects.
    """
    dataset, seen = whitener.dataset, np.ones(len(whitener.noises), dtype=np.bool_) if channels is None else channels
    whitener, elsewhere = whitener.of_channels(seen), whitener.of_channels(~seen)
    free = _with_instants(whitener, fixed, free)
    coordinates = [c for f in free for c in f.candidate.coordinates]
    if not coordinates:
        return []
    low, high = np.array([c.bounds for c in coordinates]).T
    prior = np.array([c.prior_weight for c in coordinates])

    @lru_cache(maxsize=1)
    def simulated(u: tuple[float, ...]) -> FloatArray:
        return dataset.predict([f.effect for f in (*fixed, *_at(free, np.array(u)))])

    def errors(u: FloatArray) -> FloatArray:
        try:
            at = simulated(tuple(u))
        except DataError:  # no machine, such as one whose loop is unstable: a step that leads there is made shorter
            return np.full(len(whitener.weight) + len(u), np.inf)
        return np.concatenate([whitener.whiten(dataset.observed - at), prior * u])

    def taken(u: FloatArray) -> FloatArray:
        slopes = whitener.whiten_columns(_tangents(dataset, fixed, _at(free, u), simulated(tuple(u)))[1])
        return np.concatenate([-slopes, np.diag(prior)])

    costs: list[float] = []
    start = _first_machine(free, errors)
    unmoved = elsewhere.whiten(dataset.observed - simulated(tuple(start)))
    rest = 0.5 * float(unmoved @ unmoved)

    def stop_if_hopeless(intermediate_result: OptimizeResult) -> None:
        costs.append(intermediate_result.cost)
        if len(costs) > 1 and costs[-1] - HOPE * (costs[-2] - costs[-1]) + rest > worth:
            raise StopIteration

    with np.errstate(over="ignore"):  # of a step to a loop that is all but unstable, which is not taken
        found = least_squares(
            errors,
            start,
            jac=_Secant(errors, taken),
            bounds=(low, high),
            max_nfev=evaluations,
            ftol=FTOL,
            callback=stop_if_hopeless,
        )
    return _at(free, found.x)


def _with_instants(
    whitener: DatasetWhitener, fixed: Sequence[FittedEffect], free: Sequence[FittedEffect]
) -> list[FittedEffect]:
    placed = list(free)
    for i, fit in enumerate(placed):
        if fit.candidate.instant is not None:
            placed[i] = with_best_instant(whitener, [*fixed, *placed[:i], *placed[i + 1 :]], fit)
    return placed


class _Secant:
    """Slopes that are brought up to date by each step that they foretell (Broyden 1965), and else taken anew.

    Parameters
    ----------
    errors, taken : callables, of coordinates `(p,)`: errors `(n,)` and their slopes `(n, p)`
    """

    def __init__(self, errors: Callable[[FloatArray], FloatArray], taken: Callable[[FloatArray], FloatArray]) -> None:
        self._errors, self._taken = errors, taken
        self._last: tuple[FloatArray, FloatArray, FloatArray] | None = None  # coordinates, errors and slopes

    def __call__(self, u: FloatArray) -> FloatArray:
        """Return the slopes `(n, p)`."""
        here = self._errors(u)
        slopes = self._taken(u) if self._last is None else self._updated(u, here, *self._last)
        self._last = u.copy(), here, slopes
        return slopes

    def _updated(
        self, u: FloatArray, here: FloatArray, before: FloatArray, errors: FloatArray, slopes: FloatArray
    ) -> FloatArray:
        step = u - before
        if not step.any():
            return slopes
        change = slopes @ step
        missed = here - errors - change
        cost, foretold, found = (float(e @ e) for e in (errors, errors + change, here))
        gains = cost - found > (1.0 - TRUST) * (cost - foretold) or cost - foretold < FTOL * found
        if gains and missed @ missed < TRUST**2 * (change @ change):
            return slopes + np.outer(missed, step / (step @ step))
        return self._taken(u)


def _first_machine(free: Sequence[FittedEffect], errors: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return the first coordinates inside their bounds that can be simulated: the effects' own, or smaller sizes."""
    coordinates = [c for f in free for c in f.candidate.coordinates]
    low, high = np.array([c.bounds for c in coordinates]).T
    inside = np.nextafter(low, high), np.nextafter(high, low)
    start = np.clip(np.concatenate([f.u for f in free]), *inside)
    nothing = np.array([c.identity if c.amplitude else u for c, u in zip(coordinates, start, strict=True)])
    for k in range(HALVINGS):
        u: FloatArray = np.clip(nothing + 0.5**k * (start - nothing), *inside)
        if np.isfinite(errors(u)).all():
            return u
    tried = " and ".join(f.candidate.label for f in free)
    raise DataError(f"no machine with {tried} can be simulated, at any size that was tried.")


def _at(fitted: Sequence[FittedEffect], u: FloatArray) -> list[FittedEffect]:
    ends = np.cumsum([len(f.u) for f in fitted])
    return [FittedEffect(f.candidate, part) for f, part in zip(fitted, np.split(u, ends[:-1]), strict=True)]


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A set with tangents."""

    fitted: tuple[FittedEffect, ...]
    z: FloatArray  # (M,) whitened residual that it leaves
    slopes: FloatArray  # (M, p) whitened tangents of its free coordinates


def linearise(
    whitener: DatasetWhitener, free: Sequence[FittedEffect], fixed: Sequence[FittedEffect] = ()
) -> Linearisation:
    """Take residual and tangents of a set.

    Parameters
    ----------
    whitener : DatasetWhitener, data, and the rows and noise to take them with
    free, fixed : sequences of FittedEffect, the set; the fixed ones' numbers stay
    """
    at, slopes = _tangents(whitener.dataset, fixed, free)
    residual = whitener.whiten(whitener.dataset.observed - at)
    return Linearisation((*fixed, *free), residual, whitener.whiten_columns(slopes))


def held_out(whitener: DatasetWhitener, reference: FloatArray, z: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the held-out gain in nats `(b,)` of each block that a set brings over a reference residual.

    Its numbers are refitted (to first order) without the block's fold, but for those that show in hardly any other.

    Parameters
    ----------
    whitener : DatasetWhitener, that made the columns
    reference, z : (M,) arrays, whitened residual without the set, and with it at its best numbers
    slopes : (M, p) array, its whitened tangents
    """
    block = whitener.block
    n_blocks = int(block.max()) + 1
    before, after = np.bincount(block, reference**2, n_blocks), np.bincount(block, z**2, n_blocks)
    gains: FloatArray = 0.5 * (before - after).astype(np.float64)
    if slopes.shape[1]:
        fold = fold_of(n_blocks)
        apart = Apart.of(slopes, z, fold[block], SEARCH.foretold)
        gains += held_out_nats(grams(apart.columns, apart.residual, block), fold, ridge=1e-4)
    return gains
