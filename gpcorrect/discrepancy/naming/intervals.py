"""How well a set's numbers are known, and whether an effect's size is the same in every trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, fields

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher
from scipy.stats import t as student

from gpcorrect.discrepancy.evidence.linear import solve
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.instants import instant_half_width
from gpcorrect.discrepancy.search.linearisation import linearise, refine
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.types import BoolArray, FloatArray, IntArray

FEW_BLOCKS = 3  # trajectories a size: there Hotelling's limit is about twice that of known covariances
NEAREST = 0.02  # of a size, that counts as nothing: there its signature is within an error of our own signatures
HALVINGS = 5  # of the way to the end of an interval: to a thirtieth of it
PROFILED = 12  # evaluations of a fit with one number held
DROPPED = 1e-3  # of the product of variance and information, which is 1 at least: below, rounding has left nothing
TANGENT = 0.5  # the part of a signature's error that a change of a single number could make


def columns_of(fitted: Sequence[FittedEffect], fit: FittedEffect) -> IntArray:
    """Return the places of an effect's coordinates among all of a set.

    Parameters
    ----------
    fitted : sequence of FittedEffect, the set
    fit : FittedEffect, one of it
    """
    index = next(i for i, m in enumerate(fitted) if m is fit)
    begin = sum(len(m.u) for m in fitted[:index])
    return np.arange(begin, begin + len(fit.u))


def half_widths(search: Search, fit: FittedEffect, known: Sequence[int] = ()) -> dict[int, float]:
    """Return the half widths of the 95 % intervals of one effect's coordinates.

    The larger of sandwich (by trajectory) and Gauss-Newton, and what an error in the shape of our own signatures adds:
    an effect that is seen a hundred times above noise is still only known as well as its operator describes it.
    Sandwich with whole trajectories as units: Liang and Zeger 1986, Biometrika 73(1).

    Parameters
    ----------
    search : Search, a set, and the rows and noise to use
    fit : FittedEffect, one of the set
    known : sequence of int, coordinates of its that are taken for known, and left out
    """
    own, coordinates, whitener = columns_of(search.fitted, fit), fit.candidate.coordinates, search.whitener
    left = [i for i in range(len(own)) if i not in known]
    sandwich, plain, freedom, seen = _covariances(search, own[list(known)])
    variance = np.maximum(np.diag(sandwich), np.diag(plain))
    whole, near = search.residual(search.fitted), [m for m in search.fitted if search.alike(m.candidate, fit.candidate)]
    changes = [search.residual([m for m in search.fitted if m is not alike]) - whole for alike in near]
    energy = sum(float((whitener.whiten(change) ** 2).sum()) for change in changes)
    variance += (TANGENT * NAMING.shape_error) ** 2 * energy * np.diag(plain)
    half = np.where(seen, student.ppf(0.975, freedom) * np.sqrt(variance), np.inf)[own[0] : own[0] + len(left)]
    widths = dict(zip(left, np.maximum(half, NAMING.finest * np.abs(fit.u[left])).tolist(), strict=True))
    for i in left:
        if not np.isfinite(widths[i]):  # these sensors do not see it: it may be anything
            widths[i] = coordinates[i].width
        if coordinates[i].parameter.change_point:  # no slope says how well an instant is known
            widths[i] = instant_half_width(whitener, [m for m in search.fitted if m is not fit], fit)
    return widths


def interval_ends(search: Search, fit: FittedEffect) -> dict[int, tuple[float, float]]:
    """Return the ends of the 95 % intervals of one effect's coordinates.

    Those of :func:`half_widths`; but a size and a shape may trade places along a curve, and the straight line then goes
    through nothing where the effect is beyond doubt. Where a lone size's interval holds nothing, that end is sought by
    profile likelihood: where the rest, fitted anew, loses as much as the line says it does.

    Parameters
    ----------
    search, fit : as for :func:`half_widths`
    """
    widths, candidate = half_widths(search, fit), fit.candidate
    ends = {i: (float(fit.u[i]) - half, float(fit.u[i]) + half) for i, half in widths.items()}
    (k, *more), nothing = candidate.sizes, candidate.coordinates[candidate.sizes[0]].identity
    low, high = ends[k]
    if more or candidate.extra == 0 or not low <= nothing <= high or fit.u[k] == nothing:
        return ends
    place = columns_of(search.fitted, fit)
    sigma = float(np.sqrt(_covariances(search, place[:0])[1].diagonal()[place[k]]))
    fixed, near = search.parted([m for m in search.fitted if m is not fit], candidate)
    most = search.misfit(search.fitted) + 0.5 * (widths[k] / sigma) ** 2
    shown = search.shown([candidate, *(m.candidate for m in near)])

    def possible(u: float) -> bool:
        held = refine(search.whitener, fixed, [*near, fit.pinned(k, u)], PROFILED, channels=shown)
        return search.misfit([*fixed, *held]) <= most

    inside, nearest = float(fit.u[k]), nothing + NEAREST * (float(fit.u[k]) - nothing)
    outside = float(np.clip(nearest, *candidate.coordinates[k].bounds))  # a resonance that is none has no frequency
    if possible(outside):
        return ends
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if possible(middle) else (inside, middle)
    ends[k] = (outside, high) if fit.u[k] > nothing else (low, outside)
    return ends


def without_idle_numbers(search: Search) -> tuple[FittedEffect, ...]:
    """Return a set in which, of an effect's several sizes of either sign, those that nothing asks for are nothing.

    They are what noise makes of them, or have moved with one that they trade places with. Backward elimination, as long
    as the set stays within the 95 % region of the numbers that are nothing.

    Parameters
    ----------
    search : Search, the set at its best numbers, and the rows and noise to use
    """
    whitener, fitted = search.whitener, search.fitted
    columns = {(i, k): columns_of(fitted, f)[k] for i, f in enumerate(fitted) for k in f.candidate.sizes}
    prior = np.array([c.prior_weight for f in fitted for c in f.candidate.coordinates])
    several = [p for p in columns if len(fitted[p[0]].candidate.sizes) > 1 and prior[columns[p]] > 0.0]
    if not several:
        return fitted

    def nothing(place: tuple[int, int]) -> float:
        return fitted[place[0]].candidate.coordinates[place[1]].identity

    best, least, idle = list(fitted), search.misfit(fitted), set[tuple[int, int]]()
    shown = search.shown(f.candidate for f in fitted)
    while left := [p for p in several if p not in idle]:
        slopes = linearise(whitener, best).slopes
        slopes[:, [columns[p] for p in idle]] = 0.0
        known = np.diag(np.linalg.pinv(slopes.T @ slopes + np.diag(prior**2), hermitian=True))
        i, k = min(left, key=lambda p: (best[p[0]].u[p[1]] - nothing(p)) ** 2 / max(known[columns[p]], 1e-300))
        held = list(best)
        for n, m in (*idle, (i, k)):
            held[n] = held[n].pinned(m, nothing((n, m)))
        found = refine(whitener, (), held, PROFILED, channels=shown)
        moved = [FittedEffect(f.candidate, m.u) for f, m in zip(fitted, found, strict=True)]
        for n, m in (*idle, (i, k)):
            moved[n] = moved[n].moved(m, nothing((n, m)))
        if 2.0 * (search.misfit(moved) - least) > chi2.ppf(0.95, len(idle) + 1):
            break
        best = moved
        idle.add((i, k))
    return tuple(best)


def undetermined(search: Search, fit: FittedEffect) -> list[str]:
    """Return the names of an effect's shape parameters whose 95 % interval is no narrower than a part of their range.

    A shape that may be anything is a smooth curve under the effect's name: it says nothing of the machine. Numbers with
    a default only refine what has its name without them, but for those that give shape to a second size. A phase is
    that of a wave at zero, where the joint may never have been: it is asked for with the wave's number taken for known,
    and is then the same wherever zero lies.

    Parameters
    ----------
    search, fit : as for :func:`half_widths`
    """
    candidate = fit.candidate
    refining = {f.name for f in fields(candidate.kind) if f.default is not MISSING}
    refining -= {p.shaped_by for p in candidate.kind.about.parameters}
    shapes = {
        i: c
        for i, c in enumerate(candidate.coordinates)
        if i not in candidate.sizes
        and not c.parameter.change_point
        and np.isfinite(c.width)
        and c.parameter.name not in refining
    }
    if not shapes:
        return []
    lengths = [i for i, c in shapes.items() if c.parameter.period is None]
    widths = half_widths(search, fit)
    if 0 < len(lengths) < len(shapes):
        alone = half_widths(search, fit, lengths)
        widths |= {i: alone[i] for i in shapes if i not in lengths}
    return [c.parameter.name for i, c in shapes.items() if 2.0 * widths[i] > NAMING.determined * c.width]


def away_from_nothing(search: Search, fit: FittedEffect) -> bool:
    """Return whether an effect's sizes, together and in its present shape, differ from those of none (5 % level).

    Together, because two sizes may trade places: neither is known well alone, and yet not both can be nothing. In its
    present shape, because an effect of no size has none (Davies 1977, Biometrika 64(2)); but a spring that is mostly
    cubic has hardly any of its linear part in its present shape, and of a lone size with a shape the profile decides.

    Hotelling's T-squared of the sizes, with either covariance. With fewer than three trajectories a size it is almost
    without power (its limit is in the thousands), and Student's t of the sizes' present mixture is taken.

    Parameters
    ----------
    search, fit : as for :func:`half_widths`
    """
    own, sizes = columns_of(search.fitted, fit), list(fit.candidate.sizes)
    distance = np.array([fit.u[i] - fit.candidate.coordinates[i].identity for i in sizes])
    if not np.isfinite(distance).all():  # a size that only its logarithm measures has no nothing
        return True
    shape = np.delete(own, sizes)
    sandwich, plain, freedom, _ = _covariances(search, shape)
    places = own[sizes] - np.searchsorted(shape, own[sizes])
    covariances = [v[np.ix_(places, places)] for v in (sandwich, plain)]
    if FEW_BLOCKS * len(sizes) > freedom:  # too few trajectories to know how all sizes scatter: their mixture alone
        along = np.linalg.pinv(covariances[1], hermitian=True) @ distance
        squares = [float(along @ distance) ** 2 / max(float(along @ v @ along), 1e-300) for v in covariances]
        return bool(min(squares) > fisher.ppf(0.95, 1, freedom))
    k = len(sizes)
    limit = k * freedom / (freedom - k + 1) * fisher.ppf(0.95, k, freedom - k + 1)
    if min(distance @ np.linalg.pinv(v, hermitian=True) @ distance for v in covariances) > limit:
        return True
    if k > 1 or fit.candidate.extra == 0:
        return False
    low, high = interval_ends(search, fit)[sizes[0]]
    return not low <= fit.candidate.coordinates[sizes[0]].identity <= high


def _covariances(search: Search, without: IntArray) -> tuple[FloatArray, FloatArray, int, BoolArray]:
    """Sandwich and Gauss-Newton covariance of all coordinates but some, the sandwich's freedom, and which are seen.

    A variance is no smaller than it would be were all the others known, but where rounding has dropped it.
    """
    linearised, block = linearise(search.whitener, search.fitted), search.whitener.block
    slopes = np.delete(linearised.slopes, without, axis=1)
    n_blocks = int(block.max()) + 1
    freedom = max(n_blocks - 1, 1)
    gram = slopes.T @ slopes
    inverse: FloatArray = np.linalg.pinv(gram, hermitian=True).astype(np.float64)
    seen: BoolArray = np.diag(inverse) * np.diag(gram) > DROPPED
    # each trajectory's influence first: of columns that are nearly one, the product of all would leave rounding only
    influence = np.stack([inverse @ (slopes[block == b].T @ linearised.z[block == b]) for b in range(n_blocks)])
    sandwich: FloatArray = influence.T @ influence * n_blocks / freedom
    return sandwich, inverse, freedom, seen


def explained_by_others(search: Search, fit: FittedEffect) -> float:
    """Return the fraction of an effect's tangent (along its amplitude) that the others' tangents make up.

    Parameters
    ----------
    search, fit : as for :func:`half_widths`
    """
    slopes, own = linearise(search.whitener, search.fitted).slopes, columns_of(search.fitted, fit)
    tangent, others = slopes[:, own[fit.candidate.sizes[0]]], np.delete(slopes, own, axis=1)
    if others.shape[1] == 0 or not tangent.any():
        return 0.0
    left: FloatArray = tangent - others @ solve(others.T @ others, others.T @ tangent)
    return 1.0 - float(left @ left / (tangent @ tangent))


def size_overdispersion(search: Search, fit: FittedEffect) -> float:
    """Return how much more an effect's size differs between trajectories than noise lets it, 1 at least.

    Noise that wanders slowly gives every trajectory a size of its own; nats counted sample by sample do not know that.
    Each trajectory's score along the signature, in its standard deviations, has a mean square of one; what the sum of
    squares is above its 95 % quantile says by how much evidence counts less.

    Parameters
    ----------
    search : Search
    fit : FittedEffect, one of the set
    """
    score, energy = _scores(search, fit)
    if not len(energy):
        return 1.0
    return max(1.0, float((score**2 / energy).sum() / chi2.ppf(0.95, len(energy))))


def size_spread(search: Search, fit: FittedEffect) -> float:
    """Return the standard deviation of an effect's size between trajectories, beyond noise, as a part of the size.

    What a part of a machine is or does is the same in every motion. 0 where noise may be all of the difference (0.1 %
    level). DerSimonian and Laird 1986, Controlled Clinical Trials 7(3), Eq. 8.

    Parameters
    ----------
    search : Search
    fit : FittedEffect, one of the set
    """
    score, energy = _scores(search, fit)
    freedom, change = len(energy) - 1, score / energy
    if freedom < NAMING.few - 1:
        return 0.0
    differs = float(energy @ (change - np.average(change, weights=energy)) ** 2)
    if differs < chi2.isf(NAMING.chance_of_spread, freedom):
        return 0.0
    return float(np.sqrt((differs - freedom) / (energy.sum() - (energy**2).sum() / energy.sum())))


def _scores(search: Search, fit: FittedEffect) -> tuple[FloatArray, FloatArray]:
    """Score along the relative size of an effect, and its information, of each trajectory in which the effect acts."""
    linearised, candidate = search.linearise_near(search.fitted, fit.candidate), fit.candidate
    near, sizes = search.parted(search.fitted, candidate)[1], list(candidate.sizes)
    size = np.array([fit.u[i] - candidate.coordinates[i].identity for i in sizes])
    size = np.where(np.isfinite(size), size, 1.0)  # the logarithm of a size is relative already
    own = linearised.slopes[:, columns_of(near, fit)[sizes]] @ size
    block = search.whitener.block
    energy, score = np.bincount(block, own**2), np.bincount(block, own * linearised.z)
    active = energy > NAMING.active * energy.max(initial=0.0)
    return score[active], energy[active]
