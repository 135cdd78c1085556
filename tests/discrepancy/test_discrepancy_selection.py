"""How a finished search becomes names: swaps, drops, and the search for what a dropped effect had stood in for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gpcorrect.discrepancy.naming import selection
from gpcorrect.discrepancy.naming.numbers import Numbers
from gpcorrect.discrepancy.naming.posterior import Alternative, Explanation, Level, Named
from gpcorrect.discrepancy.naming.selection import name_effects
from gpcorrect.discrepancy.naming.weigh import Own, Rival, Weighed
from gpcorrect.discrepancy.settings import SETTINGS


@dataclass(frozen=True)
class Cause:
    """As much of a candidate as selection looks at."""

    name: str
    extra: int = 0
    joint: int = 1
    coordinates: tuple[Any, ...] = ()

    @property
    def key(self) -> str:
        return self.name

    @property
    def label(self) -> str:
        return self.name

    @property
    def places(self) -> dict[str, list[int]]:
        names = [c.parameter.name for c in self.coordinates] or ["size", "shape"][: self.extra + 1]
        return {name: [i] for i, name in enumerate(names)}

    def called_like(self, other: Cause) -> bool:
        return self.name.split("/")[0] == other.name.split("/")[0]


@dataclass(frozen=True, eq=False)
class Part:
    """As much of a fit."""

    candidate: Cause
    at_edge: tuple[str, ...] = ()
    u: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Found:
    """As much of a search: fitted that show in a channel of their joint, and what there is to find."""

    fitted: tuple[Part, ...]
    n_kinds: int = 10
    traces: tuple[Part, ...] = ()

    def refit(self, fitted: Sequence[Part], candidate: Cause) -> tuple[Part, ...]:
        return tuple(fitted)

    def alike(self, a: Cause, b: Cause) -> bool:
        return a.joint == b.joint


@dataclass
class Laboratory:
    """What each name is worth, and what a search finds anew."""

    levels: dict[str, tuple[Level, float]]
    rivals: dict[str, tuple[str, float]] = field(default_factory=dict)
    chances: tuple[float, float] = (1.0, 0.0)  # of an effect, and of its rival
    unsure: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()
    traces: tuple[Part, ...] = ()
    finds: list[str] = field(default_factory=list)
    refused: list[list[str]] = field(default_factory=list)
    weighed: list[str] = field(default_factory=list)

    def own_gain(self, view: Any, fit: Part) -> Own:
        nothing = np.zeros(0)
        return Own((), (nothing, nothing), np.array([self.levels[fit.candidate.name][1]]), nothing, 1.0)

    def name_effect(self, view: Any, fit: Part, own: Own) -> tuple[Named, Weighed]:
        self.weighed.append(fit.candidate.name)
        level, nats = self.levels[fit.candidate.name]
        rivals = ()
        if fit.candidate.name in self.rivals:
            name, worth = self.rivals[fit.candidate.name]
            rivals = (Rival(Part(Cause(name)), worth, 0.0),)  # type: ignore[arg-type]
        names = [fit.candidate.name, *(r.candidate.name for r in rivals)]
        likely = [Alternative(Explanation.EFFECT, p, n, n) for n, p in zip(names, self.chances, strict=False)]
        weighed = Weighed(own, 0.0, np.ones(1, dtype=np.bool_), rivals, 0.0, 0.0)
        undetermined = ("shape",) if fit.candidate.name in self.undetermined else ()
        named = Named(fit, level, self.chances[0], nats, tuple(likely), (), 0.0, undetermined)  # type: ignore[arg-type]
        return named, weighed

    def estimate_numbers(self, state: Found, start: Sequence[Part]) -> Numbers:
        places = tuple(i for i, fit in enumerate(start) if fit.candidate.name in self.unsure)
        return Numbers(tuple(start), ({},) * len(start), places, np.zeros(0))  # type: ignore[arg-type]

    def search(self, state: Found, *, rounds: int, refused: Sequence[Cause]) -> Found:
        self.refused.append([c.name for c in refused])
        if not self.finds:
            return state
        return replace(state, fitted=(*state.fitted, Part(Cause(self.finds.pop(0)))))


Select = Callable[[Laboratory, Sequence[Part]], tuple[list[str], list[str]]]


@pytest.fixture
def select(monkeypatch: pytest.MonkeyPatch) -> Select:
    """Select a set in a laboratory: names named, and names dropped."""

    def run(laboratory: Laboratory, fitted: Sequence[Part]) -> tuple[list[str], list[str]]:
        monkeypatch.setattr(selection, "view_of", lambda *_: None)
        monkeypatch.setattr(selection, "own_gain", laboratory.own_gain)
        monkeypatch.setattr(selection, "name_effect", laboratory.name_effect)
        monkeypatch.setattr(selection, "search_on", laboratory.search)
        monkeypatch.setattr(selection, "estimate_numbers", laboratory.estimate_numbers)
        search, named, dropped = name_effects(Found(tuple(fitted), traces=laboratory.traces), None)  # type: ignore[arg-type]
        assert [n.fit for n in named] == list(search.fitted)
        return [n.fit.candidate.name for n in named], [n.fit.candidate.name for n in dropped]

    return run


def parts(*names: str) -> list[Part]:
    return [Part(Cause(name)) for name in names]


def test_what_may_be_named_stays_and_the_rest_is_dropped_weakest_first(select: Select) -> None:
    laboratory = Laboratory({"a": (Level.EXACT, 50.0), "b": (Level.INCONCLUSIVE, 9.0), "c": (Level.INCONCLUSIVE, 5.0)})
    assert select(laboratory, parts("a", "b", "c")) == (["a"], ["c", "b"])
    assert laboratory.refused == []


def test_what_stays_is_weighed_again_when_a_name_turns_out_to_be_of_no_size(select: Select) -> None:
    """Five per cent of feed-forward was gravity, EXACT, for it was weighed beside a link's mass that went later."""
    laboratory = Laboratory({"gravity": (Level.EXACT, 50.0), "mass": (Level.EXACT, 60.0)}, unsure=("mass",))
    assert select(laboratory, parts("gravity", "mass")) == (["gravity"], ["mass"])
    assert laboratory.weighed == ["gravity", "mass", "gravity"]


