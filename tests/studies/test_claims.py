"""Claims of papers: the rule that compares, and that the tables of the three studies fit the figures of their runs."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpcorrect_studies.claims import Better, Claim, ClaimTable, Verdict, number_at
from gpcorrect_studies.mahler2014 import ablations as mahler2014
from gpcorrect_studies.peng2024 import ablations as peng2024

STUDIES = ("mahler2014", "peng2020", "peng2024")
FIGURES = {"a": {"x": 3.0, "y": 4.0, "list": [1.0, {"n": 2.0}]}, "fig, with": {"n": 7.0}}
LESS = Claim("", "", "a", better=Better.LOWER)
MORE = Claim("", "", "a", better=Better.HIGHER)
RATIO = Claim("", "", "a", "b")


@pytest.mark.parametrize(
    ("place", "found"),
    [("a/x", 3.0), ("a/list/1/n", 2.0), ("a/list/-2", 1.0), ("a/x,y", 5.0), ("fig, with/n", 7.0)],
)
def test_a_number_is_found_by_its_place(place: str, found: float) -> None:
    """Keys and places in lists lead to a number; several keys at once to the norm of their numbers."""
    assert number_at(FIGURES, place) == found


@pytest.mark.parametrize("place", ["b", "a/z", "a/x,z", "a/list/2", "a/list/1/m"])
def test_what_was_not_measured_is_none(place: str) -> None:
    """A key or a place that is not there gives no number."""
    assert number_at(FIGURES, place) is None


@pytest.mark.parametrize(
    ("claim", "printed", "ours", "verdict"),
    [
        (LESS, 10.0, 7.9, Verdict.BEYOND),
        (LESS, 10.0, 11.9, Verdict.REPRODUCED),
        (LESS, 10.0, 12.1, Verdict.NOT_REPRODUCED),
        (MORE, 10.0, 12.1, Verdict.BEYOND),
        (MORE, 10.0, 8.1, Verdict.REPRODUCED),
        (MORE, 10.0, 7.9, Verdict.NOT_REPRODUCED),
        (MORE, 10.0, -0.1, Verdict.REVERSED),
        (RATIO, 0.9, 0.89, Verdict.REPRODUCED),
        (RATIO, 0.9, 0.93, Verdict.NOT_REPRODUCED),  # 7 % less is not within a fifth of 10 % less
        (RATIO, 0.9, 1.01, Verdict.REVERSED),
        (RATIO, 1.3, 0.9, Verdict.REVERSED),
        (RATIO, 0.1, 0.13, Verdict.NOT_REPRODUCED),
        (LESS, 10.0, None, Verdict.NOT_MEASURED),
        (Claim("", "", "a", better=Better.AT_MOST), 10.0, 10.0, Verdict.REPRODUCED),
        (Claim("", "", "a", better=Better.AT_MOST), 10.0, 10.1, Verdict.NOT_REPRODUCED),
        (Claim("", "", "a", better=Better.SAME), 10.0, 7.9, Verdict.NOT_REPRODUCED),
        (Claim("", "", "a", "b", better=Better.SAME), 1.0, 1.1, Verdict.REPRODUCED),
    ],
)
def test_verdicts(claim: Claim, printed: float, ours: float | None, verdict: Verdict) -> None:
    """Better by more than a fifth is beyond; the other order, or a gain that became a loss, is reversed."""
    assert claim.verdict(printed, ours, 0.2) is verdict


@given(printed=st.floats(0.01, 100.0), ours=st.floats(0.01, 100.0), tolerance=st.floats(0.0, 0.5))
def test_ratios_do_not_hang_on_their_unit(printed: float, ours: float, tolerance: float) -> None:
    """A claim is reversed exactly where the two numbers lie on different sides of 1."""
    reversed_ = RATIO.verdict(printed, ours, tolerance) is Verdict.REVERSED
    assert reversed_ == ((printed - 1.0) * (ours - 1.0) < 0.0)


@pytest.mark.parametrize("study", STUDIES)
def test_the_printed_numbers_reproduce_themselves(study: str) -> None:
    """With the paper's own numbers for ours, every claim that is measured is reproduced; every claim has a number."""
    table = ClaimTable.of_study(study)
    for claim in table.claims:
        printed = table.printed_number(claim)
        assert claim.says
        assert claim.where
        assert claim.verdict(printed, printed) is Verdict.REPRODUCED
    own = table.compare(table.printed)
    assert own.counts()[Verdict.NOT_REPRODUCED] == own.counts()[Verdict.REVERSED] == own.counts()[Verdict.BEYOND] == 0
    assert len({(claim.says, claim.where) for claim in table.claims}) == len(table.claims)


def test_no_reason_is_invented() -> None:
    """What was not reproduced has no known reason; what is not measured says why."""
    claims = [Claim("one", "", "x", printed=1.0), Claim("two", "", "x", printed=1.0, missing="no robot")]
    one, two = ClaimTable(claims, {}, {}, "").compare({"x": 2.0}).rows
    assert (one.verdict, one.reason) == (Verdict.NOT_REPRODUCED, "reason not known")
    assert (two.verdict, two.reason) == (Verdict.NOT_MEASURED, "no robot")


@pytest.mark.parametrize(
    ("ours", "without", "found", "reason"),
    [
        (1.4, 0.5, True, "comes back without play (0.5)"),
        (1.4, 0.8, True, "its order comes back without play (0.8)"),
        (1.4, 0.99, False, "reason not known; stays so without play (0.99)"),  # hardly an order
        (1.4, 1.2, False, "reason not known; stays so without play (1.2)"),
        (0.8, 0.7, False, "reason not known; stays so without play (0.7)"),
        (0.5, 1.2, False, ""),
        (1.4, None, False, "no ablation in a run of this size"),
    ],
)
def test_a_reason_is_what_brings_the_claim_back(ours: float, without: float | None, found: bool, reason: str) -> None:
    """The number without the supposed cause is judged as the claim's own; what is reproduced needs no reason."""
    claim = Claim("", "", "a", "b", printed=0.5, tried=("play",))
    table = ClaimTable([claim], {}, {}, "", {"play": "without play"})
    ablations = {} if without is None else {"play": {"a": without, "b": 1.0}}
    row = table.compare({"a": ours, "b": 1.0, "ablations": ablations}).rows[0]
    assert (row.found, row.reason) == (found, reason)


@pytest.mark.parametrize(("study", "done"), [("mahler2014", mahler2014.ABLATIONS), ("peng2024", peng2024.ABLATIONS)])
def test_every_ablation_runs_and_is_tried(study: str, done: Iterable[str]) -> None:
    """The ablations that a table names are those that the study can do, and each is tried for some claim."""
    table = ClaimTable.of_study(study)
    assert {name for claim in table.claims for name in claim.tried} == set(table.ablations) == set(done)
