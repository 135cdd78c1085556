from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_machines import INFINITE, drive, motion, moves, raven

from gpcorrect.errors import DataError
from gpcorrect.sim import EFFECTS, effect_from_dict, simulate
from gpcorrect.sim import effects as kinds
from gpcorrect.sim.effect_paths import joint_path
from gpcorrect.sim.effects import PathEffect, in_order

NEUTRAL = (
    kinds.HomingOffset(1, 0.0),
    kinds.TransmissionRatio(1, 0.0),
    kinds.CableCoupling(2, 1, 0.0),
    kinds.CableCoupling(2, 1, 0.0, drag=1.0, drag_radius=0.0),
    kinds.PulleyEccentricity(1, 0.0, 10.0, 0.3),
    kinds.RegistrationError("base", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    kinds.DhError(2, 0.0, 0.0, 0.0, 0.0),
    kinds.DhError("tool", 0.0, 0.0, 0.0, 0.0),
    kinds.CableStretch(2, INFINITE),
    kinds.NonlinearStretch(2, INFINITE, 1e6),
    kinds.LengthDependentStiffness(2, 3, INFINITE, 0.3),
    kinds.GravitySag(2, INFINITE),
    kinds.Payload("all", 0.0),
    kinds.Payload("all", 0.0, 0.02, -0.01, 0.03, place="beside"),
    kinds.ShaftBending("tool", INFINITE),
    kinds.RcmShift("base", INFINITE),
    kinds.Backlash(3, 0.0),
    kinds.CoulombFriction(1, torque=0.0),
    kinds.ViscousFriction(1, damping=0.0),
    kinds.StribeckFriction(1, torque=0.0, static_torque=0.0, speed=0.1),
    kinds.CapstanFriction(1, wrap=0.0),
    kinds.PositionDependentFriction(1, torque=0.0, swing=0.0, waves=5.0, phase=0.0),
    kinds.Hysteresis(3, 0.0, 2.0),
    kinds.Hysteresis(3, 0.0, 2.0, law="plays"),
    kinds.Creep(2, 0.0, 5.0),
    kinds.Drift(1, 0.0),
    kinds.Delay("all", 0.0),
    kinds.CableSlip(1, 0.0, 0.5),
    kinds.TorqueSaturation(2, INFINITE),
    kinds.JointStop(1, 0.0, 0.5),
    kinds.Resonance(1, INFINITE, 0.1),
    kinds.EncoderQuantisation(1, 0.0, lost=0.5),
    kinds.NoiseChange(1, 0.0, tail=3.0),
    kinds.FeedforwardError(2, 0.0, "gravity"),
    kinds.GainError(2, 0.0, 0.0),
    kinds.SpeedNoise(1, 0.0),
    kinds.CommandDelay("all", 0.0),
    kinds.InertiaError(2, 0.0),
    kinds.LinkMassError(2, 0.0),
    kinds.CentreOfMassError(2),
    kinds.GravityError("base"),
    kinds.JointSpring(1, 0.0, 0.0),
    kinds.MissingFriction(1, 0.0),
    kinds.MissingFriction(1, 0.0, "viscous"),
    kinds.VelocityFilter("all", 0.0),
    kinds.IntegralAction("all", 0.0),
    kinds.MotorConstantError(2, 0.0),
    kinds.LoadedBacklash(2, 0.0),
    kinds.BelievedPayload("all", 0.0),
)
ACTIVE = (
    kinds.HomingOffset(1, 0.02),
    kinds.TransmissionRatio(1, 0.03),
    kinds.CableCoupling(2, 1, 0.1, drag=0.3, drag_radius=0.02),
    kinds.PulleyEccentricity(1, 0.01, 10.0, 0.3),
    kinds.RegistrationError("base", 0.001, -0.002, 0.0005, 0.01, 0.02, -0.01, 0.01),
    kinds.DhError(2, 0.001, 0.01, -0.001, 0.005),
    kinds.CableStretch(2, 120.0),
    kinds.NonlinearStretch(2, 120.0, 1e6),
    kinds.LengthDependentStiffness(2, 3, 50.0, 0.3),
    kinds.GravitySag(2, 200.0),
    kinds.Payload("all", 0.3, 0.02, -0.01, 0.03, place="beside"),
    kinds.ShaftBending("tool", 5.0),
    kinds.RcmShift("base", 1000.0),
    kinds.Backlash(3, 0.001),
    kinds.CoulombFriction(1, torque=0.5),
    kinds.ViscousFriction(1, damping=1.0),
    kinds.StribeckFriction(1, torque=0.5, static_torque=0.8, speed=0.05),
    kinds.CapstanFriction(1, wrap=0.3),
    kinds.PositionDependentFriction(1, torque=0.5, swing=0.3, waves=5.0, phase=0.4),
    kinds.Hysteresis(3, 0.001, 1.5),
    kinds.Creep(2, 0.01, 0.3),
    kinds.Drift(1, 1e-4),
    kinds.Delay("all", 0.03),
    kinds.CableSlip(1, 0.01, 0.5),
    kinds.TorqueSaturation(2, 0.3),
    kinds.JointStop(1, 200.0, 0.5),
    kinds.Resonance(1, 6.0, 0.1),
    kinds.EncoderQuantisation(1, 0.005, lost=0.02),
    kinds.NoiseChange(1, 0.01, tail=3.0),
    kinds.FeedforwardError(2, 0.3, "gravity"),
    kinds.GainError(2, 0.2, -0.1),
    kinds.SpeedNoise(1, 1e-3),
    kinds.CommandDelay("all", 0.02),
    kinds.InertiaError(2, 0.1),
    kinds.CentreOfMassError(2, 0.02, -0.01, 0.03),
    kinds.JointSpring(1, 4.0, 0.3),
    kinds.MissingFriction(1, 0.4),
    kinds.LinkMassError(2, 0.3),
    kinds.GravityError("base", 0.5, -0.3, 0.1),
    kinds.VelocityFilter("all", 0.005),
    kinds.IntegralAction("all", 2.0),
    kinds.MotorConstantError(2, -0.1),
    kinds.LoadedBacklash(2, 0.01),
    kinds.BelievedPayload("all", 0.3),
)
ids = [e.about.name for e in ACTIVE]
PATH_EFFECTS = [e for e in ACTIVE if isinstance(e, kinds.PathEffect) and e.joint != "all"]
NUMBERS = [(e, p) for e in ACTIVE for p in e.about.parameters]
neutral_ids = [f"{e.about.name}-{e.joint}" for e in NEUTRAL]


def recorded(*effects):
    """Return a short recording of the loaded arm, held up, whose model states friction, as named arrays."""
    friction, damping = np.array([0.2, 0.2, 1.0]), np.array([0.1, 0.1, 2.0])
    stated = replace(drive(), friction=friction, damping=damping, feedforward="gravity")
    log = simulate(raven(*effects, drive=stated), moves(runs=1, seconds=2.0, payload=0.2))
    arrays = {name: getattr(log, name) for name in log.signals if not name.endswith("_cp")}
    return arrays | {"tracker": log.tracker_cp.position, "quaternion": log.tracker_cp.quaternion}


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_inertia_of_half_a_step_of_damping_is_a_matter_of_steps(sign):
    """Of a controller that differentiates its encoder, or brakes implicitly; a fit knows it to a tenth or so."""
    steps = drive().kd[1] / (2.0 * drive().rate_hz)
    assert kinds.InertiaError(2, sign * 1.05 * steps).is_a_matter_of_steps(drive(), (1, 2, 3))
    assert not kinds.InertiaError(2, sign * 1.3 * steps).is_a_matter_of_steps(drive(), (1, 2, 3))


def test_a_filter_is_a_matter_of_steps_as_far_as_a_joints_damping_is():
    """A step of kd, and a step of viscous damping, over kd: what is damped by the speed before a step."""
    resisted = replace(drive(), damping=np.array([0.0, 4.0 * drive().kd[1], 0.0]))
    h = 1.0 / resisted.rate_hz
    for joint, most in (("all", h), (1, h), (2, 5.0 * h)):
        assert kinds.VelocityFilter(joint, 1.1 * most).is_a_matter_of_steps(resisted, (1, 2, 3))
        assert not kinds.VelocityFilter(joint, 1.3 * most).is_a_matter_of_steps(resisted, (1, 2, 3))


def test_every_effect_is_tried():
    """Each effect has numbers with which it does something, in the catalogue's order."""
    assert ids == list(EFFECTS)


@pytest.mark.parametrize(("effect", "parameter"), NUMBERS, ids=[f"{e.about.name}-{p.name}" for e, p in NUMBERS])
def test_a_number_without_end_is_refused_or_leaves_a_recording_of_numbers(effect, parameter):
    """Infinite offsets were taken in silence, and the recording was NaN."""
    if not parameter.may_be_infinite:
        with pytest.raises(DataError, match=f"{parameter.name} .* must be a finite number"):
            replace(effect, **{parameter.name: INFINITE})
        return
    for name, signal in recorded(replace(effect, **{parameter.name: INFINITE})).items():
        assert np.isfinite(signal).all(), name


@given(st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=4))
def test_offsets_of_sessions_survive_the_round_trip(offsets):
    effect = kinds.HomingOffset(2, tuple(offsets))
    assert effect_from_dict(effect.to_dict()) == effect


