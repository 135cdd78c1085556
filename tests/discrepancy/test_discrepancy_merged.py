"""One effect with further numbers stands for two that would each explain a part of it, or is found with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from discrepancy_core import NOISE, joint_log, raven_swings

from gpcorrect.discrepancy.search.candidates import all_candidates
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.discrepancy.search.stepwise import search
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import CableCoupling, Hysteresis
from gpcorrect.types import CalibrationLog

MODEL = model_from_dict(
    {"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 25, "noise": {"tracker_white": 1e-4}}
)
HOME = 0.4  # rad from where the joint is zero


def recorded(seed: int) -> CalibrationLog:
    """Return a recording of a tracker alone, in which the shoulder's cable drags the insertion from its home on."""
    coupling = CableCoupling(joint=3, source=2, coefficient=0.006, home=HOME)
    log = simulate(machine_of(MODEL).with_effects(coupling), raven_swings(seed, 12, 6.0), seed=seed)
    return replace(log, external_jp=None)


def test_a_home_is_no_second_effect_elsewhere() -> None:
    """Seen by a tracker, the constant that a coupling leaves without its home looks like a longer tool as well."""
    dataset = prepare_data(recorded(1), MODEL, np.random.default_rng(0)).dataset
    wanted = [
        c for c in all_candidates(dataset.scene)
        if (c.name, c.joint) in {("cable_coupling", 3), ("dh_error", "tool")}
        and "drag" not in {k.parameter.name for k in c.coordinates}
    ]  # fmt: skip
    found = search(start_search(dataset, wanted), rounds=4).fitted
    assert [f.candidate.name for f in found] == ["cable_coupling"]
    assert abs(found[0].effect.home - HOME) < 0.1  # type: ignore[attr-defined]


def test_a_hysteresis_is_found_with_its_depth() -> None:
    """Slack that takes up a fifth of the motion is found as such, of one joint's candidates."""
    log = joint_log(3, Hysteresis(1, 3.0 * NOISE, depth=0.2))
    bare = model_from_dict({"arm": "joints", "joints": [1, 2], "joint_types": "RR"})
    dataset = prepare_data(log, bare, np.random.default_rng(0)).dataset
    found = search(start_search(dataset, [c for c in all_candidates(dataset.scene) if c.joint == 1]), rounds=4).fitted
    assert [f.candidate.name for f in found] == ["hysteresis"]
    assert 0.1 < found[0].effect.depth < 0.4  # type: ignore[attr-defined]
    assert abs(found[0].effect.radius / NOISE - 3.0) < 0.5  # type: ignore[attr-defined]


def test_a_hysteresis_may_take_up_its_lag_over_half_a_stroke() -> None:
    """Elements that slip one after the other, the last after many times their lag, leave a hundredth of each move."""
    log = joint_log(3, Hysteresis(1, 3.0 * NOISE, depth=0.01, law="plays"))
    bare = model_from_dict({"arm": "joints", "joints": [1, 2], "joint_types": "RR"})
    dataset = prepare_data(log, bare, np.random.default_rng(0)).dataset
    found = search(start_search(dataset, [c for c in all_candidates(dataset.scene) if c.joint == 1]), rounds=4).fitted
    assert [f.candidate.name for f in found] == ["hysteresis"]
    assert 0.006 < found[0].effect.depth < 0.015  # type: ignore[attr-defined]
    assert abs(found[0].effect.radius / NOISE - 3.0) < 0.5  # type: ignore[attr-defined]
