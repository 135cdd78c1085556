"""The sentence that comes first, and the page behind it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from discrepancy_support import estimate, finding, named, outside, result, rival, verdict_sentence

from gpcorrect.discrepancy.evidence.bursts import Burst
from gpcorrect.discrepancy.evidence.variables import Quantity, Span, Variable
from gpcorrect.discrepancy.outcome.result import Experiment
from gpcorrect.discrepancy.outcome.sentences import next_step, verdict_sentences
from gpcorrect.discrepancy.outcome.verdict import place_verdicts
from gpcorrect.discrepancy.outcome.words import estimate_words, in_reader_units, number, region_words
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.search.candidates import Estimate
from gpcorrect.report import write_discrepancy_report


def test_an_exact_verdict_names_effect_number_and_gap() -> None:
    """One exact effect is given with place, number, interval and the fraction of the gap of its own joint."""
    said = verdict_sentence(result("EXACT", named("backlash", 2)))
    assert said == "Joint 2: backlash, 0.573° (0.516 to 0.630), closes 99 % of the gap."


def test_the_gap_that_is_spoken_of_is_one_that_closes() -> None:
    """A friction shows in the motor; what is left in the outside encoder of the same joint is another's."""
    said = result("EXACT", named("coulomb_friction", 2))
    motor = replace(said.gap[1], channel=Channel("measured_jp_2", "measured_jp", 1, 2, "rad"))
    outside_left = replace(said.gap[1], after=0.02, closed=0.0)
    assert "closes 99 % of the gap" in verdict_sentence(replace(said, gap=(said.gap[0], motor, outside_left)))


def test_a_set_names_its_rivals_with_their_probabilities() -> None:
    """What cannot be distinguished is named together."""
    other = rival("coulomb_friction", 2, 0.35)
    said = verdict_sentence(result("SET", named("backlash", 2, "SET", probability=0.6, rivals=(other,))))
    assert "backlash (60 %) or coulomb friction (35 %)" in said


def test_several_effects_of_a_place_are_named_in_short() -> None:
    """Rivals without percentages, the most probable first; numbers of long units stay in the table."""
    other = rival("backlash", 2, 0.7)
    play = named("hysteresis", 2, "CLASS", probability=0.3, rivals=(other,))
    size = estimate(-0.2, (-0.3, -0.1), "rad per unit of source")
    coupling = named("cable_coupling", 2, parameters={"coefficient": size, "source": Estimate(1, None, "")})
    said = verdict_sentence(result("CLASS", play, coupling))
    assert said == "Joint 2: backlash or hysteresis + cable coupling from joint 1, close 99 % of the gap."


def test_the_first_sentence_is_of_what_matters_most() -> None:
    """Of what is unknown while anything is, else of the place with the largest gap; the others follow in another."""
    effects = [named("backlash", joint) for joint in (1, 2)]
    first, rest = verdict_sentences(result("EXACT", *effects))
    assert first.startswith("Joint 2: ")
    assert rest.startswith("Joint 1: ")
    unknown, beside = verdict_sentences(result("UNKNOWN", *effects))
    assert unknown.startswith("Something outside the catalogue is missing")
    assert beside.startswith("Beside it, joint 2: ")
    assert "; joint 1: " in beside


def test_what_happens_rarely_is_told_beside_a_name() -> None:
    """A name explains all the time, not the moments far above the noise that are left."""
    burst = Burst(outside(1), (4, 9), 0.02, 0.001, 3, rare=True)
    first, rest = verdict_sentences(result("EXACT", named("backlash", 2), bursts=(burst,)))
    assert first.startswith("Joint 2: backlash")
    assert rest.startswith("Moments far above the noise stay unexplained: outside sensor of joint 1 (up to 1.15 ° in ")