@pytest.fixture(scope="module")
def bare():
    return recorded()


@pytest.mark.parametrize("effect", NEUTRAL, ids=neutral_ids)
def test_neutral_parameters_do_nothing(effect, bare):
    """At its identity an effect leaves every signal of the recording as it is, to rounding."""
    neutral = recorded(effect)
    for name, signal in bare.items():
        np.testing.assert_allclose(neutral[name], signal, atol=1e-8 if name == "measured_jf" else 1e-12, err_msg=name)


@pytest.mark.parametrize("effect", ACTIVE, ids=ids)
def test_active_parameters_do_something(effect, bare):
    """Away from its identity an effect shows, in a signal that it says it needs."""
    active = recorded(effect)
    needed = {word for need in effect.about.needs for word in need.split("|")}
    signals = {"tracker" if name == "tracker_cp" else name for name in needed} & set(bare)
    assert any(np.abs(active[name] - bare[name]).max() > 1e-5 for name in signals)


@given(st.permutations(ACTIVE))
def test_order_of_writing_does_not_matter(effects):
    """However effects are listed, they act in the order of stage, catalogue and joint."""
    assert in_order(effects) == kinds.in_order(ACTIVE)
    assert [e.stage for e in in_order(effects)] == sorted(e.stage for e in ACTIVE)


