"""The effects' numbers, estimated together on all rows but the test set's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.discrepancy.evidence.whitener import whitener_on
from gpcorrect.discrepancy.naming.intervals import away_from_nothing, interval_ends, without_idle_numbers
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.instants import with_open_instant_placed
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.types import FloatArray

EVALUATIONS = 30  # of the final refit
BESIDE = (0.8, 1.25)  # half a cycle in two, for which a joint of a tenth of critical damping rings


@dataclass(frozen=True, eq=False)
class Numbers:
    """Estimates of a set's numbers with what the data say of them."""

    fitted: tuple[FittedEffect, ...]  # the set, idle numbers at nothing
    ends: tuple[Mapping[int, tuple[float, float]], ...]  # 95 % interval of each coordinate of each effect
    unsure: tuple[int, ...]  # places in the set of those whose size may be nothing
    std: FloatArray  # (c,) of the noise that the set leaves in each channel


def estimate_numbers(state: Search, start: Sequence[FittedEffect]) -> Numbers:
    """Estimate all numbers of a set anew, together where effects show in common channels.

    Parameters
    ----------
    state : Search
    start : sequence of FittedEffect, the set, from where its numbers are now
    """
    fitted = _refit(state, start)
    whitener = whitener_on(state.dataset, state.residual(fitted), state.dataset.training)
    state = replace(state, whitener=whitener, fitted=fitted)
    ends = tuple(interval_ends(state, fit) for fit in fitted)
    unsure = tuple(i for i, fit in enumerate(fitted) if _may_be_nothing(state, fit, ends[i]))
    return Numbers(without_idle_numbers(state), ends, unsure, whitener.std)


def _refit(state: Search, fitted: Sequence[FittedEffect]) -> tuple[FittedEffect, ...]:
    """Return a set at its best numbers, each group that shows in common channels by itself."""
    if not fitted:
        return ()
    rows, residual, done = state.dataset.training, state.residual(fitted), list(fitted)
    state = replace(state, whitener=whitener_on(state.dataset, residual, rows))
    for group in _groups(state, fitted):
        fixed = [f for i, f in enumerate(done) if i not in group]
        shown = state.shown(done[i].candidate for i in group)
        starts = _starts([done[i] for i in group])
        found = [refine(state.whitener, fixed, start, EVALUATIONS, channels=shown) for start in starts]
        left = [state.misfit([*fixed, *fits]) for fits in found]
        for i, fit in zip(group, found[int(np.argmin(left))], strict=True):
            done[i] = fit.canonical()
    for i, fit in enumerate(done):
        if fit.candidate.instant is not None:  # that these rows leave open: where the others show it
            others = [f for f in done if f is not fit]
            unseen = whitener_on(state.dataset, residual, state.dataset.test)
            done[i], _ = with_open_instant_placed(unseen, others, fit, rows)
    return tuple(done)


def _starts(group: Sequence[FittedEffect]) -> list[list[FittedEffect]]:
    """Return a group as it is, and with each number whose misfit has several minima moved to either side."""
    starts = [list(group)]
    for i, fit in enumerate(group):
        for k, coordinate in enumerate(fit.candidate.coordinates):
            for factor in BESIDE if coordinate.parameter.valleys else ():
                moved = fit.moved(k, coordinate.coordinate(factor * coordinate.value(float(fit.u[k]))))
                starts.append([*group[:i], moved, *group[i + 1 :]])
    return starts


def _groups(state: Search, fitted: Sequence[FittedEffect]) -> list[list[int]]:
    """Return indices of effects that are linked by common channels."""
    groups: list[list[int]] = []
    for i, fit in enumerate(fitted):
        linked = [g for g in groups if any(state.alike(fitted[k].candidate, fit.candidate) for k in g)]
        groups = [g for g in groups if g not in linked] + [[k for g in linked for k in g] + [i]]
    return groups


def _may_be_nothing(state: Search, fit: FittedEffect, ends: Mapping[int, tuple[float, float]]) -> bool:
    """Whether every size's interval holds that of none; of homings only the difference may be known: all together."""
    sizes, coordinates = fit.candidate.sizes, fit.candidate.coordinates
    if not all(ends[k][0] <= coordinates[k].identity <= ends[k][1] for k in sizes):
        return False
    of_sessions = len(sizes) > 1 and len({coordinates[k].parameter.name for k in sizes}) == 1
    return not (of_sessions and away_from_nothing(state, fit))
