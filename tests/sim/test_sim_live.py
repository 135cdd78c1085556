"""The live machine is the recorded one, a moment at a time."""

from dataclasses import fields, replace

import numpy as np
import pytest
from sim_machines import drive, moves, raven, weightless
from sim_machines import motion as random_motion
from test_sim_effects import ACTIVE, NEUTRAL

from gpcorrect.arms import arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim import machine_of, preset, run
from gpcorrect.sim.effects import (
    ChainEffect,
    CoulombFriction,
    Delay,
    DriveEffect,
    FrictionEffect,
    LoadEffect,
    NoiseChange,
    PathEffect,
    ReadingEffect,
    TipEffect,
    TorqueEffect,
    effect_from_dict,
)
from gpcorrect.sim.live import LiveArm
from gpcorrect.sim.motion import Motion, Readings
from gpcorrect.sim.reaches import debridement_plan
from gpcorrect.sim.servo import Clock, Loop, Reference
from gpcorrect.sim.servo_steps import State

# They change the machine itself, before it moves, and hold no matter when the arm is looked at.
OF_THE_MACHINE = (ChainEffect, DriveEffect, LoadEffect)
# Where live and recorded differ, and why.
EXCEPTIONS = (
    (Delay("all", 0.005), "below one sample the slope of its curve is taken from the past alone"),
    (NoiseChange("tool", 0.01), "on the tracker the three axes take their draws in another order"),
)
SAMPLES = 60


def cut(value, part):
    """Return a stretch of a motion or of readings."""
    parts = {f.name: getattr(value, f.name) for f in fields(value)}
    return replace(
        value, **{k: v[part] for k, v in parts.items() if k not in ("joints", "session", "tip_force") and v is not None}
    )


def moved() -> Motion:
    """One run of a wide random motion with a load at the tip."""
    whole = random_motion(n=SAMPLES, runs=1)
    position = np.cumsum(0.2 * whole.position, axis=0)
    return replace(whole, position=position, tip_force=np.array([[0.3, 1.0, -2.0]]))


def stretches(seed: int):
    """Every sample alone, and a random cut of all of them."""
    cuts = np.sort(np.random.default_rng(seed).choice(np.arange(1, SAMPLES), 5, replace=False)).tolist()
    yield [slice(i, i + 1) for i in range(SAMPLES)]
    yield [slice(a, b) for a, b in zip([0, *cuts], [*cuts, SAMPLES], strict=True)]


def poses(whole: Motion) -> np.ndarray:
    """Return tool poses of the motion."""
    return arm_named("raven2_left").forward(np.concatenate([whole.position, whole.velocity], axis=-1))


def path_in(effect: PathEffect, whole: Motion, parts) -> np.ndarray:
    operator = effect.operator()
    return np.concatenate([operator(whole.position[part], cut(whole, part)) for part in parts])


def reading_in(effect: ReadingEffect, whole: Motion, parts) -> np.ndarray:
    operator, q = effect.operator(np.random.default_rng(5)), 30.0 * whole.position
    readings = Readings(q, q, q, q, poses(whole))
    seen = [operator(cut(readings, part), cut(whole, part)) for part in parts]
    return np.concatenate(
        [np.stack([r.measured_jp, r.external_jp, r.T_tracker_marker[..., :3, 3]]) for r in seen], axis=1
    )


def tip_in(effect: TipEffect, whole: Motion, parts) -> np.ndarray:
    T = poses(whole)
    return np.concatenate([effect.act(T[part], cut(whole, part)) for part in parts])


def loop_in(effect, whole: Motion, parts) -> np.ndarray:
    """Motors that follow the motion through the servo loop, one reference after the other."""
    path = moves(runs=1, seconds=SAMPLES / 100.0).q[:SAMPLES]
    loop, clock, zero = Loop(drive(), (1, 2, 3), (effect,)), Clock(1e-3, 1), np.zeros(path.shape)
    state = State(path[0].copy(), *(zero[0].copy() for _ in range(4)))
    load = 0.5 * whole.load
    done = []
    for part in parts:
        wanted = np.ascontiguousarray((path + 0.3)[part].swapaxes(0, 1))
        given = Reference(wanted, np.zeros(wanted.shape), zero[part], load[part], drive().motor_inertia)
        done.append(np.stack(loop.run(given, clock, state)))
    return np.concatenate(done, axis=1)


def answer(effect, whole, parts):
    """Return what an effect makes of a motion that is taken in stretches."""
    match effect:
        case PathEffect():
            return path_in(effect, whole, parts)
        case TipEffect():
            return tip_in(effect, whole, parts)
        case ReadingEffect():
            return reading_in(effect, whole, parts)
        case FrictionEffect() | TorqueEffect():
            return loop_in(effect, whole, parts)


LIVE = [e for e in ACTIVE if not isinstance(e, OF_THE_MACHINE)]
LIVE.append(CoulombFriction(1, torque=0.5, rest="elastic", bristle=100.0))  # which remembers how it was bent


