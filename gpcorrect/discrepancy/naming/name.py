"""Which names may be given: the posterior of each effect against none, its rivals and the unknown.

And the level that follows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.naming.intervals import away_from_nothing, explained_by_others
from gpcorrect.discrepancy.naming.posterior import Alternative, Level, Named, posterior
from gpcorrect.discrepancy.naming.weigh import View, Weighed, smooth_nats, weigh
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.state import Search, penalty
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["fraction_closed", "name_effect", "overtone_nats"]


def fraction_closed(search: Search, fit: FittedEffect) -> float:
    """Return the fraction of the mean square above noise that the set closes in an effect's channels, the best of them.

    On discovery and confirmation, sample by sample. 1 where what is left may be noise.

    Parameters
    ----------
    search : Search
        Data, signatures and the fitted set.
    fit : FittedEffect
        One of the set.
    """
    rows = search.dataset.training
    before, after = (_mean_square(search.residual(fitted), rows) for fitted in ((), search.fitted))
    noise = search.whitener.std**2
    change = _mean_square(search.dataset.predict([fit.effect]) - search.dataset.predict(), rows)
    touched = search.touched(fit.candidate) & (change > 0.0)
    if not touched.any():
        return 1.0
    strongest = int(np.argmax(np.where(touched, change / noise, -1.0)))
    if after[strongest] <= NAMING.plain_rest**2 * noise[strongest]:
        return 1.0
    worth = touched & (before > noise)
    closed = 1.0 - (after - noise)[worth] / (before - noise)[worth]
    return float(np.max(closed, initial=0.0))


def _mean_square(values: FloatArray, rows: BoolArray) -> FloatArray:
    return np.asarray(np.nanmean(values[rows] ** 2, axis=0))


def overtone_nats(view: View, fit: FittedEffect) -> float:
    """Return the log Bayes factor of an effect's overtones beside the set; 0 for effects that have none.

    Parameters
    ----------
    view : View
        The search, seen on discovery and confirmation.
    fit : FittedEffect
        One of the set.
    """
    effects = fit.effect.overtones()
    if not effects:
        return 0.0
    dataset = view.search.dataset
    columns = np.stack([dataset.predict([e]) - dataset.predict() for e in effects], axis=2)
    return smooth_nats(view, view.search.fitted, view.search.touched(fit.candidate), columns)


def name_effect(view: View, fit: FittedEffect) -> tuple[Named, Weighed]:
    """Weigh one effect of a finished search, and say at what level it may be named.

    Parameters
    ----------
    view : View
        The search, seen on discovery and confirmation.
    fit : FittedEffect
        One of the set.
    """
    weighed = weigh(view, fit)
    cost = penalty(view.search.n_kinds)
    alternatives = posterior(fit.candidate, weighed, cost)
    doubts, partial = _doubts(view, fit, weighed, cost), _partial(view, fit, weighed, cost)
    level, more = _level(alternatives, doubts, partial)
    ordered = tuple(sorted(alternatives, key=lambda a: -a.probability))
    nats = weighed.nats / weighed.overdispersion
    return Named(fit, level, alternatives[0].probability, nats, ordered, (*doubts, *more)), weighed


def _doubts(view: View, fit: FittedEffect, weighed: Weighed, cost: float) -> list[str]:
    """Conditions of an exact name that an effect does not meet."""
    found, confirmed = (
        weighed.discovery.sum() / weighed.overdispersion,
        weighed.confirmation.sum() / weighed.overdispersion,
    )
    doubts = []
    if found < cost:
        doubts.append(f"gains only {found:.1f} nats on the discovery part, {cost:.1f} are needed")
    if confirmed < NAMING.confirmed:
        doubts.append(f"not confirmed: {confirmed:.1f} nats on the confirmation part")
    gains = np.concatenate([weighed.discovery, weighed.confirmation])[weighed.active]
    if len(gains) < NAMING.few:
        doubts.append(f"acts in only {len(gains)} of the trajectories")
    elif (fraction := float((gains > 0).mean())) < NAMING.positive_fraction:
        doubts.append(f"helps in only {100 * fraction:.0f} % of the trajectories in which it acts")
    return doubts + _doubts_of_numbers(view, fit)


def _partial(view: View, fit: FittedEffect, weighed: Weighed, cost: float) -> list[str]:
    """Signs that an effect is but a part of something that is not in the catalogue."""
    signs = []
    if (closed := fraction_closed(view.search, fit)) < NAMING.least_closed:
        signs.append(f"{100 * closed:.0f} % of the gap is closed where it shows, and the rest is no noise")
    if (more := overtone_nats(view, fit)) > max(NAMING.most_overtones * weighed.nats, cost * weighed.overdispersion):
        signs.append(
            f"its overtones gain {more / weighed.overdispersion:.0f} nats more: a part of another periodic error"
        )
    return signs


def _doubts_of_numbers(view: View, fit: FittedEffect) -> list[str]:
    search = view.search
    fixed, near = search.parted(search.fitted, fit.candidate)
    fitted = [*fixed, *near]
    index = next(i for i, m in enumerate(fitted) if m is fit)
    doubts = [f"{name} is at the edge of its physical range" for name in fit.at_edge]
    if not away_from_nothing(search, search.whitener, fitted, index):
        doubts.append("its size cannot be distinguished from zero")
    explained = explained_by_others(search, fitted, index)
    if explained > NAMING.explained:
        doubts.append(
            f"{100 * explained:.1f} % of its signature is explained by the others: not nameable from these data"
        )
    return doubts


def _level(alternatives: Sequence[Alternative], doubts: Sequence[str], partial: list[str]) -> tuple[Level, list[str]]:
    if partial:
        return Level.UNKNOWN, partial
    own, others = alternatives[0], alternatives[1:]
    stable = [a for a in others if a.is_effect and a.probability >= NAMING.stable]
    nothing, unknown = others[0].probability, others[1].probability
    if unknown > 0.5:
        return Level.UNKNOWN, ["a smooth model outside the catalogue explains more"]
    if doubts or nothing > NAMING.stable:
        return Level.INCONCLUSIVE, []
    if own.probability >= NAMING.exact:
        return Level.EXACT, []
    if not stable:
        return Level.INCONCLUSIVE, ["the catalogue and a smooth model explain it equally well"]
    words = [f"cannot be distinguished from {a.label} ({100 * a.probability:.0f} %)" for a in stable]
    return (Level.CLASS if all(a.family == own.family for a in stable) else Level.SET), words