def test_what_was_poor_beside_another_is_weighed_again_before_it_goes(select: Select) -> None:
    """Once the weaker has gone the other may be named, and it is on that evidence that it stays."""

    class Freed(Laboratory):
        def name_effect(self, view: Any, fit: Part, own: Own) -> tuple[Named, Weighed]:
            if fit.candidate.name in self.weighed:
                self.levels[fit.candidate.name] = (Level.EXACT, 9.0)
            return super().name_effect(view, fit, own)

    laboratory = Freed({"a": (Level.INCONCLUSIVE, 8.0), "b": (Level.INCONCLUSIVE, 9.0)})
    assert select(laboratory, parts("a", "b")) == (["b"], ["a"])
    assert laboratory.weighed == ["a", "b", "b"]


def test_what_stands_beside_the_same_effects_again_is_not_weighed_again(select: Select) -> None:
    """A search that added seven effects, of which none stayed, had all others weighed anew."""
    levels: dict[str, tuple[Level, float]] = {
        "a": (Level.EXACT, 50.0),
        "wrong": (Level.INCONCLUSIVE, SETTINGS.naming.hole + 1.0),
        "other": (Level.INCONCLUSIVE, 20.0),
    }
    laboratory = Laboratory(levels, finds=["other"])
    assert select(laboratory, parts("a", "wrong")) == (["a"], ["wrong", "other"])
    assert laboratory.weighed == ["a", "wrong", "a", "other"]


