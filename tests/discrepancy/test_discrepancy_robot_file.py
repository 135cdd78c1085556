from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from robot_files import write_mjcf, write_urdf

from gpcorrect.discrepancy import advice, find_discrepancy
from gpcorrect.discrepancy.naming.posterior import Level
from gpcorrect.discrepancy.outcome.sentences import next_step, verdict_sentences
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.needs import split_by_needs
from gpcorrect.errors import DataError
from gpcorrect.sim import effect_from_dict, joint_motion_log, machine_of, model_from_dict
from gpcorrect.sim.effects import Run
from gpcorrect.sim.effects.geometry import DhError
from gpcorrect.sim.settings import Noise

pytest.importorskip("mujoco", reason="robot files need mujoco: pip install 'gpcorrect[mujoco]'")

LOAD = {"name": "payload", "joint": "all", "mass": 0.8}
KEYS = {"robot": "small.xml", "tool": "tip", "joints": ["pan", "lift"]}


@pytest.fixture
def nominal(tmp_path):
    write_mjcf(tmp_path)
    return model_from_dict(KEYS, folder=tmp_path)


def recorded(model, *effects, payloads=()):
    """Record the model with further effects, by encoders with 0.1 mrad of noise."""
    noisy = model.model_copy(update={"noise": Noise(external_jp_white=(1e-4, 1e-4))})
    true = noisy.with_effects(*map(effect_from_dict, effects))
    return joint_motion_log(true, 6, 5.0, seed=1, payloads=payloads)


def encoded(model, *effects):
    """Record the same without a tracker: what motors and links do shows at the encoders, in half the time."""
    return replace(recorded(model, *effects), tracker_cp=None)


@pytest.mark.slow
def test_nothing_is_missing_only_behind_the_motors_where_no_servo_is_known(tmp_path):
    """A load that the encoders on the motors answer for is in no channel; the verdict and the next step say so."""
    model = model_from_dict({"robot": write_urdf(tmp_path).name}, folder=tmp_path)
    true = model.model_copy(update={"noise": Noise(external_jp_white=(1e-4, 1e-4, 1e-5))})
    log = joint_motion_log(true.with_effects(effect_from_dict(LOAD)), 6, 5.0, seed=1)
    found = find_discrepancy(model, log)
    assert found.level == Level.NONE
    assert found.provenance.servo_unseen
    assert verdict_sentences(found)[0].startswith("Nothing is missing behind the motors")
    assert next_step(found).startswith("stop looking behind the motors: ")
    assert found.to_report()["provenance"]["servo_unseen"]


@pytest.mark.slow
def test_friction_that_a_robot_file_lacks_is_named(nominal):
    """With the servo gains of the file the loop is simulated, and dry friction of one joint is found in it."""
    log = recorded(nominal, {"name": "coulomb_friction", "joint": 1, "torque": 2.0})
    result = find_discrepancy(nominal, log)
    (effect,) = result.effects
    assert (effect.name, effect.joint) == ("coulomb_friction", 1)
    assert effect.parameters["torque"].value == pytest.approx(2.0, rel=0.05)
    assert not result.provenance.servo_unseen


