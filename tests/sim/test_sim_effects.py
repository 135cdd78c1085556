from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_machines import INFINITE, motion, moves, raven

from gpcorrect.errors import DataError
from gpcorrect.sim import EFFECTS, effect_from_dict, run
from gpcorrect.sim.effects import (
    Backlash,
    CableCoupling,
    CableStretch,
    CoulombFriction,
    Drift,
    Family,
    GravitySag,
    HomingOffset,
    PathEffect,
    TransmissionRatio,
    ViscousFriction,
    in_order,
)

NEUTRAL = (
    HomingOffset(1, 0.0),
    TransmissionRatio(1, 0.0),
    CableCoupling(2, 1, 0.0),
    CableStretch(2, INFINITE),
    GravitySag(2, INFINITE),
    Backlash(3, 0.0),
    CoulombFriction(1, torque=0.0),
    ViscousFriction(1, damping=0.0),
    Drift(1, 0.0),
)
ACTIVE = (
    HomingOffset(1, 0.02),
    TransmissionRatio(1, 0.03),
    CableCoupling(2, 1, 0.1),
    CableStretch(2, 120.0),
    GravitySag(2, 200.0),
    Backlash(3, 0.001),
    CoulombFriction(1, torque=0.5),
    ViscousFriction(1, damping=1.0),
    Drift(1, 1e-4),
)
# From the catalogue's table: slot and class of each name.
TABLE = {
    "homing_offset": ("S", Family.GEOMETRY),
    "transmission_ratio": ("T", Family.GEOMETRY),
    "cable_coupling": ("T", Family.GEOMETRY),
    "cable_stretch": ("T", Family.COMPLIANCE),
    "gravity_sag": ("L", Family.COMPLIANCE),
    "backlash": ("T", Family.REVERSAL),
    "coulomb_friction": ("M", Family.REVERSAL),
    "viscous_friction": ("M", Family.REVERSAL),
    "drift": ("S", Family.TIME),
}
ids = [type(e).__name__ for e in ACTIVE]


def test_the_catalogue_says_what_the_table_says():
    """Every registered effect carries the canonical name, slot and class of the catalogue."""
    assert {name: (kind.about.slot, kind.about.family) for name, kind in EFFECTS.items()} == TABLE


@pytest.mark.parametrize("kind", EFFECTS.values(), ids=EFFECTS)
def test_every_parameter_is_described(kind):
    """Each described parameter is a field, has a range around its prior, and what it does when neutral is known."""
    names = {f.name for f in fields(kind)}
    assert kind.about.parameters
    for parameter in kind.about.parameters:
        assert parameter.name in names
        for joint_type in "RP":
            scale = parameter.range(joint_type)
            prior = parameter.prior(joint_type)
            assert scale.unit
            assert scale.low <= scale.typical <= scale.high
            assert scale.low <= prior.median() <= scale.high
            assert prior.cdf(scale.high) - prior.cdf(scale.low) > 0.95


@pytest.mark.parametrize("kind", EFFECTS.values(), ids=EFFECTS)
def test_every_effect_says_what_separates_it(kind):
    about = kind.about
    assert about.needs
    assert about.neighbours
    assert about.separating_runs
    assert about.equation
    assert about.source
    assert all(n.name != about.name and n.separated_by for n in about.neighbours)


@pytest.mark.parametrize("effect", ACTIVE, ids=ids)
def test_dict_round_trip(effect):
    """Written down and read back, an effect is the same."""
    assert effect_from_dict(effect.to_dict()) == effect


@given(st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=4))
def test_offsets_of_sessions_survive_the_round_trip(offsets):
    effect = HomingOffset(2, tuple(offsets))
    assert effect_from_dict(effect.to_dict()) == effect


@pytest.mark.parametrize("effect", NEUTRAL, ids=ids)
def test_neutral_parameters_do_nothing(effect):
    """At its identity an effect leaves the whole machine's motion as it is, to rounding."""
    plan = moves(runs=1, seconds=2.0)
    bare, neutral = run(raven(), plan), run(raven(effect), plan)
    np.testing.assert_allclose(neutral.q, bare.q, atol=1e-12)
    np.testing.assert_allclose(neutral.torque, bare.torque, atol=1e-9)


@pytest.mark.parametrize("effect", ACTIVE, ids=ids)
def test_active_parameters_do_something(effect):
    """Away from its identity an effect moves its own joint."""
    plan = moves(runs=1, seconds=2.0)
    bare, active = run(raven(), plan), run(raven(effect), plan)
    assert np.abs(active.q - bare.q)[..., effect.joint - 1].max() > 1e-5


@pytest.mark.parametrize("effect", ACTIVE, ids=ids)
def test_an_effect_can_be_taken_out_again(effect):
    """A machine with an effect put in and taken out is the machine before."""
    plan = moves(runs=1, seconds=1.0)
    machine = raven()
    back = machine.with_effects(effect).with_effects()
    np.testing.assert_array_equal(run(back, plan).q, run(machine, plan).q)


@given(st.permutations(ACTIVE))
def test_order_of_writing_does_not_matter(effects):
    """However effects are listed, they act in the order of stage, catalogue and joint."""
    assert in_order(effects) == in_order(ACTIVE)


@pytest.mark.parametrize("effect", [e for e in ACTIVE if isinstance(e, PathEffect)], ids=lambda e: e.about.name)
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
        ({"name": "cable_strech", "joint": 1}, "cable_strech"),
        ({"name": "backlash", "joint": 1, "radius": 0.1, "width": 2.0, "gap": 1}, "gap, width"),
        ({"name": "backlash", "joint": 1}, "lacks radius"),
        ({"name": "backlash", "joint": 0, "radius": 0.1}, "joint must be"),
        ({"name": "backlash", "joint": 1, "radius": -0.1}, "radius .* >= 0"),
        ({"name": "drift", "joint": 1, "rate": float("nan")}, "rate"),
        ({"name": "backlash", "joint": 1, "radius": "wide"}, "radius"),
        ({"name": "cable_coupling", "joint": 2, "source": 2, "coefficient": 0.1}, "other than 2"),
        ({"name": "coulomb_friction", "joint": 2, "torque": 0.1, "side": "left"}, "side"),
        ({"joint": 1}, "None"),
    ],
)
def test_bad_descriptions_are_refused(values, message):
    """What an effect does not know, lacks or cannot be is named."""
    with pytest.raises(DataError, match=message):
        effect_from_dict(values)


def test_an_effect_on_a_joint_the_machine_lacks_is_refused():
    with pytest.raises(DataError, match="joint 5"):
        raven(Backlash(5, 0.01))


def test_effects_are_values():
    """Nobody can change an effect that a model holds."""
    with pytest.raises(FrozenInstanceError):
        Backlash(1, 0.1).radius = 0.2