def test_noise_closes_no_gap() -> None:
    """An effect on noise alone is given with its size, and that there is no gap to close."""
    size = estimate(1e-3, (9e-4, 1.1e-3), "rad")
    said = verdict_sentence(result("EXACT", named("noise_change", 2, parameters={"std": size}, family="noise")))
    assert said == "Joint 2: noise change, 0.0573° (0.0516 to 0.0630), noise: no gap to close."


def test_regions_are_in_degrees_and_millimetres() -> None:
    """Cells have the unit of their variable; directions and sessions in words."""
    spans = [
        Span(Variable(Quantity.POSITION, 2, "rad"), 0.1, 0.2),
        Span(Variable(Quantity.DIRECTION, 3), -1.0, -1.0),
        Span(Variable(Quantity.LOAD, 1, "N m"), 1.0, 2.0),
    ]
    words = "position of joint 2 from 5.73 to 11.5°, joint 3 moving back, load of joint 1 from 1.00 to 2.00 N m"
    assert region_words(spans) == words
    assert region_words([Span(Variable(Quantity.SESSION), 1.0, 1.0)]) == "session 2"


def test_nothing_unknown_and_undecided_have_sentences_of_their_own() -> None:
    """NONE gives its bound, UNKNOWN its place, INCONCLUSIVE what is lacking."""
    found = (finding(outside(2), Span(Variable(Quantity.POSITION, 2, "rad"), np.deg2rad(3.0), np.deg2rad(9.0))),)
    assert "below 10 % of the noise" in verdict_sentence(result("NONE"))
    unknown = verdict_sentence(result("UNKNOWN", findings=found))
    assert "outside the catalogue" in unknown
    assert "joint 2" in unknown
    assert "position of joint 2 from 3.00 to 9.00°" in unknown
    assert verdict_sentence(result("INCONCLUSIVE")).startswith("Not decided: nothing beats noise")
    assert "no name can be given" in verdict_sentence(result("INCONCLUSIVE", findings=found))


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (np.pi, "rad", "180° (–)"),
        (0.0123, "m", "12.3 mm (–)"),
        (118.4, "N m/rad", "118 N m/rad (–)"),
        (0.05, "1", "0.0500 (–)"),
    ],
)
def test_numbers_are_in_the_readers_units(value: float, unit: str, shown: str) -> None:
    """Angles in degrees, lengths in millimetres, other units as they are, three digits."""
    words = estimate_words(estimate(value, None, unit))
    assert words == shown.removesuffix(" (–)")
    assert number(in_reader_units(0.0, unit)[0]) == "0"


def test_one_number_a_session_is_shown_for_each() -> None:
    """Values of several sessions are shown one after the other."""
    said = estimate_words(Estimate((0.01, 0.02), ((0.0, 0.02), (0.01, 0.03)), "m"))
    assert said == "10.0 mm (0 to 20.0); 20.0 mm (10.0 to 30.0)"


def test_a_size_that_may_be_none_is_given_as_a_bound() -> None:
    """Below what it may be at most; a stiffness, whose absence is infinite, above what it may be at least."""
    assert estimate_words(Estimate(1e-5, (-1e-4, 2e-4), "m", (0.0,))) == "below 0.200 mm"
    assert estimate_words(Estimate(900.0, (400.0, 1e6), "N m/rad", (float("inf"),))) == "above 400 N m/rad"
    mixed = named("gain_error", 2, parameters={
        "proportional": Estimate(0.01, (-0.1, 0.1), "1", (0.0,)), "derivative": Estimate(0.3, (0.2, 0.4), "1", (None,)),
    })  # fmt: skip
    assert verdict_sentence(result("EXACT", mixed)).startswith("Joint 2: gain error, derivative 0.300 (0.200 to 0.400)")


def test_a_place_is_not_given_one_name_of_a_class(tmp_path: Path) -> None:
    """Where the kind alone is sure, the table of places names all that it may be, the most probable first."""
    play = named("hysteresis", 2, "CLASS", probability=0.3, rivals=(rival("backlash", 2, 0.7),))
    found = result("CLASS", play)
    places = place_verdicts(found.effects, found.gap, found.localisation)
    write_discrepancy_report(replace(found, verdict=replace(found.verdict, places=places)), tmp_path / "report.html")
    table = (tmp_path / "report.html").read_text().split("At a glance", 1)[1].split("</table>", 1)[0]
    assert "backlash or hysteresis" in table


