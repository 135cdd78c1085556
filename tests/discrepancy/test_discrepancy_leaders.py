"""Which candidates are refined: one of each signature, and in the order of what they explain where they lead to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gpcorrect.discrepancy.search import stepwise
from gpcorrect.discrepancy.search.stepwise import Ranked, _one_of_each_signature, _ranked_there
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

BLOCKS, ROWS = 8, 25
RNG = np.random.default_rng(3)
SHAPE, OTHER, NOISE = RNG.standard_normal((3, BLOCKS * ROWS))
MISSING = 2.0 * SHAPE


@dataclass(frozen=True, eq=False)
class Law:
    """As much of a candidate: what it changes where its line leads to."""

    name: str
    change: FloatArray | None = None  # None is no machine
    extra: int = 0
    joint: int = 1
    channel: int = 0  # the only one in which it shows

    @property
    def label(self) -> str:
        return self.name

    def called_like(self, other: Law) -> bool:
        return self.name.split("/")[0] == other.name.split("/")[0]

    def scaled(self, factors: FloatArray) -> FloatArray:
        return factors


def residual(fitted: Sequence[Any]) -> FloatArray:
    left: FloatArray = MISSING + 0.3 * NOISE
    for fit in fitted:
        if fit.candidate.change is None:
            raise DataError("no machine")
        left = left - fit.candidate.change
    return left[:, None]


def names(laws: Sequence[tuple[Law, float]]) -> list[str]:
    """Rank laws again that have these nats by their lines."""
    whitener = SimpleNamespace(
        block=np.repeat(np.arange(BLOCKS), ROWS),
        channel=np.zeros(BLOCKS * ROWS, dtype=int),
        whiten_columns=lambda columns, shown: columns[:, 0, :],
    )
    state = SimpleNamespace(whitener=whitener, residual=residual)
    beyond = SimpleNamespace(fitted=(), z=residual(())[:, 0], slopes=np.zeros((BLOCKS * ROWS, 0)))
    leaders = [Ranked(law, nats, np.ones(1)) for law, nats in laws]  # type: ignore[arg-type]
    return [r.candidate.name for r in _ranked_there(state, beyond, leaders)]  # type: ignore[arg-type]


PART, SIMILAR = MISSING + 1.5 * OTHER, MISSING + 3.0 * OTHER


def test_what_is_far_better_than_its_line_comes_first() -> None:
    """A capstan's friction was fourth by its line, was never refined, and had 240 nats more than what was."""
    laws = [(Law("first", PART), 90.0), (Law("second", SIMILAR), 80.0), (Law("curved", 0.5 * MISSING), 30.0)]
    assert len(laws) > SEARCH.refined
    assert names(laws) == ["curved", "first", "second"]


def test_numbers_are_charged_for_and_what_is_no_machine_is_none() -> None:
    laws = [(Law("none", None), 99.0), (Law("full", MISSING, extra=2), 90.0), (Law("simple", MISSING), 80.0)]
    assert names(laws) == ["simple", "full"]


def test_what_is_no_machine_is_not_refined_be_it_the_only_one() -> None:
    assert names([(Law("none", None), 99.0)]) == []


def test_one_signature_of_two_variants_leaves_room_for_another() -> None:
    """Both that were refined were one friction, on either side of a rigid transmission; a soft one is another."""
    laws = [Law("coulomb/motor", PART), Law("coulomb/joint", PART), Law("coulomb/soft", PART), Law("capstan", MISSING)]
    ranked = [Ranked(law, nats, np.ones(1)) for law, nats in zip(laws, (3.0, 3.0, 2.0, 1.0), strict=True)]  # type: ignore[arg-type]
    left = [r.candidate.name for r in _one_of_each_signature(ranked)]
    assert left == ["coulomb/motor", "coulomb/soft", "capstan"]


@dataclass(frozen=True)
class Refined:
    """As much of a fit and of a search as it takes to choose one of two refined leaders."""

    candidate: Law
    at_edge: bool = False


@dataclass(frozen=True)
class State:
    fitted: tuple[Refined, ...] = ()
    waterfall: tuple[Any, ...] = ()
    whitener: None = None

    def alike(self, one: Law, other: Law) -> bool:
        return one.channel == other.channel

    def misfit(self, fitted: Sequence[Refined]) -> float:
        return 0.0

    def refit_with(self, others: Sequence[Any], new: Any, worth: float) -> tuple[Refined, ...] | None:
        return None if new.candidate.name == "none" else (Refined(new.candidate),)

    def refreshed(self) -> State:
        return self


