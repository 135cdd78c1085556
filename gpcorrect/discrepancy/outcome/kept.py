"""A finished search and its names, kept as numbers, so that a killed run need not look for them again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from gpcorrect.discrepancy.naming.named import Alternative, Named
from gpcorrect.discrepancy.outcome.store import StageStore
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.state import Search, Step

__all__ = ["named", "searched"]

STAGE, NAMES = "search", "naming"
Names = tuple[Search, tuple[Named, ...], tuple[Named, ...]]  # with the named members only, those, and the others


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


def named(
    state: Search, candidates: Sequence[Candidate], store: StageStore | None, run: Callable[[Search], Names]
) -> Names:
    """Return what `run` makes of a finished search, from the store where it was run before with the same inputs.

    Parameters
    ----------
    state, candidates, store
        As for :func:`searched`.
    run : callable
        The naming.
    """
    known = None if store is None else store.load(NAMES)
    if known is not None:
        kept, dropped = (tuple(_name_of(n, candidates) for n in known[part]) for part in ("kept", "dropped"))
        return replace(state, members=tuple(n.member for n in kept)), kept, dropped
    state, kept, dropped = run(state)
    if store is not None:
        parts = {"kept": kept, "dropped": dropped}
        store.save(NAMES, {part: [_plain_name(n, candidates) for n in names] for part, names in parts.items()})
    return state, kept, dropped


def _plain_name(name: Named, candidates: Sequence[Candidate]) -> dict[str, Any]:
    return {
        "member": _plain_members([name.member], candidates)[0],
        "level": name.level,
        "probability": name.probability,
        "nats": name.nats,
        "alternatives": [asdict(a) for a in name.alternatives],
        "reasons": list(name.reasons),
    }


def _name_of(kept: dict[str, Any], candidates: Sequence[Candidate]) -> Named:
    return Named(
        _member(kept["member"], candidates),
        kept["level"],
        kept["probability"],
        kept["nats"],
        tuple(Alternative(**a) for a in kept["alternatives"]),
        tuple(kept["reasons"]),
    )


def _plain_members(members: Sequence[Member], candidates: Sequence[Candidate]) -> list[dict[str, Any]]:
    place = {id(c): i for i, c in enumerate(candidates)}
    return [{"candidate": place[id(m.candidate)], "u": np.asarray(m.u).tolist()} for m in members]


def _member(kept: dict[str, Any], candidates: Sequence[Candidate]) -> Member:
    return Member(candidates[kept["candidate"]], np.array(kept["u"]))


def _plain(state: Search, candidates: Sequence[Candidate]) -> dict[str, Any]:
    return {
        "members": _plain_members(state.members, candidates),
        "waterfall": [asdict(step) for step in state.waterfall],
    }


def _restored(state: Search, candidates: Sequence[Candidate], kept: dict[str, Any]) -> Search:
    members = tuple(_member(m, candidates) for m in kept["members"])
    steps = tuple(Step(s["label"], s["nats"]) for s in kept["waterfall"])
    return replace(state, members=members, waterfall=steps).refreshed()
