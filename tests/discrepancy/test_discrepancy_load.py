"""What the links ask of the joints along the path that the motors were measured on, where no loop is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import raven_swings

from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import CableStretch


@pytest.mark.parametrize(("joint", "stiffness"), [(1, 300.0), (2, 300.0), (3, 5000.0)])
def test_without_a_known_loop_the_load_holds_what_accelerates_the_links(joint: int, stiffness: float) -> None:
    """By their weight alone a stretch of joint 2 left all of itself, and one of joint 1 a third."""
    model = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 100})
    stretch = CableStretch(joint, stiffness)
    log = simulate(machine_of(model).with_effects(stretch), raven_swings(5, 4, 4.0), seed=7)
    scene = build_scene(replace(log, tracker_cp=None), model, np.ones(len(log), dtype=np.bool_)).strict()
    assert scene.plan is None
    channel = [c.name for c in scene.channels].index(f"external_jp_{joint}")
    before, after = (np.sqrt(np.nanmean(scene.residual(e)[:, channel] ** 2)) for e in ((), (stretch,)))
    assert after < 0.05 * before
