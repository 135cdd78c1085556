"""The model that a run writes: it has all that it had, does what was hidden, and leaves nothing of it to find."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))

from truth import Spec, make_case

from gpcorrect.discrepancy import Level
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.sim import EFFECTS, Model, machine_of, model_from_dict, read_model, simulate, write_model
from gpcorrect.sim.model import model_text
from gpcorrect.sim.plan import Segment, plan_of
from gpcorrect.types import CalibrationLog, FloatArray

WHOLE: dict[str, Any] = {
    "arm": "raven2_left",
    "joints": [1, 2, 3],
    "wrist": [0.0, 0.1, 0.0],
    "theta_offset_deg": [205, 180, 0, 0, -90, 0],
    "gravity": [-9.7, 0.1, 0.2],
    "payload": 0.25,
    "log_rate_hz": 50.0,
    "T_tracker_base": {"translation": [0.1, 0.2, 0.3], "rotvec": [0.0, 0.5, 0.0]},
    "T_tip_marker": {"translation": [0.0, 0.0, 0.01]},
    "controller": {"kp": [400.0, 400.0, 1e5], "kd": [20.0, 20.0, 6e3], "rate_hz": 500.0, "feedforward": "rigid-body"},
    "transmission": {"motor_inertia": [0.2, 0.2, 60.0]},
    "links": {"mass": [0.4, 0.7], "com": [[0.0, 0.1, -0.1], [0.0, -0.2, -0.2]]},
    "noise": {"external_jp_white": [1e-4, 1e-4, 1e-5], "tracker_white": 2e-4, "encoder_step": [1e-5, 1e-5, 1e-6]},
    "faults": {"outlier_share": 0.01, "outlier_shift": 0.02},
    "effects": [
        {"name": "homing_offset", "joint": 1, "offset": [0.01, 0.02]},
        {"name": "cable_coupling", "joint": 2, "source": 1, "coefficient": 0.01},
    ],
}


def test_a_model_written_back_keeps_everything(tmp_path: Path) -> None:
    """Payload, tables, noise, faults and effects (one value a session among them) come back from the file unchanged."""
    model = model_from_dict(WHOLE)
    write_model(model, tmp_path / "model.toml")
    again = read_model(tmp_path / "model.toml")
    assert again == model
    assert model_text(again) == model_text(model)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_can_be_written_and_read_again(name: str, tmp_path: Path) -> None:
    """Each of the 29, in the shapes in which the search would insert it, survives the model file."""
    from gpcorrect.sim.effects import Scope, candidates

    scope = Scope((1, 2, 3), "RRP", np.array([[0.3, 1.0], [1.0, 1.9], [0.3, 0.4]]), 300.0)
    shapes = [c for c in candidates(scope) if c.kind.about.name == name]
    assert shapes, f"{name} has no place in an arm of three joints"
    model = model_from_dict(WHOLE)
    for shape in shapes[:3]:
        changed = model.with_effects(*model.effects, shape.typical())
        write_model(changed, tmp_path / "model.toml")
        assert read_model(tmp_path / "model.toml") == changed


def bare_case(name: str, seed: int) -> tuple[CalibrationLog, Model, dict[str, Any]]:
    """Return a recording of another simulator with one hidden cause, twice as large as the noise."""
    case = make_case(Spec("one", (name,), 2.0, signals="bare", trajectories=12, seconds=5.0), seed)
    return case.log, model_from_dict(case.nominal), case.labels["effects"][0]


def what_it_does(model: Model, log: CalibrationLog) -> FloatArray:
    """Return true minus reported joints `(n, k)` of a model that is commanded as the recording was."""
    assert log.setpoint_jp is not None
    segments = [Segment(log.setpoint_jp[rows], log.trajectory[rows]) for _, rows in log.trajectories()]
    machine = replace(machine_of(model.model_copy(update={"noise": None})), log_rate_hz=100.0)
    made = simulate(machine, plan_of(segments, 100.0))
    assert made.external_jp is not None
    assert made.measured_jp is not None
    return made.external_jp - made.measured_jp


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("transmission_ratio", 42), ("cable_coupling", 43)])
def test_the_written_model_does_what_was_hidden_and_leaves_none_of_it(name: str, seed: int, tmp_path: Path) -> None:
    """On another simulator's recording: the model simulates the recorded error, and a second run asks for no more."""
    log, model, label = bare_case(name, seed)
    found = find_discrepancy(model, log)
    assert [(e.about.name, e.joint) for e in found.model.effects] == [(name, label["joint"])]
    write_model(found.model, tmp_path / "model.toml")
    again = read_model(tmp_path / "model.toml")
    assert log.external_jp is not None
    assert log.measured_jp is not None
    column = int(label["joint"]) - 1
    recorded, made = (log.external_jp - log.measured_jp)[:, column], what_it_does(again, log)[:, column]
    good = np.isfinite(recorded) & (np.abs(recorded) < 6 * np.nanstd(recorded))
    left = np.std(recorded[good] - made[good]) ** 2 + np.mean(recorded[good] - made[good]) ** 2
    assert left < 0.4 * np.mean(recorded[good] ** 2), "the effect is twice as large as the noise: a fifth is noise"
    assert not find_discrepancy(again, log).effects


def test_what_only_two_simulators_differ_by_is_no_fault_of_the_controller() -> None:
    """On another simulator's recording with nothing hidden, a hundredth of the noise at the motors gets no name."""
    case = make_case(Spec("null", trajectories=12, seconds=10.0), 940100)
    found = find_discrepancy(model_from_dict(case.nominal), case.log)
    assert found.level == Level.NONE
    assert not found.model.effects
    assert all(e.of_motor and e.is_minor for e in found.verdict.minor)