@pytest.mark.parametrize("effect", LIVE, ids=lambda e: e.about.name)
def test_an_effect_taken_sample_by_sample_is_the_effect(effect):
    """Whatever an effect remembers, stretches of any length give what the whole recording gives, to rounding."""
    whole = moved()
    at_once = answer(effect, whole, [slice(0, SAMPLES)])
    for parts in stretches(1):
        np.testing.assert_allclose(answer(effect, whole, parts), at_once, rtol=1e-12, atol=1e-12)
    idle = next(e for e in NEUTRAL if e.about.name == effect.about.name and e.joint in ("all", effect.joint))
    assert np.abs(answer(idle, whole, parts) - at_once).max() > 1e-5


@pytest.mark.parametrize(("effect", "why"), EXCEPTIONS, ids=lambda value: getattr(value, "joint", ""))
def test_an_exception_is_one(effect, why):
    """What is listed as differing between live and recorded does differ, and does something either way."""
    whole = moved()
    at_once, (alone, _) = answer(effect, whole, [slice(0, SAMPLES)]), stretches(1)
    one_by_one = answer(effect, whole, alone)
    assert why
    assert np.abs(one_by_one - at_once).max() > 1e-6
    np.testing.assert_allclose(one_by_one.std(), at_once.std(), rtol=0.1)


def test_the_future_is_not_known():
    """An arm that would be seen before it moves cannot run live."""
    machine = weightless(effect_from_dict({"name": "delay", "joint": "all", "delay": -0.03}))
    with pytest.raises(DataError, match="before it moves"):
        LiveArm(machine, np.zeros(3))
    machine = weightless(effect_from_dict({"name": "command_delay", "joint": "all", "delay": -0.03}))
    with pytest.raises(DataError, match="cannot follow what is commanded"):
        LiveArm(machine, np.zeros(3))


@pytest.mark.parametrize("delay", [0.05, 0.0125])
def test_a_live_arm_follows_late_commands_late(delay):
    """Twelve and a half servo steps or fifty, in samples of any length: where an arm is that was commanded later."""
    plan = moves(runs=1, seconds=1.0)
    spline, machine = plan.spline(), raven()
    steps = np.arange(1, 1001) / machine.drive.rate_hz
    late = LiveArm(raven(effect_from_dict({"name": "command_delay", "joint": "all", "delay": delay})), plan.q[0, 0])
    later = LiveArm(machine, plan.q[0, 0])
    sent, delayed = spline(steps)[:, 0], spline(np.maximum(steps - delay, 0.0))[:, 0]
    for part in np.array_split(np.arange(len(steps)), 37):
        np.testing.assert_allclose(late.advance(sent[part]).q, later.advance(delayed[part]).q, atol=1e-6)


def test_a_delay_moves_what_is_seen_live_and_not_what_is_felt():
    """Live as recorded, the load belongs to where the arm is, not to where it is seen."""
    plan = moves(runs=1, seconds=1.0)
    paths = []
    for delay in (0.0, 0.05):
        live = LiveArm(raven(effect_from_dict({"name": "delay", "joint": "all", "delay": delay})), plan.q[0, 0])
        paths.append([live.advance(row[None]).motion.load[0, 0] for row in plan.q[:, 0]])
    np.testing.assert_array_equal(*paths)


def test_a_tracker_that_is_late_alone_is_so_live():
    plan = moves(runs=1, seconds=1.0)
    late, prompt = (LiveArm(raven(*effects), plan.q[0, 0]) for effects in ((Delay("tool", 0.05),), ()))
    pairs = [(late.advance(row[None]), prompt.advance(row[None])) for row in plan.q[:, 0]]
    for k in range(50, len(pairs)):
        np.testing.assert_array_equal(pairs[k][0].q, pairs[k][1].q)
        np.testing.assert_allclose(pairs[k][0].T_base_tip, pairs[k - 50][1].T_base_tip, atol=1e-9)


@pytest.mark.parametrize("block", [5, 20])
def test_live_and_recorded_machine_agree(block):
    """On the debridement machine, wrong by centimetres, live and recorded tool paths differ by a tenth of a mm."""
    machine = machine_of(preset("raven2_debridement"))
    plan = debridement_plan(arm_named(machine.arm), 2, machine.log_rate_hz, np.random.default_rng(3))
    recorded = run(machine, plan, 4)
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


def test_a_live_arm_that_is_held_up_where_it_is_moves_as_without_gravity():
    """So a recorded one does: gravity and what holds the arm are taken at the same place."""
    held, plan = raven(drive=drive("gravity-measured")), moves(runs=1, seconds=3.0)
    weightless = replace(held, body=replace(held.body, gravity=np.zeros(3)), drive=drive())
    spline, arms = plan.spline(), [LiveArm(machine, plan.q[0, 0], block=1) for machine in (held, weightless)]
    for k in range(1, len(plan.q)):
        desired = spline(np.arange(1, 11) * arms[0].step + (k - 1) / plan.rate_hz)[:, 0]
        with_gravity, without = (live.advance(desired).motion.position for live in arms)
        np.testing.assert_allclose(with_gravity, without, atol=5e-6)  # loads are those of a block before
