"""A hidden cause means what the catalogue means: the product's effect with the hidden numbers explains it."""

from __future__ import annotations

import numpy as np
import pytest
from truth import Spec, make_case

from gpcorrect.sim import EFFECTS, Segment, effect_from_dict, machine_of, model_from_dict, plan_of, run

# Share of the noise's RMS that the product's operator may leave of a trace twice as large: other integrators, a spring
# that rings, a bristle that bends before it slides
LEFT = {"cable_stretch": 0.3, "coulomb_friction": 0.4, "viscous_friction": 0.2, "backlash": 0.2, "gravity_sag": 0.1}
EXACT = ("homing_offset", "transmission_ratio", "cable_coupling", "drift")


def _outside(case, effects: list[dict]) -> np.ndarray:
    log, model = case.log, model_from_dict(dict(case.nominal))
    starts = [log.time[r[0]] - log.time[0] for _, r in log.trajectories()]
    segments = [
        Segment(log.setpoint_jp[r], log.trajectory[r], 0, start, log.payload[r[0]])
        for (_, r), start in zip(log.trajectories(), starts, strict=True)
    ]
    machine = machine_of(model.with_effects(*map(effect_from_dict, effects)))
    q = run(machine, plan_of(segments, model.log_rate_hz)).q
    return np.swapaxes(q, 0, 1).reshape(-1, 3)


@pytest.mark.parametrize("name", [*LEFT, *EXACT])
def test_the_products_effect_with_the_hidden_numbers_explains_the_recording(name: str) -> None:
    """Names, units and signs of the labels are the catalogue's: inserting the label closes the gap."""
    assert name in EFFECTS
    case = make_case(Spec("one", (name,), 2.0, trajectories=6, seconds=6.0), 17)
    (label,) = case.labels["effects"]
    params = {k: float("inf") if v == "inf" else v for k, v in label["params"].items()}
    effect = {"name": name, "joint": label["joint"]} | params
    j = label["joint"] - 1
    noise = case.labels["nuisance"]["noise_rms"][j]
    before, after = (
        np.median(np.abs((case.log.external_jp - _outside(case, e))[np.isfinite(case.log.external_jp[:, j]), j]))
        for e in ([], [effect])
    )
    trace = _outside(case, [effect])[:, j] - _outside(case, [])[:, j]
    assert np.sqrt(np.mean(trace**2)) / noise == pytest.approx(2.0, rel=0.2)
    assert after < before
    assert after < 0.6745 * noise * np.sqrt(1 + LEFT.get(name, 0.1) ** 2) * 1.05
