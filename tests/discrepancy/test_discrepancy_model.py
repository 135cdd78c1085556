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
from gpcorrect.sim import Model, machine_of, model_from_dict, read_model, simulate, write_model
from gpcorrect.sim.plan import Segment, plan_of
from gpcorrect.types import CalibrationLog, FloatArray


def bare_case(name: str, seed: int) -> tuple[CalibrationLog, Model, dict[str, Any]]:
    """Return a recording of another simulator with one hidden cause, twice as large as the noise."""
    case = make_case(Spec("one", (name,), 2.0, signals="bare", trajectories=12, seconds=5.0), seed)
    return case.log, model_from_dict(case.nominal), case.labels["effects"][0]


def what_it_does(model: Model, log: CalibrationLog) -> FloatArray:
    """Return true minus reported joints `(n, k)` of a model that is commanded as the recording was."""
    segments = [Segment(log.setpoint_jp[rows], log.trajectory[rows]) for _, rows in log.trajectories()]
    machine = replace(machine_of(model.model_copy(update={"noise": None})), log_rate_hz=100.0)
    made = simulate(machine, plan_of(segments, 100.0))
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