@pytest.mark.slow
def test_a_centre_of_mass_that_is_off_along_one_axis_is_one_number(nominal):
    """Its idle ones cost nothing: what an arm carries too much, which has one number in all, does not lead for that."""
    found = find_discrepancy(nominal, encoded(nominal, {"name": "centre_of_mass_error", "joint": 2, "x": 0.01}))
    (effect,) = found.effects
    assert (effect.name, effect.joint) == ("centre_of_mass_error", 2)
    assert effect.probability > 0.9
    low, high = effect.parameters["x"].ci95
    assert low < 0.01 < high
    assert (effect.parameters["y"].value, effect.parameters["z"].value) == (0.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "hidden",
    [
        {"name": "link_mass_error", "joint": 2, "mass": 0.5},
        {"name": "centre_of_mass_error", "joint": 2, "x": 0.03, "y": 0.02},
        {"name": "gravity_error", "joint": "base", "x": 0.5, "y": -0.3},
        {"name": "joint_spring", "joint": 2, "stiffness": 12.0, "push": 3.0},
        {"name": "joint_spring", "joint": 1, "stiffness": 0.0, "push": 2.0},
        {"name": "payload", "joint": "all", "mass": -0.3},
        {"name": "command_delay", "joint": 1, "delay": 0.004},
        {"name": "coulomb_friction", "joint": 1, "torque": 3.0, "onset": 0.03, "rest": "soft", "side": "motor"},
        {
            "name": "stribeck_friction",
            "joint": 1,
            "torque": 3.0,
            "static_torque": 5.0,
            "speed": 0.1,
            "rest": "soft",
            "onset": 0.01,
        },
        {"name": "missing_friction", "joint": 2, "part": 0.6, "term": "dry"},
    ],
    ids=[
        "heavy link",
        "centre of mass",
        "tilted gravity",
        "spring",
        "constant pull",
        "light tool",
        "one late command",
        "soft friction",
        "soft friction that falls",
        "less friction",
    ],
)
def test_what_a_robot_file_says_wrongly_has_its_own_name(nominal, hidden):
    """And not that of what acts like it on the motors: a fed-forward term, viscous friction, another link's mass."""
    result = find_discrepancy(nominal, encoded(nominal, hidden))
    (effect,) = result.effects
    assert (result.level, effect.name, effect.joint) == ("EXACT", hidden["name"], hidden["joint"])
    for field, value in hidden.items():
        if isinstance(value, float):
            assert effect.parameters[field].value == pytest.approx(value, rel=0.1, abs=0.0 if value else 0.1)
    for axis in {"x", "y", "z"} & set(effect.parameters) - set(hidden):  # what the data do not ask for is nothing
        low, high = effect.parameters[axis].ci95
        assert effect.parameters[axis].value == 0.0
        assert low < 0.0 < high


PARALLEL = """<mujoco><compiler angle="radian"/><worldbody>
<body pos="0 0 0.1"><inertial pos="0 0 0.02" mass="3" diaginertia="0.02 0.02 0.02"/>
 <joint name="pan" axis="0 0 1" range="-2.5 2.5" armature="1"/>
<body pos="0 0.12 0"><inertial pos="0.2 0 0" mass="4" diaginertia="0.02 0.2 0.2"/>
 <joint name="lift" axis="0 1 0" range="-2 2" armature="1"/>
<body pos="0.42 -0.1 0"><inertial pos="0.2 0 0" mass="2" diaginertia="0.01 0.1 0.1"/>
 <joint name="elbow" axis="0 1 0" range="-2 2" armature="0.5"/>
<body pos="0.39 0 0"><inertial pos="0 0.05 0" mass="1" diaginertia="0.01 0.01 0.01"/>
 <joint name="wrist" axis="0 1 0" range="-2 2" armature="0.2"/><site name="tip" pos="0.05 0.1 0.1"/>
</body></body></body></body></worldbody><actuator><position joint="pan" kp="6000" kv="200"/>
<position joint="lift" kp="6000" kv="200"/><position joint="elbow" kp="3000" kv="100"/>
<position joint="wrist" kp="600" kv="20"/></actuator></mujoco>"""


@pytest.mark.slow
def test_axes_that_ought_to_be_parallel_are_found_askew(tmp_path):
    """By two milliradians between the second and the third axis, a third of the noise; a table has no number for it."""
    (tmp_path / "arm.xml").write_text(PARALLEL, encoding="utf-8")
    noise = {"external_jp_white": [1e-4] * 4, "tracker_white": 1e-4, "tracker_rotation_white": 1e-3}
    nominal = model_from_dict({"robot": "arm.xml", "tool": "tip", "noise": noise}, folder=tmp_path)
    row = {"name": "dh_error", "joint": 3, **dict.fromkeys(("a", "alpha", "d", "theta"), 0.0)}
    askew = effect_from_dict(row | {"beta": 0.002, "form": "parallel"})
    result = find_discrepancy(nominal, joint_motion_log(nominal.with_effects(askew), 8, 8.0, seed=3))
    (effect,) = result.effects
    assert (result.level, effect.name, effect.joint) == ("EXACT", "dh_error", 3)
    assert effect.parameters["beta"].value == pytest.approx(0.002, rel=0.1)
    assert [effect.parameters[name].value for name in ("a", "alpha", "d", "theta")] == [0.0] * 4