def test_of_two_that_take_each_others_place_the_weaker_goes_alone(select: Select) -> None:
    """Neither may be nothing once the other has gone."""

    class Pair(Laboratory):
        def estimate_numbers(self, state: Found, start: Sequence[Part]) -> Numbers:
            self.unsure = ("a", "b") if len(start) > 1 else ()
            return super().estimate_numbers(state, start)

    assert select(Pair({"a": (Level.EXACT, 50.0), "b": (Level.EXACT, 60.0)}), parts("a", "b")) == (["b"], ["a"])


def test_what_a_strong_dropped_effect_stood_in_for_is_searched_without_it(select: Select) -> None:
    levels: dict[str, tuple[Level, float]] = {
        "a": (Level.EXACT, 50.0),
        "wrong": (Level.INCONCLUSIVE, SETTINGS.naming.hole + 1.0),
        "right": (Level.EXACT, 90.0),
    }
    laboratory = Laboratory(levels, finds=["right"])
    assert select(laboratory, parts("a", "wrong")) == (["a", "right"], ["wrong"])
    assert laboratory.refused == [["wrong"]]


def test_what_the_only_effect_stood_in_for_is_searched_too(select: Select) -> None:
    """The set is empty once it has gone, and that is not the end."""
    levels = {"wrong": (Level.INCONCLUSIVE, SETTINGS.naming.hole + 1.0), "right": (Level.EXACT, 90.0)}
    laboratory = Laboratory(levels, finds=["right"])
    assert select(laboratory, parts("wrong")) == (["right"], ["wrong"])


def test_an_effect_at_the_edge_is_replaced_before_the_next_is_dropped(select: Select) -> None:
    levels: dict[str, tuple[Level, float]] = {
        "a": (Level.EXACT, 50.0),
        "edge": (Level.INCONCLUSIVE, 1.0),
        "weak": (Level.INCONCLUSIVE, 2.0),
        "right": (Level.EXACT, 90.0),
    }
    laboratory = Laboratory(levels, finds=["right"])
    fitted = [*parts("a", "weak"), Part(Cause("edge"), at_edge=("stiffness",))]
    assert select(laboratory, fitted) == (["a", "right"], ["edge", "weak"])
    assert laboratory.refused == [["edge"]]


def test_what_no_data_determine_is_not_looked_for_in_every_variant(select: Select) -> None:
    """Three variants of a creep used up the searches, and the offset that it may as well be was never weighed."""
    levels = {"creep/held": (Level.INCONCLUSIVE, SETTINGS.naming.hole + 1.0), "offset": (Level.SET, 90.0)}
    variants = [Part(Cause(f"creep/{pause}", extra=1)) for pause in ("held", "linear")]
    simple = Part(Cause("creep/simple"))  # without the number that is open
    laboratory = Laboratory(levels, undetermined=("creep/held",), traces=(*variants, simple), finds=["offset"])
    assert select(laboratory, [variants[0]]) == (["offset"], ["creep/held"])
    assert set(laboratory.refused[0]) == {"creep/held", "creep/linear"}


def number(name: str, shaped_by: str = "") -> SimpleNamespace:
    """As much of a coordinate as selection looks at."""
    return SimpleNamespace(parameter=SimpleNamespace(name=name, shaped_by=shaped_by))


class Dragging(Laboratory):
    """A coupling whose drag no data determine: with it there is no name, and without it there is."""

    def name_effect(self, view: Any, fit: Part, own: Own) -> tuple[Named, Weighed]:
        named, weighed = super().name_effect(view, fit, own)
        if "drag" in fit.candidate.places:
            named = replace(named, level=Level.INCONCLUSIVE, undetermined=("radius",))
        return named, weighed


def test_an_effect_loses_what_no_data_determine_beside_its_law_and_not_its_name(select: Select) -> None:
    size = number("coefficient")
    simple = Part(Cause("coupling", coordinates=(size,)))
    full = Part(Cause("coupling", coordinates=(size, number("drag", "radius"), number("radius"))), u=(1.0, 2.0, 3.0))
    laboratory = Dragging({"coupling": (Level.EXACT, 50.0)}, traces=(full, simple))
    assert select(laboratory, [full]) == (["coupling"], [])
    assert laboratory.weighed == ["coupling", "coupling"]