@pytest.mark.parametrize("effect", PATH_EFFECTS, ids=lambda e: e.about.name)
def test_only_the_named_joint_moves_and_the_input_is_kept(effect):
    """A path effect changes its own column, and not the caller's array."""
    state = motion()
    before = state.position.copy()
    after = effect.act(state.position, state)
    others = [j for j in range(3) if j != effect.joint - 1]
    np.testing.assert_array_equal(after[..., others], before[..., others])
    np.testing.assert_array_equal(state.position, before)
    assert np.abs(after - before).max() > 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"name": "backlash", "joint": 1, "radius": 0.1, "width": 2.0, "gap": 1}, "gap, width"),
        ({"name": "backlash", "joint": 1}, "lacks radius"),
        ({"name": "backlash", "joint": 0, "radius": 0.1}, "joint must be"),
        ({"name": "backlash", "joint": 1, "radius": -0.1}, "radius .* >= 0"),
        ({"name": "drift", "joint": 1, "rate": float("nan")}, "rate"),
        ({"name": "backlash", "joint": 1, "radius": "wide"}, "radius"),
        ({"name": "cable_coupling", "joint": 2, "source": 2, "coefficient": 0.1}, "other than 2"),
        ({"name": "coulomb_friction", "joint": 2, "torque": 0.1, "side": "left"}, "side"),
        ({"name": "stribeck_friction", "joint": 1, "torque": 0.1}, "lacks static_torque, speed"),
        ({"name": "hysteresis", "joint": 1, "radius": 0.1, "sharpness": 0.0}, "sharpness"),
        ({"name": "resonance", "joint": 1, "frequency": 0.0, "damping_ratio": 0.1}, "frequency"),
        ({"name": "joint_stop", "joint": 1, "stiffness": 1.0, "limit": 0.1, "end": "left"}, "end"),
        ({"name": "cable_slip", "joint": 1, "step": 0.1, "instant": 1.0, "session": -1}, "session"),
        ({"name": "noise_change", "joint": 1, "std": 0.1, "tail": 1.5}, "tail"),
        ({"name": "encoder_quantisation", "joint": 1, "step": 0.1, "lost": 1.5}, "lost"),
        ({"name": "missing_friction", "joint": 1, "part": 1.4}, "part .* <= 1"),
        ({"name": "delay", "joint": 2, "delay": 0.1}, 'joint must be "all" or "tool"'),
        ({"name": "backlash", "joint": "all", "radius": 0.1}, "the number of a joint"),
        ({"name": "shaft_bending", "joint": "base", "rigidity": 10.0}, 'joint must be "tool"'),
        ({"joint": 1}, "None"),
    ],
)
def test_bad_descriptions_are_refused(values, message):
    """What an effect does not know, lacks or cannot be is named."""
    with pytest.raises(DataError, match=message):
        effect_from_dict(values)


