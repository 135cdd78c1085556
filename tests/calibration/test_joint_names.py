"""A joint model measured on recordings that name the same joints in another order than the training's, or others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_logs import joint_log

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model, load, refuse_unlike, save
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import CalibrationLog, LogMeta

NAMES = ("shoulder", "elbow", "insertion")
TURNED = [2, 0, 1]


def named(log: CalibrationLog, order: list[int]) -> CalibrationLog:
    """Return a log with its joints in another order, their names and types with them."""
    tables = {name: getattr(log, name)[:, order] for name in log.JOINTS if name in log.signals}
    meta = LogMeta(joint_types="".join("RRP"[j] for j in order), joint_names=tuple(NAMES[j] for j in order))
    return replace(log, **tables, meta=meta)


def test_joints_in_another_order_are_answered_by_name_and_others_refused(tmp_path: Path) -> None:
    """In the wrong order, a zero was called off that was not; the numbers are now those of the training's order."""
    fitted = fit_model(named(joint_log(1, 6), [0, 1, 2]), FitSettings(method="linear"), task=JointCorrector).corrector
    save(fitted, tmp_path / "m.gpc")
    model = load(tmp_path / "m.gpc", JointCorrector)
    log = joint_log(2, 2)
    straight, turned, unnamed = named(log, [0, 1, 2]), named(log, TURNED), log
    measured = [evaluate_model(model, one) for one in (straight, turned, unnamed)]
    for other in measured[1:]:
        np.testing.assert_array_equal(other.clean.corrected, measured[0].clean.corrected)
    said = "put by name in the order shoulder, elbow, insertion; they came as insertion, shoulder, elbow"
    assert [said in " ".join(one.cautions) for one in measured] == [False, True, False]
    on_clock, _ = model.on_one_clock(turned, "none")
    assert said in " ".join(evaluate_model(model, on_clock).cautions)
    np.testing.assert_array_equal(model.correct_log(turned).joints, model.correct_log(straight).joints)
    np.testing.assert_array_equal(model.rezeroed(turned).zero, model.rezeroed(straight).zero)
    others = replace(straight, meta=replace(straight.meta, joint_names=("shoulder", "elbow", "yaw")))
    swapped = replace(fitted, summary={**fitted.summary, "joint_names": NAMES[::-1]})
    with pytest.raises(DataError, match="is of the joint names"):
        refuse_unlike(model, swapped, ("one", "other"))
    for used in (model.correct_log, model.rezeroed, lambda one: evaluate_model(model, one)):
        with pytest.raises(LogError, match="the joints are shoulder, elbow, yaw, and those that they go with shoulder"):
            used(others)