def test_what_a_search_found_and_went_again_is_no_new_hole(select: Select) -> None:
    """On a real wrist two more searches followed, half of the time of the naming, for nothing that stayed."""
    levels = {"a": (Level.EXACT, 50.0)} | dict.fromkeys(("x", "y", "z"), (Level.INCONCLUSIVE, SETTINGS.naming.hole + 5))
    laboratory = Laboratory(levels, finds=["y", "z"])
    assert select(laboratory, parts("a", "x")) == (["a"], ["x", "y"])
    assert laboratory.refused == [["x"]]


def test_a_hole_is_searched_where_it_shows(select: Select) -> None:
    """What shows at other joints alone had not been in the place of what went; each joint's own hole is searched."""
    levels = {"a": (Level.EXACT, 50.0)} | dict.fromkeys(("x", "other"), (Level.INCONCLUSIVE, 9.0))
    traces = [Part(Cause(f"trace {joint}", joint=joint)) for joint in (1, 2)]
    laboratory = Laboratory(levels, traces=tuple(traces))
    edge = [Part(Cause("x", joint=1), at_edge=("radius",)), Part(Cause("other", joint=2), at_edge=("radius",))]
    assert select(laboratory, [*parts("a"), *edge]) == (["a"], ["x", "other"])
    assert laboratory.refused == [["x", "trace 2"], ["x", "other", "trace 1"]]


@pytest.mark.parametrize(("chance", "stays"), [(0.3, "a"), (0.4, "a"), (0.5, "b")])
def test_a_rival_that_explains_as_much_must_be_more_probable(select: Select, chance: float, stays: str) -> None:
    """A tie leaves what is there: it was taken out, came back with another shape, and lost its name."""
    levels: dict[str, tuple[Level, float]] = {"a": (Level.CLASS, 50.0), "b": (Level.CLASS, 50.0)}
    assert select(Laboratory(levels, rivals={"a": ("b", 50.0)}, chances=(0.4, chance)), parts("a")) == ([stays], [])


def test_a_rival_that_explains_more_takes_the_place(select: Select) -> None:
    """Beside the law that says less, what it lacks counted as missing, and left both about as probable."""
    levels: dict[str, tuple[Level, float]] = {"a": (Level.CLASS, 50.0), "b": (Level.EXACT, 80.0)}
    assert select(Laboratory(levels, rivals={"a": ("b", 80.0)}, chances=(0.6, 0.4)), parts("a")) == (["b"], [])


def test_what_explains_more_gives_the_place_back_where_it_turns_out_less_probable(select: Select) -> None:
    """A friction with four numbers stayed, at a probability of .001."""

    class Fuller(Laboratory):
        def name_effect(self, view: Any, fit: Part, own: Own) -> tuple[Named, Weighed]:
            self.chances = (0.001, 0.999) if fit.candidate.name == "full" else (0.7, 0.3)
            return super().name_effect(view, fit, own)

    levels: dict[str, tuple[Level, float]] = {"simple": (Level.CLASS, 50.0), "full": (Level.CLASS, 80.0)}
    rivals = {"simple": ("full", 80.0), "full": ("simple", 50.0)}
    assert select(Fuller(levels, rivals=rivals), parts("simple")) == (["simple"], [])


@pytest.mark.parametrize(("nats", "stays"), [(49.0, "a"), (50.0, "a"), (51.0, "a/joint")])
def test_a_variant_that_is_called_the_same_takes_the_place_if_it_explains_more(
    select: Select, nats: float, stays: str
) -> None:
    levels: dict[str, tuple[Level, float]] = {"a": (Level.CLASS, 50.0), "a/joint": (Level.CLASS, nats)}
    assert select(Laboratory(levels, rivals={"a": ("a/joint", nats)}), parts("a")) == ([stays], [])


