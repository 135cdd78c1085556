"""A gear's gap of which the load chooses the flank, against a link that falls across it in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import held_up_raven, swings_of

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.candidates import all_candidates
from gpcorrect.discrepancy.search.needs import split_by_needs
from gpcorrect.types import CalibrationLog, FloatArray

MODEL = held_up_raven(5e-5, 5e-5, 1e-5)
RADIUS, INERTIA, SUB = 2e-3, 0.001, 20


def seen(log: CalibrationLog) -> Scene:
    return build_scene(log, MODEL, np.ones(len(log), dtype=np.bool_))


def fallen(load: FloatArray) -> FloatArray:
    """Place `(n,)` of a link in its gap at 100 Hz: it falls with its load, and stays where it lands."""
    place, speed, path = -RADIUS * np.sign(load[0]), 0.0, np.empty(len(load))
    for i, torque in enumerate(load):
        path[i] = place
        for _ in range(SUB):
            speed -= torque / INERTIA * 0.01 / SUB
            place += speed * 0.01 / SUB
            if abs(place) >= RADIUS:
                place, speed = RADIUS * np.sign(place), 0.0
    return path


def test_a_gap_is_looked_for_where_its_load_changes_sign() -> None:
    """Elsewhere it is an offset of the joint, and would stand beside each."""
    log = swings_of(MODEL)
    scene = seen(log)
    able, _ = split_by_needs(all_candidates(scene), scene, log)
    assert {c.joint for c in able if c.name == "loaded_backlash"} == {2}
    assert {c.joint for c in able if c.name == "backlash"} == {1, 2, 3}


@pytest.mark.slow
def test_a_gap_that_is_held_on_one_flank_or_the_other_is_named() -> None:
    """A gear's gap had acted like a stretched cable. What falling across takes is no name, and stays: UNKNOWN."""
    log = swings_of(MODEL)
    load, external = seen(log).load()[:, 1], np.array(log.external_jp)
    for run in np.unique(log.trajectory):
        rows = log.trajectory == run
        external[rows, 1] += fallen(load[rows])
    found = find_discrepancy(MODEL, replace(log, external_jp=external))
    (effect,) = found.effects
    assert found.level == "UNKNOWN"
    assert (effect.name, effect.joint) == ("loaded_backlash", 2)
    assert effect.parameters["radius"].value == pytest.approx(RADIUS, rel=0.05)