@pytest.mark.parametrize(("more", "chosen"), [(1.9, "dry"), (2.1, "stribeck")])
def test_further_numbers_of_a_leader_are_charged_for(monkeypatch: pytest.MonkeyPatch, more: float, chosen: str) -> None:
    """Of two frictions that explain as much, the one with a fall-off of no size was chosen, and its rivals weighed."""
    simple, fuller = Law("dry"), Law("stribeck", extra=2)
    gains = {"dry": 100.0, "stribeck": 100.0 + more * SEARCH.complexity}
    leaders = [Ranked(law, gains[law.name], np.ones(1)) for law in (fuller, simple)]  # type: ignore[arg-type]
    monkeypatch.setattr(stepwise, "linearise", lambda *_: None)
    monkeypatch.setattr(stepwise, "_ranked_there", lambda state, linearised, leaders: leaders)
    monkeypatch.setattr(stepwise, "rank", lambda *_, beyond=None: [] if beyond else leaders)
    monkeypatch.setattr(stepwise, "_gain_over", lambda state, before, fitted, new: gains[fitted[-1].candidate.name])
    grown = stepwise._forward(State(), 9.5, [], [])  # type: ignore[arg-type]
    assert [m.candidate.name for m in grown.fitted] == [chosen]


def test_a_fuller_leader_that_is_no_machine_leaves_the_one_that_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looked at after the best is known, without a simulation at its first estimate, it ended the whole run."""
    simple, fuller = (Ranked(Law(name), 100.0, np.ones(1)) for name in ("dry", "none"))  # type: ignore[arg-type]
    monkeypatch.setattr(stepwise, "linearise", lambda *_: None)
    monkeypatch.setattr(stepwise, "_ranked_there", lambda state, linearised, leaders: leaders)
    monkeypatch.setattr(stepwise, "rank", lambda *_, beyond=None: [fuller] if beyond else [simple])
    monkeypatch.setattr(stepwise, "_gain_over", lambda *_: 100.0)
    grown = stepwise._forward(State(), 9.5, [], [])  # type: ignore[arg-type]
    assert [m.candidate.name for m in grown.fitted] == ["dry"]


def added_of(monkeypatch: pytest.MonkeyPatch, laws: Sequence[tuple[Law, float, float]]) -> list[str]:
    """Names that one round adds of laws with the nats that each promises and, if none of its channel came, gains."""
    gains = {law.name: gain for law, _, gain in laws}

    def ranked(state: State, *_: Any, beyond: Sequence[Law] | None = None) -> list[Ranked]:
        left = [(law, nats) for law, nats, _ in laws if law.name not in {s.label for s in state.waterfall}]
        return [] if beyond else [Ranked(law, nats, np.ones(1)) for law, nats in left]  # type: ignore[arg-type]

    def gain(state: State, before: Any, fitted: Sequence[Refined], new: Any) -> float:
        return gains[fitted[-1].candidate.name]

    monkeypatch.setattr(stepwise, "linearise", lambda *_: None)
    monkeypatch.setattr(stepwise, "_ranked_there", lambda state, linearised, leaders: leaders)
    monkeypatch.setattr(stepwise, "rank", ranked)
    monkeypatch.setattr(stepwise, "_gain_over", gain)
    state, added = State(), list[Any]()
    while (grown := stepwise._forward(state, 9.5, added, [])) is not state:  # type: ignore[arg-type, comparison-overlap]
        state = grown  # type: ignore[assignment]
    return [law.name for law in added]


def test_a_leader_that_comes_to_nothing_ends_no_search_of_other_channels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside an arm that fell for want of torque a payload promised most and paid nothing; a play went unnamed."""
    payload, link = Law("payload", joint=0, channel=1), Law("link", joint=4, channel=1)
    play = Law("play", joint=3, channel=2)
    promises = [(payload, 8300.0, 0.0), (link, 7700.0, 0.0), (play, 7000.0, 7000.0)]
    assert added_of(monkeypatch, promises) == ["play"]


def test_two_of_one_joint_are_added_in_one_round_if_they_show_in_no_common_channel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What the motor does and what is lost behind it cannot stand in for each other; two of one channel can."""
    friction, dry = Law("friction", channel=1), Law("dry", channel=1)
    play, creep = Law("play", channel=2), Law("creep", channel=2)
    promises = [(friction, 90.0, 90.0), (play, 80.0, 80.0), (dry, 50.0, 50.0), (creep, 40.0, 40.0)]
    assert added_of(monkeypatch, promises) == ["friction", "play"]