def nearly_parallel(folder):
    """Return the arm whose elbow is askew by 50 milliradians, as no design is, but a calibrated file may be."""
    askew = PARALLEL.replace('name="elbow" axis="0 1 0"', 'name="elbow" axis="0 1 0.05"')
    (folder / "arm.xml").write_text(askew, encoding="utf-8")
    noise = {"external_jp_white": [1e-4] * 4, "tracker_white": 1e-4, "tracker_rotation_white": 1e-3}
    return model_from_dict({"robot": "arm.xml", "tool": "tip", "noise": noise}, folder=folder)


def test_a_link_between_axes_that_are_nearly_parallel_has_a_length(tmp_path):
    """Their common normal lies across the link, and what makes that longer was no one row's number."""
    chain = machine_of(nearly_parallel(tmp_path)).body.chain
    longer = DhError(3, 1e-3, 0.0, 0.0, 0.0)
    moved = longer.act(chain).forward(np.zeros(4)) - chain.forward(np.zeros(4))
    np.testing.assert_allclose(moved[:3, 3], [1e-3, 0.0, 0.0], atol=2e-5)
    np.testing.assert_allclose(moved[:3, :3], 0.0, atol=1e-12)
    replace(longer, beta=0.001, form="parallel").check(chain)


@pytest.mark.slow
def test_a_link_between_axes_that_are_nearly_parallel_is_found_too_long(tmp_path):
    """A tracker alone gave 0.25 mm to a ratio of one joint and a coupling to the next, both EXACT."""
    nominal, longer = nearly_parallel(tmp_path), DhError(3, 4e-4, 0.0, 0.0, 0.0)
    log = replace(joint_motion_log(nominal.with_effects(longer), 8, 8.0, seed=3), external_jp=None)
    result = find_discrepancy(nominal, log)
    (effect,) = result.effects
    assert (result.level, effect.name, effect.joint) == ("EXACT", "dh_error", 3)
    low, high = effect.parameters["a"].ci95
    assert low < 4e-4 < high


@pytest.mark.slow
def test_damping_and_the_gain_by_which_a_servo_brakes_are_told_as_a_set(nominal):
    """They are one equation, and no recording tells them apart."""
    (effect,) = find_discrepancy(
        nominal, encoded(nominal, {"name": "viscous_friction", "joint": 1, "damping": 6.0})
    ).effects
    assert effect.level == "SET"
    assert {effect.name, *(r.name for r in effect.rivals)} == {"viscous_friction", "gain_error"}


def test_an_advised_run_with_lower_gains_lowers_those_that_stand_in_the_robot_file_alone(nominal):
    """A friction holds the joint off by twice as much at half the gain; both halves of the run were simulated alike."""
    log = recorded(nominal)
    scene = build_scene(log, nominal, np.ones(len(log), dtype=np.bool_))
    own = next(c for c in all_candidates(scene) if (c.name, c.joint) == ("coulomb_friction", 1))
    noises = tuple(ChannelNoise(1e-4, 0.0, 0.1) for _ in scene.channels)
    comparison = advice.Comparison(scene, (), FittedEffect(own, np.array(own.start)), (), noises)
    (planned,) = advice.planned_runs(advice._site(scene, 1), [Run.GAIN_CHANGE])
    assert [gain for _, gain in planned.plans] == [1.0, advice.GAIN]
    views = [advice._view(comparison, planned, plan, gain) for plan, gain in planned.plans]
    whole, half = (advice._evidence(comparison, [view], ()) for view in views)
    assert half == pytest.approx(whole / advice.GAIN**2, rel=0.2)