def test_an_effect_on_a_joint_the_machine_lacks_is_refused():
    with pytest.raises(DataError, match="joint 5"):
        raven(kinds.Backlash(5, 0.01))


def test_effects_are_values():
    """Nobody can change an effect that a model holds."""
    with pytest.raises(FrozenInstanceError):
        kinds.Backlash(1, 0.1).radius = 0.2


class Kept(dict):
    """Columns by their keys, and how many were computed."""

    def keep(self, key, value):
        """Remember a column."""
        return self.setdefault(key, value)


@pytest.mark.parametrize("seed", range(5))
def test_what_is_known_of_other_sets_changes_no_path(seed):
    """Sets that differ in some effects, and two loads: bit for bit the path that is computed afresh."""
    rng, known = np.random.default_rng(seed), Kept()
    for k in range(20):
        effects = in_order([e for e in ACTIVE if isinstance(e, PathEffect) and rng.random() < 0.7])
        effects = [
            replace(e, offset=rng.choice([0.01, 0.02])) if isinstance(e, kinds.HomingOffset) else e for e in effects
        ]
        heavy = replace(motion(), load=motion().load * (1 + k % 2))
        np.testing.assert_array_equal(joint_path(effects, heavy, known, k % 2), joint_path(effects, heavy))


def test_of_sets_that_differ_in_one_effect_other_joints_are_known():
    """Of a backlash of joint 3 behind a coupling to joint 1: another offset of joint 2 computes one column more."""
    known = Kept()
    rest = [kinds.HomingOffset(1, 0.02), kinds.CableCoupling(3, 1, 0.1), kinds.Backlash(3, 0.01)]
    for offset, computed in ((0.01, 4), (0.02, 5)):
        joint_path(in_order([*rest, kinds.HomingOffset(2, offset)]), motion(), known)
        assert len(known) == computed
    joint_path(in_order([kinds.HomingOffset(1, 0.03), *rest[1:]]), motion(), known)
    assert len(known) == 5 + 3  # what it drives comes anew