def test_two_of_one_name_are_told_apart() -> None:
    """Not "feedforward error (70 %) or feedforward error (30 %)"."""
    labels = [f"feedforward error (2, term {term})" for term in ("gravity", "inertia")]
    other = replace(rival("feedforward_error", 2, 0.3), label=labels[1])
    effect = named("feedforward_error", 2, "CLASS", probability=0.7, label=labels[0], rivals=(other,))
    assert f"{labels[0]} (70 %) or {labels[1]} (30 %)" in verdict_sentence(result("CLASS", effect))


def test_what_has_no_name_comes_before_a_run_for_a_smaller_question() -> None:
    """A run that tells two laws of one joint apart is the next step only where nothing larger is unknown."""
    run = Experiment("load joint 3", True, ("backlash (3)", "hysteresis (3)"), 40.0, 2.0)
    steps = {level: next_step(replace(result(level), next_experiment=run)) for level in ("SET", "UNKNOWN")}
    assert steps["SET"].startswith("record: load joint 3")
    assert steps["UNKNOWN"].startswith("look at the machine")


def test_what_goes_by_session_is_looked_for_between_sessions() -> None:
    """Nobody moves the tracker of a motor's encoder."""
    session = (Span(Variable(Quantity.SESSION), 2.0, 2.0),)
    motor = Channel("measured_jp_2", "measured_jp", 1, 2, "rad")
    seen = {c.signal: finding(c, *session) for c in (outside(1), motor)}
    steps = {signal: next_step(result("UNKNOWN", findings=(found,))) for signal, found in seen.items()}
    assert all(step.startswith("run each session by itself") for step in steps.values())
    assert {signal: "tracker" in step for signal, step in steps.items()} == {"external_jp": True, "measured_jp": False}


@pytest.mark.parametrize("level", ["NONE", "EXACT", "SET", "UNKNOWN", "INCONCLUSIVE"])
def test_the_page_stands_alone_at_every_level(level: str, tmp_path: Path) -> None:
    """Every level gives a whole page: verdict first, figures inside, no other file or address needed."""
    effects = [named("backlash", 2, level)] if level in ("EXACT", "SET") else []
    write_discrepancy_report(result(level, *effects), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert page.index('class="verdict"') < page.index("<h2>")
    assert page.count('class="chart"') >= (4 if effects else 2)
    assert "http" not in page
    assert "nan" not in page.split("<h2>", 1)[1].split("<footer>")[0].lower()


def test_what_no_sensor_sees_beside_its_noise_has_no_gap_to_close() -> None:
    """An effect that evidence alone shows is named with its size, and no share of a gap, which would be noise."""
    assert "closes 99 % of the gap" in verdict_sentence(result("EXACT", named("backlash", 2)))
    assert "gap" not in verdict_sentence(result("EXACT", named("backlash", 1)))


def test_of_many_numbers_it_is_said_which_one_is_given() -> None:
    """A registration has seven: the first that is clear of zero stands with its name; where none is, none is given."""
    some = {"x": Estimate(0.0, (-1e-3, 1e-3), "m", (0.0,)), "y": Estimate(2e-3, (1e-3, 3e-3), "m", (None,))}
    rest = {name: Estimate(0.0, (-1e-3, 1e-3), "rad", (0.0,)) for name in ("rx", "ry", "rz")}
    moved = replace(named("registration_error", "base"), parameters=some | rest)
    assert "registration error, y 2.00 mm" in verdict_sentence(result("EXACT", moved))
    unclear = replace(moved, parameters={"x": some["x"]} | rest)
    assert verdict_sentence(result("EXACT", unclear)).startswith("Base: registration error, closes")
