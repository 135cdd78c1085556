"""Effects that act in one motion of many, such as a limit that is reached once.

No motion can foretell another's there, so that evidence from motion to motion has nothing to say. But what happens
lasts for many samples, and a law with few numbers that is fitted to some of them has to foretell the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpcorrect.discrepancy.evidence.bursts import Burst, bursts_of
from gpcorrect.discrepancy.naming.posterior import Named
from gpcorrect.discrepancy.naming.selection import name_effects
from gpcorrect.discrepancy.search.candidates import Candidate
from gpcorrect.discrepancy.search.prepared import PreparedData, in_pieces
from gpcorrect.discrepancy.search.state import Search, Trace, start_search
from gpcorrect.discrepancy.search.stepwise import search
from gpcorrect.discrepancy.settings import BURSTS, NAMING
from gpcorrect.types import BoolArray, Progress


def name_rare(
    prepared: PreparedData,
    state: Search,
    named: Sequence[Named],
    candidates: Sequence[Candidate],
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[PreparedData, Search, tuple[Named, ...]] | None:
    """Look, beside what is named, for effects that act where something rare happens and hardly anywhere else.

    Parameters
    ----------
    prepared : PreparedData
        By whole trajectories.
    state : Search
        After the naming.
    named : sequence of Named
        What was named, in the order of the state's effects.
    candidates : sequence of Candidate
        All that these data could show.
    rng : numpy.random.Generator
        Deals the pieces.
    progress : Progress

    Returns
    -------
    tuple or None
        The recording in pieces, the state with the new effects, and all that is named; None when nothing rare gets a
        name.
    """
    found = bursts_of(prepared.dataset, state.whitener.noises, [f.effect for f in state.fitted])
    bursts = [b for b in found if b.rare]
    if not bursts:
        return None
    cut = in_pieces(prepared, bursts, rng)
    start = start_search(cut.dataset, candidates, progress)
    seldom = tuple(t for t in start.traces if _only_there(t, cut, bursts))
    start = replace(start, traces=seldom, fitted=state.fitted).refreshed()
    done = search(start, rounds=NAMING.search_rounds, progress=progress)
    if len(done.fitted) == len(start.fitted):
        return None
    done, names, _ = name_effects(done, cut.tests, cut.inputs, progress=progress)
    known = {n.fit.candidate.key for n in named}
    new = tuple(n for n in names if n.fit.candidate.key not in known)
    if not new:
        return None
    return cut, replace(done, fitted=(*state.fitted, *(n.fit for n in new))), (*named, *new)


def _only_there(trace: Trace, cut: PreparedData, bursts: Sequence[Burst]) -> bool:
    """Whether a candidate changes a channel with a burst, and hardly anything in other trajectories."""
    dataset, change = cut.dataset, np.square(trace.change).sum(axis=2)
    shown: BoolArray = np.array([c in {b.channel for b in bursts} for c in dataset.scene.channels]) & trace.touched
    rows = np.isin(dataset.trajectory, [t for b in bursts for t in b.trajectories])
    energy = change[:, trace.touched].sum(axis=1)
    return bool(shown.any() and energy[rows].sum() > BURSTS.there * energy.sum())
