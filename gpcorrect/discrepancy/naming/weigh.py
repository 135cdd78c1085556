"""Evidence for one effect of a set: what it gains, and what could stand in its place.

Rivals are other effects, refitted there; the unknown is a smooth model there and beside it.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.naming.intervals import size_overdispersion
from gpcorrect.discrepancy.naming.occam import factors_of, linear_evidence, own_slopes, price_of, shape_evidence
from gpcorrect.discrepancy.naming.smooth_model import smooth_columns, smooth_nats
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.linearisation import Linearisation, held_out
from gpcorrect.discrepancy.search.state import Search, View, penalty
from gpcorrect.discrepancy.search.stepwise import Ranked, rank
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.errors import DataError
from gpcorrect.sim.effects.dynamics import VelocityFilter
from gpcorrect.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Rival:
    """Another candidate in an effect's place, and its nats."""

    fit: FittedEffect
    nats: float  # beyond the set without either
    price: float  # nats that its further numbers cost, as :func:`~gpcorrect.discrepancy.naming.occam.price_of` has it
    # what the data say of its shape, where it is a fuller law of the effect's family that says something else here
    shape_nats: float = np.inf

    @property
    def candidate(self) -> Candidate:
        """Which one."""
        return self.fit.candidate


@dataclass(frozen=True, eq=False)
class Own:
    """What an effect gains beyond the set without it."""

    rest: tuple[FittedEffect, ...]  # the set without it, fitted anew
    reference: tuple[FloatArray, FloatArray]  # whitened residual of that set on discovery and confirmation
    discovery: FloatArray  # (b,) nats of each trajectory of this part
    confirmation: FloatArray  # (b,)
    overdispersion: float  # by how much evidence counts less, because the residual is still larger than noise
    of_steps: float = 0.0  # nats of what is a matter of the servo's steps beside it, and of what may still be

    @property
    def nats(self) -> float:
        """Of both parts."""
        return float(self.discovery.sum() + self.confirmation.sum())

    @property
    def found(self) -> float:
        """Nats on the discovery part, divided by the overdispersion."""
        return float(self.discovery.sum()) / self.overdispersion


@dataclass(frozen=True, eq=False)
class Weighed:
    """Evidence for one effect, and for what could stand in its place."""

    own: Own
    price: float  # nats that its further numbers cost
    active: BoolArray  # (b,) in which trajectories of discovery, then confirmation, it acts: a slip does not at first
    rivals: tuple[Rival, ...]  # those like it and those that it is a special case of, best first
    instead: float  # nats of the smooth model in its place
    beside: float  # and beside it


def own_gain(view: View, fit: FittedEffect) -> Own:
    """Weigh an effect of the set against nothing in its place.

    Parameters
    ----------
    view : View
    fit : FittedEffect, one of the set
    """
    search, candidate = view.search, fit.candidate
    rest = search.refit([m for m in search.fitted if m is not fit], candidate)
    reference = view.whitened_residuals(rest)
    gains = _gains(view, reference, search.fitted, fit)
    left = search.overdispersion(view.whitened_residuals(search.fitted)[0], search.touched(candidate))
    scene = search.dataset.scene
    of_loop = [m for m in search.fitted if m.effect.is_a_matter_of_steps(scene.machine.drive, scene.joints)]
    others = [m for m in search.fitted if m is fit or m not in of_loop]
    of_steps = search.misfit(others) - search.misfit(search.fitted) + left_to_steps(view)
    return Own(rest, reference, *gains, max(left, size_overdispersion(search, fit)), of_steps)


def left_to_steps(view: View) -> float:
    """Return the nats that steps taken otherwise would gain beside the set: up to one step's lag of speeds, or lead.

    Parameters
    ----------
    view : View
    """
    dataset, effects = view.search.dataset, [f.effect for f in view.search.fitted]
    if dataset.scene.plan is None:
        return 0.0
    lag = VelocityFilter("all", 1.0 / dataset.scene.machine.drive.rate_hz)
    try:
        change = dataset.predict([*effects, lag]) - dataset.predict(effects)
    except DataError:  # a loop that bears no lag
        return 0.0
    nats = 0.0
    left, by_lag = view.whitened_residuals(view.search.fitted), view.whitened(change[:, :, None])
    for z, (d,) in zip(left, (part.T for part in by_lag), strict=True):
        fraction = float(np.clip(d @ z / max(float(d @ d), 1e-300), -1.0, 1.0))
        nats += fraction * float(d @ z) - 0.5 * fraction**2 * float(d @ d)
    return nats


