"""The sentence that comes first, and the page behind it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from discrepancy_support import named, nominal, report

from gpcorrect.discrepancy.evidence.cells import Span
from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.words import (
    in_reader_units,
    number,
    parameter_words,
    region_words,
    verdict_sentence,
)
from gpcorrect.discrepancy.search.state import Step
from gpcorrect.report import write_discrepancy_report


def evidence(seed: int = 0, rows: int = 400) -> Evidence:
    rng = np.random.default_rng(seed)
    motor = rng.uniform(-0.5, 0.5, (rows, 2))
    direction = rng.choice([-1.0, 1.0], (rows, 2))
    after = 1e-3 * rng.standard_normal((rows, 2))
    return Evidence(
        before=after + 0.02 * direction,
        after=after,
        motor=motor,
        direction=direction,
        joint=(0, 1),
        sealed=np.arange(rows) % 5 == 0,
        correlation=np.array([[1.0, 0.9], [0.9, 1.0]]),
        labels=("backlash (2)", "coulomb friction (2)"),
        waterfall=(Step("backlash (2)", 120.0), Step("without drift (1)", -4.0)),
    )


def test_an_exact_verdict_names_effect_number_and_gap() -> None:
    """One exact effect is told with place, number, interval and the share of the gap of its own joint."""
    said = verdict_sentence(report("EXACT", named("backlash", 2)))
    assert said == "Joint 2: backlash, 0.573° (0.516 to 0.630), closes 99 % of the gap."


def test_a_set_names_its_rivals_with_their_probabilities() -> None:
    """What cannot be told apart is told together."""
    rival = {"name": "coulomb_friction", "joint": 2, "class": "reversal", "probability": 0.35}
    said = verdict_sentence(report("SET", named("backlash", 2, "SET", probability=0.6, rivals=[rival])))
    assert "backlash (60 %) or coulomb friction (35 %)" in said


def test_several_effects_of_a_place_are_told_in_short() -> None:
    """Rivals without percentages, the most probable first; numbers of long units stay in the table."""
    rival = {"name": "backlash", "joint": 2, "class": "reversal", "probability": 0.7}
    play = named("hysteresis", 2, "CLASS", probability=0.3, rivals=[rival])
    size = {"value": -0.2, "ci95": [-0.3, -0.1], "unit": "rad per unit of source"}
    coupling = named(
        "cable_coupling", 2, parameters={"coefficient": size, "source": {"value": 1, "ci95": None, "unit": ""}}
    )
    said = verdict_sentence(report("CLASS", play, coupling))
    assert said == "Joint 2: backlash or hysteresis + cable coupling from joint 1, close 99 % of the gap."


def test_noise_closes_no_gap() -> None:
    """An effect on noise alone is told with its size, and that there is no gap to close."""
    size = {"value": 1e-3, "ci95": [9e-4, 1.1e-3], "unit": "rad"}
    said = verdict_sentence(report("EXACT", named("noise_change", 2, parameters={"std": size}) | {"class": "noise"}))
    assert said == "Joint 2: noise change, 0.0573° (0.0516 to 0.0630), noise: no gap to close."


def test_regions_are_told_in_degrees_and_millimetres() -> None:
    """Cells are told with the unit of their variable; directions and sessions in words."""
    spans = [Span("position 2", 0.1, 0.2, "rad"), Span("direction 3", -1.0, -1.0, ""), Span("load 1", 1.0, 2.0, "N m")]
    words = "position of joint 2 from 5.73 to 11.5°, joint 3 moving back, load of joint 1 from 1.00 to 2.00 N m"
    assert region_words(spans) == words
    assert region_words([Span("session", 1.0, 1.0, "")]) == "session 2"


def test_nothing_unknown_and_undecided_are_told_apart() -> None:
    """NONE gives its bound, UNKNOWN its place, INCONCLUSIVE what is lacking."""
    finding = {
        "channel": "external_jp_2",
        "variables": ["position 2"],
        "region": "position 2 from 3° to 9°",
        "nats": 50,
    }
    assert "below 10 % of the noise" in verdict_sentence(report("NONE"))
    unknown = verdict_sentence(report("UNKNOWN", localisation=[finding]))
    assert "outside the catalogue" in unknown
    assert "joint 2" in unknown
    assert "position 2 from 3° to 9°" in unknown
    assert verdict_sentence(report("INCONCLUSIVE")).startswith("Not decided: nothing beats noise")
    assert "no name can be given" in verdict_sentence(report("INCONCLUSIVE", localisation=[finding]))


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (np.pi, "rad", "180° (–)"),
        (0.0123, "m", "12.3 mm (–)"),
        (118.4, "N m/rad", "118 N m/rad (–)"),
        (0.05, "1", "0.0500 (–)"),
    ],
)
def test_numbers_are_told_in_the_readers_units(value: float, unit: str, shown: str) -> None:
    """Angles in degrees, lengths in millimetres, other units as they are, three digits."""
    words = parameter_words({"value": value, "ci95": None, "unit": unit})
    assert words == shown.removesuffix(" (–)")
    assert number(in_reader_units(0.0, unit)[0]) == "0"


def test_one_number_a_session_is_told_for_each() -> None:
    """Values of several sessions are told one after the other."""
    said = parameter_words({"value": [0.01, 0.02], "ci95": [[0.0, 0.02], [0.01, 0.03]], "unit": "m"})
    assert said == "10.0 mm (0 to 20.0); 20.0 mm (10.0 to 30.0)"


@pytest.mark.parametrize("level", ["NONE", "EXACT", "SET", "UNKNOWN", "INCONCLUSIVE"])
def test_the_page_stands_alone_at_every_level(level: str, tmp_path: Path) -> None:
    """Every level gives a whole page: verdict first, figures inside, no other file or address needed."""
    effects = [named("backlash", 2, level)] if level in ("EXACT", "SET") else []
    noise = {"white": 1e-3, "slow": 5e-4, "time_constant": 0.2, "tail": None, "basis": "stated"}
    whole = report(level, *effects)
    whole["provenance"]["noise"] = {"external_jp_1": noise, "external_jp_2": noise}
    write_discrepancy_report(whole, evidence(), nominal(), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert page.index('class="verdict"') < page.index("<h2>")
    assert page.count("data:image/png;base64,") >= (5 if effects else 3)
    assert "http" not in page.replace("http-equiv", "")
    assert "nan" not in page.split("<h2>", 1)[1].replace("data:image/png", "").lower().split("base64")[0]
