"""`gpcorrect simulate --model`: every effect of the catalogue, from file to recording."""

import numpy as np
import pytest
from cli_support import assert_refused

from gpcorrect.logs import read_log
from gpcorrect.sim import EFFECTS, model_from_dict, write_model
from gpcorrect.sim.effects import Scope, candidates

RANGES = np.array([[-0.2, 0.2], [0.9, 2.0], [0.25, 0.45]])  # of joint 1 less than these reaches go: they meet a stop
SCOPE = Scope((1, 2, 3), "RRP", RANGES, 10.0, torques=np.array([0.3, 0.3, 3.0]))  # less than these reaches ask for
TYPICAL = {c.kind.about.name: c.typical() for c in reversed(tuple(candidates(SCOPE)))}


def model_file(folder, *effects, arm="raven2_left"):
    values = {"arm": arm, "joints": [1, 2, 3], "payload": 0.2 if arm != "joints" else 0.0, "effects": effects}
    write_model(model_from_dict(values), folder / "model.toml")
    return folder / "model.toml"


def simulated(gpcorrect, folder, *effects):
    """Return the log that the command writes for these effects."""
    outcome = gpcorrect(
        "simulate",
        "--model",
        model_file(folder, *effects),
        "--reaches",
        2,
        "--seconds",
        1.5,
        "--output",
        folder / "a.csv",
    )
    assert outcome.code == 0, outcome.err
    return read_log(folder / "a.csv")


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_goes_through_the_command(name, gpcorrect, tmp_path):
    """A model file with the effect gives a recording that differs from the one without it."""
    plain, changed = simulated(gpcorrect, tmp_path), simulated(gpcorrect, tmp_path, TYPICAL[name])
    assert len(changed) == len(plain) == 300
    differs = [
        not np.array_equal(getattr(changed, s), getattr(plain, s)) for s in plain.signals if not s.endswith("_cp")
    ]
    differs.append(not np.array_equal(changed.tracker_cp.position, plain.tracker_cp.position))
    assert any(differs)


def test_an_effect_that_needs_an_arm_is_refused_on_bare_joints(gpcorrect, tmp_path):
    path = model_file(tmp_path, TYPICAL["shaft_bending"], arm="joints")
    assert_refused(gpcorrect("simulate", "--model", path, "--output", tmp_path / "a.csv"), "shaft_bending needs an arm")
