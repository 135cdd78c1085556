"""Corners of the numerical core: tests of many joints, tangents at a bound, copies of memories."""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from discrepancy_core import joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy.evidence.variables import Covariates, Quantity, Variable, all_cells, covariates_of
from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.replay_memory import ReplayMemory
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import _tangents
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.discrepancy.settings import TESTS
from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Stage
from gpcorrect.types import FloatArray

JOINTS = range(1, 7)


def test_each_of_six_joints_is_tested_by_its_own_variables() -> None:
    """Of a tracker's 450 pairs the first 150 were tested, all of which held a variable of joint 1."""
    rng = np.random.default_rng(0)
    kinds = (Quantity.POSITION, Quantity.DIRECTION, Quantity.SPEED, Quantity.LOAD, Quantity.ACCELERATION)
    values = {Variable(kind, joint): rng.normal(size=40) for joint in JOINTS for kind in kinds}
    primary = tuple(v for v in values if v.quantity in kinds[:2])
    cells = all_cells(Covariates(values, primary))
    assert len(cells) == TESTS.max_tests
    tested = {frozenset(c.variables) for c in cells}
    for joint in JOINTS:
        position, direction, *others = (Variable(kind, joint) for kind in kinds)
        assert {frozenset((position, v)) for v in (direction, *others)} <= tested


@dataclass(frozen=True)
class Line:
    """As much of a fit of one number: the channel is one more than it."""

    u: FloatArray
    candidate: SimpleNamespace

    @property
    def effect(self) -> float:
        return float(self.u[0])

    def moved(self, j: int, value: float) -> Line:
        return Line(np.array([value]), self.candidate)


@pytest.mark.parametrize("u", [np.nextafter(0.0, 1.0), 5e-5, np.nextafter(1e-4, 0.0)])
def test_a_tangent_at_a_bound_is_taken_to_where_there_is_room(u: float) -> None:
    """In a range narrower than a step, from the lower end, it was taken over one rounding, and was nothing."""

    def predict(effects: Sequence[float]) -> FloatArray:
        return np.array([[1.0 + sum(effects)]])

    bounds = np.zeros(1), np.full(1, 1e-4)
    kind = SimpleNamespace(stage=Stage.TRANSMISSION)
    line = Line(np.array([u]), SimpleNamespace(bounds=bounds, instant=None, kind=kind))
    _, slopes = _tangents(SimpleNamespace(predict=predict), [], [line])  # type: ignore[arg-type, list-item]
    assert slopes[0, 0, 0] == pytest.approx(1.0, rel=1e-6)


def test_a_copy_of_a_memory_is_empty() -> None:
    """So are those in other processes, which begin with nothing."""
    memory = ReplayMemory()
    memory.pull = np.zeros(1)
    assert copy.deepcopy(memory).pull is None


def test_an_effect_that_is_no_machine_at_any_size_is_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no halved size could be simulated, the least squares ended in a message about its starting point."""
    dataset = prepare_data(joint_log(3), nominal(), np.random.default_rng(0)).dataset
    candidate = next(c for c in all_candidates(dataset.scene) if c.name == "homing_offset")
    search = start_search(dataset, [candidate])

    def predict(self: Dataset, effects: Sequence[object] = ()) -> FloatArray:
        raise DataError("the loop is unstable.")

    monkeypatch.setattr(Dataset, "predict", predict)
    new = FittedEffect(candidate, candidate.scaled(np.ones(1)))
    assert search.refit_with((), new) is None
    with pytest.raises(DataError, match=f"no machine with {re.escape(candidate.label)}"):
        search.refit((new,), candidate)


def test_a_state_that_stays_as_it_was_at_the_rows_looked_at_is_left_out() -> None:
    """It has no spread to be scaled by, whatever it does at the other rows."""
    scene = prepare_data(joint_log(3), nominal(), np.random.default_rng(0)).dataset.scene
    everywhere = np.arange(len(scene.time))
    assert covariates_of(scene, 0, everywhere).memory
    assert covariates_of(scene, 0, np.full(5, 40)).memory == ()
