"""What the links ask of the joints along the path that the motors were measured on, where no loop is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import raven_swings

from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.sim import Model, machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import CableCoupling, CableStretch, Effect, TransmissionRatio
from gpcorrect.types import FloatArray


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


def test_links_that_stretched_cables_move_carry_another_load() -> None:
    """What the model has acts in the loop, to rounding; of what is looked for beside it 30 % are left at most.

    That is the load at rest: what the links' own acceleration takes, 14 to 27 %, is left out of account.
    """
    controller = {"kp": [300.0, 300.0, 3000.0], "kd": [15.0, 15.0, 150.0], "feedforward": "gravity"}
    bare = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 100, "controller": controller})
    stretched = bare.with_effects(CableStretch(1, 100.0), CableStretch(2, 80.0), CableStretch(3, 8000.0))
    log = replace(simulate(machine_of(stretched), raven_swings(5, 6, 3.0), seed=7), tracker_cp=None)

    def left(model: Model, *effects: Effect) -> FloatArray:
        scene = build_scene(log, model, np.ones(len(log), dtype=np.bool_))
        motors = [c.signal == "measured_jp" for c in scene.channels]
        return np.sqrt(np.nanmean(scene.residual(effects)[:, motors] ** 2, axis=0))

    unseen, known, found = left(bare), left(stretched), left(bare, *stretched.effects)
    assert (known < 1e-12).all()
    assert (unseen > 1e-6).all()
    assert (found < 0.3 * unseen).all()


def test_motors_carry_less_behind_gears_that_turn_less() -> None:
    """What is looked for beside the loop takes off the motors what the gear takes off in it, to a fifth of that.

    On an arm of Drake's with a ratio of 0.4 % a motor's constant, a spring or a fed-forward term was named beside it.
    """
    controller = {"kp": [2000.0, 2000.0, 90000.0], "kd": [45.0, 45.0, 4800.0], "feedforward": "gravity"}
    bare = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 100, "controller": controller})
    gears = (TransmissionRatio(2, 0.02, of="gear"), CableCoupling(3, 1, 0.02, of="gear"))
    read = tuple(replace(effect, of="reading") for effect in gears)
    of_gears, of_readings = (
        replace(simulate(machine_of(bare.with_effects(*effects)), raven_swings(5, 6, 3.0), seed=7), tracker_cp=None)
        for effects in (gears, read)
    )
    scene = build_scene(of_readings, bare, np.ones(len(of_readings), dtype=np.bool_))
    motors = [[c.name for c in scene.channels].index(f"measured_jp_{joint}") for joint in (1, 2)]
    hidden = (of_gears.measured_jp - of_readings.measured_jp)[:, :2]
    found = (scene.predict(gears) - scene.predict(read))[:, motors]
    assert (((found - hidden) ** 2).mean(axis=0) < 0.2**2 * (hidden**2).mean(axis=0)).all()
