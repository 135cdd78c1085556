"""A finished search, kept as numbers, so that a killed run need not search again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from gpcorrect.discrepancy.outcome.store import StageStore
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.state import Search, Step

__all__ = ["searched"]

STAGE = "search"


def searched(
    state: Search, candidates: Sequence[Candidate], store: StageStore | None, run: Callable[[Search], Search]
) -> Search:
    """Return the state after `run`, from the store where it was run before with the same inputs.

    Parameters
    ----------
    state : Search
        Where the search starts.
    candidates : sequence of Candidate
        All of them, always in the same order.
    store : StageStore or None
        None keeps nothing.
    run : callable
        The search.
    """
    kept = None if store is None else store.load(STAGE)
    if kept is not None:
        return _restored(state, candidates, kept)
    done = run(state)
    if store is not None:
        store.save(STAGE, _plain(done, candidates))
    return done


def _plain(state: Search, candidates: Sequence[Candidate]) -> dict[str, Any]:
    place = {id(c): i for i, c in enumerate(candidates)}
    return {
        "members": [{"candidate": place[id(m.candidate)], "u": np.asarray(m.u).tolist()} for m in state.members],
        "waterfall": [asdict(step) for step in state.waterfall],
    }


def _restored(state: Search, candidates: Sequence[Candidate], kept: dict[str, Any]) -> Search:
    members = tuple(Member(candidates[m["candidate"]], np.array(m["u"])) for m in kept["members"])
    steps = tuple(Step(s["label"], s["nats"]) for s in kept["waterfall"])
    return replace(state, members=members, waterfall=steps).refreshed()