def test_joints_in_degrees_are_refused_by_the_range_of_the_robot_file(nominal):
    """Where all signals are in degrees no ratio shows it; the file's range does."""
    log = recorded(nominal)
    degrees = {name: np.rad2deg(getattr(log, name)) for name in ("setpoint_jp", "measured_jp", "external_jp")}
    with pytest.raises(DataError, match=r"measured_jp: joint 1 goes .* not in the same unit.*0\.0174533"):
        build_scene(replace(log, **degrees), nominal, np.ones(len(log), dtype=np.bool_))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda q: q[:, ::-1], "joints 1 and 2 are exchanged"),
        (lambda q: q * [1.0, -1.0], "joint 2 moves the other way"),
        (lambda q: q, ""),
    ],
)
def test_joints_that_are_mixed_up_in_all_signals_are_known_by_what_their_servo_carries(nominal, change, said):
    """As ROS lists them, by the alphabet: nothing refused it, and no answer came in five minutes."""
    log = recorded(nominal, {"name": "coulomb_friction", "joint": 1, "torque": 2.0})
    names = ("setpoint_jp", "measured_jp", "external_jp")
    mixed = replace(log, measured_jv=None, measured_jf=None, **{name: change(getattr(log, name)) for name in names})
    with pytest.raises(DataError, match=said) if said else nullcontext():
        build_scene(mixed, nominal, np.ones(len(log), dtype=np.bool_))


@pytest.mark.parametrize("signal", ["measured_jp", "setpoint_jp"])
def test_a_joint_without_any_value_is_refused_by_its_number(nominal, signal):
    """What was said of it was that the nearest rotation of a matrix with NaN does not exist."""
    log = recorded(nominal)
    holed = replace(log, **{signal: getattr(log, signal) * [1.0, np.nan]})
    with pytest.raises(DataError, match=f"{signal}: joint 2 has no value"):
        build_scene(holed, nominal, np.ones(len(log), dtype=np.bool_))


def test_an_arm_that_never_moves_is_refused(nominal):
    """One pose fits any number of effects; one joint that moves is enough."""
    log = recorded(nominal)
    every = np.ones(len(log), dtype=np.bool_)
    still = np.repeat(log.measured_jp[:1], len(log), axis=0)
    with pytest.raises(DataError, match="no joint moves by more than"):
        build_scene(replace(log, measured_jp=still), nominal, every)
    still[:, 1] = log.measured_jp[:, 1]
    build_scene(replace(log, measured_jp=still), nominal, every)


def test_columns_beyond_the_arm_are_told(nominal):
    """A gripper behind the arm's joints is left aside, and the report says that the first columns were taken."""
    log = recorded(nominal)
    every = np.ones(len(log), dtype=np.bool_)
    plain = build_scene(log, nominal, every)
    dof = plain.machine.body.chain.dof
    columns = np.zeros((len(log), dof + 1))
    columns[:, plain.machine.body.columns] = log.measured_jp
    built = build_scene(replace(log, measured_jp=columns), nominal, every)
    np.testing.assert_array_equal(built.residual(), plain.residual())
    said = f"measured_jp has {dof + 1} columns for an arm of {dof} joints: the first are taken for them"
    assert [r for r in built.remarks if r not in plain.remarks] == [said]


def test_an_arm_without_a_remote_centre_has_none_of_its_effects(nominal):
    """Bending shaft and giving remote centre are no candidates, and the report says why."""
    log = recorded(nominal, payloads=(0.2, 0.5))
    log = replace(log, external_jp=None)
    scene = build_scene(log, nominal, np.ones(len(log), dtype=np.bool_))
    candidates, lacks = split_by_needs(all_candidates(scene), scene, log)
    names = {"shaft_bending", "rcm_shift"}
    assert not names & {c.name for c in candidates}
    assert {lack.why for lack in lacks if lack.effect in names} == {"the arm has no remote centre of motion"}