def weigh(view: View, fit: FittedEffect, own: Own) -> Weighed:
    """Weigh an effect of the set against what could stand in its place.

    Parameters
    ----------
    view : View
    fit : FittedEffect, one of the set
    own : Own, what it gains
    """
    search, channels = view.search, _strongest_channels(view, fit)
    columns = smooth_columns(view, own.rest, channels)
    instead, beside = (smooth_nats(view, fitted, channels, columns) for fitted in (own.rest, search.fitted))
    margin = NAMING.hopeless * between_effects(own, beside, penalty(search.n_kinds))
    price = price_of(search, search.fitted, fit, own.overdispersion)
    rivals: list[Rival] = []
    for more in (_same(view, own, fit, price), _more_general(search, own, fit, price), _rivals(view, own, fit, margin)):
        rivals += [r for r in more if not any(r.candidate.called_like(known.candidate) for known in rivals)]
    best = tuple(sorted(rivals, key=lambda r: -r.nats))
    return Weighed(own, price, _active(view, fit), best, instead, beside)


def between_effects(own: Own, beside: float, cost: float) -> float:
    """Return by how much nats between two effects count less while something else is still missing.

    What neither explains, and the smooth model sees beside them, may favour either by as much as it is: a lead of that
    size leaves the rival at e^-3, the edge of the stable set. So does a lead that a small error in the shape of our own
    signatures could make: both are models, and neither is exact. Or one that the steps of the machine's servo could
    make, which are not ours: effects that are a matter of those steps show by how much.

    Parameters
    ----------
    own : Own, what the effect gains
    beside : float, nats of the smooth model beside it
    cost : float, prior nats that any effect costs
    """
    tolerated = max(beside - cost, NAMING.shape_error**2 * own.nats, own.of_steps)
    return max(own.overdispersion, tolerated / float(-np.log(NAMING.stable)))


def _active(view: View, fit: FittedEffect) -> BoolArray:
    """Trajectories of both parts in which an effect changes the channels by more than a little of what it can."""
    without = view.whitened_residuals([m for m in view.search.fitted if m is not fit])
    whole = view.whitened_residuals(view.search.fitted)
    blocks = view.search.whitener.block, view.confirmation.block
    energy = np.concatenate([np.bincount(k, (a - b) ** 2) for a, b, k in zip(without, whole, blocks, strict=True)])
    return np.asarray(energy > NAMING.active * energy.max(initial=0.0), dtype=np.bool_)


def _gains(
    view: View, reference: tuple[FloatArray, FloatArray], fitted: Sequence[FittedEffect], fit: FittedEffect
) -> tuple[FloatArray, FloatArray]:
    """Nats of each trajectory, of discovery and of confirmation, that a set gains with a fit over a reference."""
    linearised = view.search.linearise_near(fitted, fit.candidate)
    discovery = held_out(view.search.whitener, reference[0], linearised.z, linearised.slopes)
    change = 0.5 * (reference[1] ** 2 - view.whitened_residuals(fitted)[1] ** 2)
    confirmation = np.bincount(view.confirmation.block, change).astype(np.float64)
    if price := view.placed(fitted, fit)[1]:
        confirmation[confirmation.argmax()] -= price
    return discovery, confirmation


def _rivals(view: View, own: Own, fit: FittedEffect, margin: float) -> list[Rival]:
    """Those that may come within some nats of the effect; the others are fitted no further than is plain.

    Laws with more numbers than the effect, or than a rival that is as near to it, may say the same and more. Of those
    that a report calls alike, the most probable one.
    """
    search = view.search
    worth = search.misfit(search.fitted) + margin
    bare = search.linearise_near(own.rest, fit.candidate)
    change = _change(view, own, search.fitted)
    found: list[Rival] = []
    for place, leader in enumerate(_leaders(search, bare, fit.candidate)):
        candidate = leader.candidate
        near = [fit.candidate, *(r.candidate for r in found if r.nats > own.nats - margin)]
        fuller = any(_is_kin(candidate, c) and candidate.extra > c.extra for c in near)
        enough = sum(not r.candidate.called_like(fit.candidate) for r in found) >= NAMING.rivals
        if (enough or place >= NAMING.tried) and not (fuller or _is_simpler(candidate, fit.candidate)):
            continue
        if any(candidate.called_like(r.candidate) and candidate.extra == r.candidate.extra for r in found):
            continue
        if _likeness(view, own, leader.fit, change, bare.slopes) < NAMING.likeness:
            continue
        fitted = search.refit_with(own.rest, leader.fit, worth)
        if fitted is None:
            continue
        other = _change(view, own, fitted) - change
        differs = float(other @ other) > NAMING.shape_error**2 * float(change @ change)
        gains = _gains(view, own.reference, fitted, fitted[-1])
        shape_nats = shape_evidence(search, fitted) if fuller and differs else np.inf
        price = price_of(search, fitted, fitted[-1], own.overdispersion)
        found.append(Rival(fitted[-1], float(gains[0].sum() + gains[1].sum()), price, shape_nats))
    best = sorted(found, key=lambda r: min(r.price, r.shape_nats) - r.nats)
    return [r for i, r in enumerate(best) if not any(r.candidate.called_like(b.candidate) for b in best[:i])]


def _leaders(search: Search, bare: Linearisation, candidate: Candidate) -> list[Ranked]:
    """Candidates by their linear gain in an effect's place, then fuller shapes of those of its family."""
    touched = search.touched(candidate)
    ranked = [r for r in rank(search, bare, [candidate], touched) if r.nats > 0]
    kin = [r.candidate for r in ranked if _is_kin(r.candidate, candidate) and r.candidate.extra == 0]
    return ranked + (rank(search, bare, [candidate], touched, kin) if kin else [])


