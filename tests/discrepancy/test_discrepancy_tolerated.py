"""What the tolerance of table and registration takes up is said, and too much of it is no "nothing is missing"."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gpcorrect.discrepancy.settings import SETTINGS

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))

from discrepancy_support import result, verdict_sentence
from truth import Spec, make_case

from gpcorrect.discrepancy import DiscrepancyResult, Level
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.sim import model_from_dict


def found_in(*hidden: str, ratio: float = 1.0) -> DiscrepancyResult:
    """Return the result on a tracker's recording by another simulator: 12 trajectories of 5 s."""
    case = make_case(Spec("one", hidden, ratio, signals="tracker", trajectories=12, seconds=5.0), 5)
    return find_discrepancy(model_from_dict(case.nominal), case.log)


@pytest.mark.slow
def test_a_registration_that_is_off_is_never_nothing() -> None:
    """At half the noise it may be within the tolerance of a table, and is not called nothing for that."""
    found = found_in("registration_error", ratio=0.5)
    assert found.level != Level.NONE
    assert max(found.provenance.tolerated.values()) > SETTINGS.verdict.most_tolerated or found.effects


def stub(tolerated: float, level: str) -> DiscrepancyResult:
    axes = tuple(Channel(f"tracker_cp_{axis}", "tracker_cp", i, 0, "m") for i, axis in enumerate("xy"))
    return result(level, channels=axes, tolerated={"tracker_cp_x": tolerated})


def test_the_sentence_says_how_much_is_tolerated() -> None:
    assert "tolerances" not in verdict_sentence(stub(0.1, "NONE"))
    assert "tolerances of table and registration (0.1 mrad, 0.02 mm) (40 % of it)" in verdict_sentence(
        stub(0.4, "NONE")
    )
    assert "90 % of the noise" in verdict_sentence(stub(0.9, "INCONCLUSIVE"))
