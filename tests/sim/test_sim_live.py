"""The live machine is the recorded one, a moment at a time."""

from dataclasses import fields, replace

import numpy as np
import pytest
from sim_machines import motion

from gpcorrect.arms import arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim import EFFECTS, machine_of, preset, run
from gpcorrect.sim.debridement import debridement_plan
from gpcorrect.sim.effects import PathEffect, effect_from_dict
from gpcorrect.sim.live import LiveArm
from gpcorrect.sim.live_effects import live_effects
from gpcorrect.sim.motion import Motion

PATHS = (
    {"name": "homing_offset", "joint": 1, "offset": 0.05},
    {"name": "transmission_ratio", "joint": 1, "error": 0.1},
    {"name": "cable_coupling", "joint": 2, "source": 1, "coefficient": 0.2, "drag": 0.1, "drag_radius": 0.3},
    {"name": "pulley_eccentricity", "joint": 1, "amplitude": 0.01, "waves": 3.0, "phase": 0.4},
    {"name": "cable_stretch", "joint": 1, "stiffness": 40.0},
    {"name": "nonlinear_stretch", "joint": 1, "stiffness": 40.0, "cubic": 4000.0},
    {"name": "length_dependent_stiffness", "joint": 1, "source": 3, "rigidity": 100.0, "length": 5.0},
    {"name": "gravity_sag", "joint": 1, "stiffness": 40.0},
    {"name": "backlash", "joint": 1, "radius": 0.3},
    {"name": "hysteresis", "joint": 1, "radius": 0.3, "sharpness": 2.0},
    {"name": "creep", "joint": 1, "compliance": 0.02, "time_constant": 0.1},
    {"name": "drift", "joint": 1, "rate": 1e-3},
    {"name": "delay", "joint": "all", "delay": 0.03},
    {"name": "resonance", "joint": 1, "frequency": 8.0, "damping_ratio": 0.1},
    {"name": "cable_slip", "joint": 1, "step": 0.1, "instant": 0.2},
)


def moment(whole: Motion, i: int) -> Motion:
    """Sample `i` of the first run."""
    parts = {f.name: getattr(whole, f.name) for f in fields(whole)}
    cut = {k: v[i : i + 1, :1] for k, v in parts.items() if k not in ("joints", "session", "tip_force")}
    return replace(whole, session=whole.session[:1], **cut)


@pytest.mark.parametrize("values", PATHS, ids=[v["name"] for v in PATHS])
def test_an_effect_taken_sample_by_sample_is_the_effect(values):
    """Whatever an effect remembers, it gives the same path live as on the whole recording."""
    whole = motion(n=60, runs=1)
    whole = replace(whole, position=np.cumsum(0.2 * whole.position, axis=0))
    effect = effect_from_dict(values)
    at_once = effect.act(whole.position, whole)
    (live,) = live_effects((effect,))
    one_by_one = np.concatenate([live.act(whole.position[i : i + 1], moment(whole, i)) for i in range(60)])
    np.testing.assert_allclose(one_by_one, at_once, atol=1e-12)
    assert np.abs(at_once - whole.position).max() > 1e-4


def test_every_path_effect_is_tested_live():
    """The list above holds every effect of the catalogue that acts on paths."""
    assert {v["name"] for v in PATHS} == {name for name, kind in EFFECTS.items() if issubclass(kind, PathEffect)}


def test_the_future_is_not_known():
    """An arm that would be seen before it moves cannot run live."""
    with pytest.raises(DataError, match="before it moves"):
        live_effects((effect_from_dict({"name": "delay", "joint": "all", "delay": -0.03}),))


@pytest.mark.parametrize("block", [5, 20])
def test_live_and_recorded_machine_agree(block):
    """On the debridement machine, wrong by centimetres, live and recorded tool paths differ by a tenth of a mm."""
    machine = machine_of(preset("raven2_debridement"))
    plan = debridement_plan(arm_named(machine.arm), 2, machine.log_rate_hz, np.random.default_rng(3))
    recorded = run(machine, plan, 4)
    assert recorded.T_base_tip is not None
    spline, live, tool = plan.spline(), LiveArm(machine, plan.q[0, 0], block=block), []
    for k in range(len(plan.q)):
        steps = np.arange(1, 11) * live.step + (k - 1) / plan.rate_hz
        here = live.advance(spline(steps)[:, 0]) if k else live.moment
        tool.append(here.T_base_tip[:3, 3])
    apart = np.linalg.norm(np.array(tool) - recorded.T_base_tip[:, 0, :3, 3], axis=1)
    own = np.linalg.norm(machine.body.forward(plan.q)[:, 0, :3, 3] - recorded.T_base_tip[:, 0, :3, 3], axis=1)
    assert apart.max() < 3e-4
    assert np.sqrt((apart**2).mean()) < 1e-4
    assert own.mean() > 0.01