def _change(view: View, own: Own, fitted: Sequence[FittedEffect]) -> FloatArray:
    """Return what a set takes from the whitened residual without the effect, on the discovery part."""
    return own.reference[0] - view.whitened_residuals(fitted)[0]


def _is_simpler(rival: Candidate, candidate: Candidate) -> bool:
    """Whether a rival is a look-alike in the catalogue, on the same joint, with fewer numbers: it may say the same."""
    alike = candidate.kind.about.neighbours
    return rival.name in alike and rival.joint == candidate.joint and rival.extra < candidate.extra


def _is_kin(rival: Candidate, candidate: Candidate) -> bool:
    """Whether a rival is a law of the same family, on the same joint, that may say the same."""
    about = rival.kind.about
    same = about.family == candidate.kind.about.family and rival.joint == candidate.joint
    return same and candidate.name in about.neighbours


def _likeness(view: View, own: Own, other: FittedEffect, b: FloatArray, slopes: FloatArray) -> float:
    """Cosine of another effect's whitened change with one, once the part along the others' tangents is taken off both.

    None of one that is no machine, such as a loop that a stop makes unstable at the size that its signature asks for.
    """
    try:
        a = _change(view, own, (*own.rest, other))
    except DataError:
        return 0.0
    if slopes.shape[1]:
        basis, _ = np.linalg.qr(slopes)
        a, b = a - basis @ (basis.T @ a), b - basis @ (basis.T @ b)
    return float(abs(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300))


def _same(view: View, own: Own, fit: FittedEffect, price: float) -> list[Rival]:
    """Return the effect that does the same on this machine, with this one's evidence, if there is one.

    It may have more numbers: that they agree says nothing against it, for one cause may be behind them.
    """
    other = fit.effect.like()
    kind = next((t.candidate for t in view.search.traces if other is not None and t.candidate.may_be(other)), None)
    if kind is None:
        return []
    twin = FittedEffect(kind, np.array([c.coordinate(getattr(other, c.parameter.name)) for c in kind.coordinates]))
    change, same = (_change(view, own, (*own.rest, one)) for one in (fit, twin))
    differs = float((same - change) @ (same - change)) > NAMING.shape_error**2 * float(change @ change)
    return [] if differs else [Rival(twin, own.nats, price)]


def _more_general(search: Search, own: Own, fit: FittedEffect, price: float) -> list[Rival]:
    """Return look-alikes in the catalogue of which an effect is a special case.

    An error of the first row of a kinematic table is an error of the registration. No data rule such a one out, unless
    they would show its further numbers, were those as large as the ones that are seen. So both are weighed by their
    evidence as linear models (Bishop 2006, Eq. 3.86) whose numbers have a normal prior of one size, in units of what is
    typical of each: that of the effect's own numbers. Effects that do not grow with every number are no such models.
    """
    if not _is_linear(fit.candidate):
        return []
    alike, rest, noisier = fit.candidate.kind.about.neighbours, own.rest, own.overdispersion
    slopes = own_slopes(search, search.fitted, fit)
    change = slopes @ fit.u
    alone = linear_evidence(slopes, fit.u, change, search.misfit(search.fitted), noisier)
    if not np.isfinite(alone):
        return []
    found: dict[Hashable, Rival] = {}
    for trace in search.traces:
        other = trace.candidate
        is_wider = other.extra > fit.candidate.extra and other.name in alike and _is_linear(other)
        if not is_wider or other.key in found or any(other.key == m.candidate.key for m in rest):
            continue
        columns = search.whitened(trace.change)
        factors = factors_of(columns, change)
        left = change - columns @ factors
        if left @ left > NAMING.general * (change @ change):
            continue
        fitted = search.refit_with(rest, FittedEffect(other, other.scaled(factors)))
        if fitted is not None:
            wider = own_slopes(search, fitted, fitted[-1])
            nats = linear_evidence(wider, fitted[-1].u, change, search.misfit(fitted), noisier) - alone
            # in the evidence, all numbers are paid for
            found[other.key] = Rival(fitted[-1], own.nats + noisier * nats, price)
    return list(found.values())


def _is_linear(candidate: Candidate) -> bool:
    return all(c.amplitude and c.identity == 0.0 and not c.parameter.shaped_by for c in candidate.coordinates)


def _strongest_channels(view: View, fit: FittedEffect) -> BoolArray:
    """Mask of the few channels in which an effect is largest beside the noise."""
    search = view.search
    touched = search.touched(fit.candidate)
    change = search.dataset.predict([fit.effect]) - search.dataset.predict()
    size = np.sqrt(np.mean(change**2, axis=0)) / search.whitener.std
    few = np.argsort(np.where(touched, size, -1.0))[::-1][: NAMING.smooth_channels]
    return touched & np.isin(np.arange(len(touched)), few)