def test_what_was_dropped_does_not_come_back_as_a_rival(select: Select) -> None:
    levels: dict[str, tuple[Level, float]] = {
        "a": (Level.EXACT, 50.0),
        "wrong": (Level.INCONCLUSIVE, SETTINGS.naming.hole + 1.0),
        "right": (Level.EXACT, 90.0),
    }
    laboratory = Laboratory(levels, finds=["right"], rivals={"right": ("wrong", 999.0)}, chances=(0.4, 0.6))
    assert select(laboratory, parts("a", "wrong")) == (["a", "right"], ["wrong"])


@pytest.mark.parametrize(
    ("beside", "named", "dropped"), [(Level.EXACT, ["first"], []), (Level.INCONCLUSIVE, [], ["first"])]
)
def test_what_was_dropped_comes_back_once_where_what_follows_is_outdone_by_it(
    select: Select, beside: Level, named: list[str], dropped: list[str]
) -> None:
    """A name of probability .001 stood beside one of .999 that had been taken out beside other effects."""

    class Later(Laboratory):
        def name_effect(self, view: Any, fit: Part, own: Own) -> tuple[Named, Weighed]:
            self.chances = (0.001, 0.999) if fit.candidate.name == "second" else (1.0, 0.0)
            found = super().name_effect(view, fit, own)
            self.levels["first"] = (beside, 90.0)  # once what it was weighed beside has gone
            return found

    levels = {"first": (Level.INCONCLUSIVE, SETTINGS.naming.hole + 1.0), "second": (Level.CLASS, 90.0)}
    laboratory = Later(levels, finds=["second"], rivals={"second": ("first", 80.0)})
    assert select(laboratory, parts("first")) == (named, dropped)


def test_two_rivals_that_praise_each_other_do_not_swap_for_ever(select: Select) -> None:
    levels: dict[str, tuple[Level, float]] = {"a": (Level.CLASS, 50.0), "b": (Level.CLASS, 50.0)}
    rivals = {"a": ("b", 50.0), "b": ("a", 50.0)}
    assert select(Laboratory(levels, rivals=rivals, chances=(0.4, 0.6)), parts("a")) == (["b"], [])
    # of two that each leave themselves no chance neither is named
    assert select(Laboratory(levels, rivals=rivals, chances=(0.01, 0.99)), parts("a")) == ([], ["b"])


class Settling(Laboratory):
    """What leads `a` at first no longer does once the others' numbers have settled."""

    def name_effect(self, view: Any, fit: Part, own: Own) -> tuple[Named, Weighed]:
        named = super().name_effect(view, fit, own)
        if fit.candidate.name == "a":
            self.rivals.pop("a", None)
        return named


def test_what_was_replaced_before_the_others_settled_may_come_back(select: Select) -> None:
    """It was kept out for good, and its place stayed with a name of no probability."""
    levels = {"a": (Level.EXACT, 50.0), "b": (Level.CLASS, 50.0)}
    rivals = {"a": ("b", 60.0), "b": ("a", 80.0)}
    assert select(Settling(levels, rivals=rivals, chances=(0.4, 0.6)), parts("a")) == (["a"], [])


def test_what_gains_less_than_it_costs_goes_before_rivals_are_weighed(select: Select) -> None:
    laboratory = Laboratory(
        {"a": (Level.EXACT, 50.0), "idle": (Level.INCONCLUSIVE, 0.5)}, rivals={"idle": ("b", 0.9), "a": ("idle", 99.0)}
    )
    assert select(laboratory, parts("a", "idle")) == (["a"], ["idle"])
    assert laboratory.weighed == ["idle", "a"]


def test_nothing_to_name_is_nothing(select: Select) -> None:
    assert select(Laboratory({}), []) == ([], [])
