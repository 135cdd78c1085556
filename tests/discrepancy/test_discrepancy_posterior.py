"""Probabilities of names, from evidence made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.discrepancy.naming.posterior import posterior
from gpcorrect.discrepancy.naming.weigh import Own, Rival, Unknown, Weighed
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect, all_candidates
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.sim import model_from_dict
from gpcorrect.types import CalibrationLog

COST = 10.0


@pytest.fixture(scope="module")
def catalogue() -> dict[str, Candidate]:
    """Return candidates of one bare joint by their names."""
    q = np.linspace(0.0, 1.0, 50)[:, None]
    zeros = np.zeros(50, dtype=np.int64)
    log = CalibrationLog(
        time=np.arange(50) / 10.0, trajectory=zeros, session=zeros, measured_jp=q, setpoint_jp=q, external_jp=q
    )
    model = model_from_dict({"arm": "joints", "joints": [1], "joint_types": "R"})
    scene = build_scene(log, model, np.ones(50, dtype=np.bool_))
    return {c.name: c for c in reversed(all_candidates(scene))}  # the plainest of each name


def _weighed(
    own: float,
    rival: Candidate,
    nats: float,
    *,
    beside: float = 0.0,
    instead: float = 0.0,
    shape_nats: float = np.inf,
) -> Weighed:
    fit = FittedEffect(rival, np.array(rival.start))
    nothing = np.zeros(0)
    gain = Own((), (nothing, nothing), np.array([own]), np.zeros(1), 1.0)
    return Weighed(
        gain, np.ones(2, dtype=np.bool_), (Rival(fit, nats, shape_nats=shape_nats),), Unknown(instead, beside)
    )


def test_probabilities_sum_to_one_and_follow_the_evidence(catalogue: dict[str, Candidate]) -> None:
    """A rival two nats behind is e^-2 as probable when both have as many numbers."""
    own, rival = catalogue["transmission_ratio"], catalogue["homing_offset"]
    assert own.extra == rival.extra
    found = posterior(own, _weighed(100.0, rival, 98.0), COST)
    assert sum(a.probability for a in found) == pytest.approx(1.0)
    assert found[-1].probability / found[0].probability == pytest.approx(np.exp(-2.0))


def test_of_two_that_explain_alike_the_simpler_is_more_probable(catalogue: dict[str, Candidate]) -> None:
    """Numbers beyond the first have a price, whatever else is still missing."""
    simple, flexible = catalogue["backlash"], catalogue["pulley_eccentricity"]
    assert flexible.extra > simple.extra
    for beside in (0.0, 400.0):
        mine, *_, rival = posterior(simple, _weighed(5000.0, flexible, 5000.2, beside=beside), COST)
        assert mine.probability > 0.95 > rival.probability


def test_a_lead_smaller_than_what_is_still_missing_leaves_the_rival(catalogue: dict[str, Candidate]) -> None:
    """What neither explains may favour either: the rival stays until the lead is larger than that."""
    own, rival = catalogue["transmission_ratio"], catalogue["homing_offset"]
    for missing, stays in ((0.0, False), (30.0, False), (60.0, True)):
        found = posterior(own, _weighed(1000.0, rival, 960.0, beside=missing + COST), COST)
        assert (found[-1].probability >= SETTINGS.naming.stable) is stays


def test_a_lead_that_an_error_of_our_own_signatures_could_make_leaves_the_rival(
    catalogue: dict[str, Candidate],
) -> None:
    """A thousandth of very many nats is no evidence between two models that are both approximate."""
    own, rival = catalogue["transmission_ratio"], catalogue["homing_offset"]
    for nats, stays in ((1e3, False), (1e5, True)):
        found = posterior(own, _weighed(nats, rival, nats - 80.0), COST)
        assert (found[-1].probability >= SETTINGS.naming.stable) is stays


def test_a_fuller_law_whose_shape_the_data_leave_open_is_not_ruled_out_and_never_leads(
    catalogue: dict[str, Candidate],
) -> None:
    """Numbers of which the data say nothing cost nothing, up to a draw; those that they say cost what is said."""
    own, fuller = catalogue["backlash"], catalogue["pulley_eccentricity"]
    for lead, shape_nats, odds in ((0.0, 0.5, -0.5), (3.0, 0.5, 0.0), (-1.0, 1.0, -2.0), (0.0, 60.0, -8.0)):
        mine, *_, rival = posterior(own, _weighed(100.0, fuller, 100.0 + lead, shape_nats=shape_nats), COST)
        assert fuller.extra - own.extra == 2
        assert rival.probability / mine.probability == pytest.approx(np.exp(odds))
