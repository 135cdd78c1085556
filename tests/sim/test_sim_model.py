import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpcorrect import se3
from gpcorrect.arms import arm_named
from gpcorrect.errors import DataError
from gpcorrect.plain import toml_text
from gpcorrect.sim import (
    joint_motion_log,
    machine_of,
    model_from_dict,
    preset,
    preset_names,
    read_model,
    write_model,
)
from gpcorrect.sim.effects import CableStretch
from gpcorrect.sim.model import model_text

FULL = """
arm = "raven2_left"
joints = [1, 2, 3]
wrist = [0.0, 0.0, 0.0]
theta_offset_deg = [205, 180, 0, 0, -90, 0]
gravity = [0.0, 0.0, -9.81]
payload = 0.1
log_rate_hz = 100
T_tracker_base = { translation = [0.1, 0, 0], rotvec = [0, 0.5, 0] }
[controller]
kp = [600.0, 500.0, 160000.0]
kd = [25.0, 20.0, 6500.0]
rate_hz = 1000
feedback = "motor"
feedforward = "rigid-body"
[transmission]
motor_inertia = [0.26, 0.21, 66.0]
[links]
mass = [0.494, 0.750, 0.231]
com = [[0.0065, 0.09775, -0.13771], [-0.002, -0.18274, -0.23053], [0.0, 0.0, 0.0]]
inertia_diagonal = [[1e-3, 1e-3, 1e-3], [1e-3, 1e-3, 1e-3], [0, 0, 0]]
[noise]
external_jp_white = [1e-4, 1e-4, 2e-5]
external_jp_ar_std = [1e-4, 1e-4, 2e-5]
external_jp_ar_phi = 0.95
tracker_white = 1.5e-4
tracker_ar_std = 5e-5
encoder_step = [1e-5, 1e-5, 1e-6]
[[effects]]
name = "cable_stretch"
joint = 2
stiffness = 120.0
"""
MORE = """
[[effects]]
name = "homing_offset"
joint = 1
offset = [0.01, 0.02]

[[effects]]
name = "cable_stretch"
joint = 3
stiffness = inf

[T_tip_marker]
translation = [0.0, 0.0, 0.01]

[faults]
outlier_share = 0.01
outlier_shift = 0.02
"""

scalars = st.one_of(
    st.booleans(),
    st.integers(-(2**62), 2**62),
    st.floats(allow_nan=False),
    st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
)
tables = st.dictionaries(
    st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    st.one_of(scalars, st.lists(scalars, max_size=4)),
    max_size=4,
)
documents = st.dictionaries(
    st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    st.one_of(scalars, st.lists(scalars, max_size=3), tables, st.lists(tables, min_size=1, max_size=3)),
    max_size=5,
)


@given(documents)
def test_toml_text_is_read_back_exactly(document):
    """Whatever is written, the standard library reads the same."""
    assert tomllib.loads(toml_text(document)) == document


def test_a_model_file_is_read_as_documented():
    """Every key of the format arrives where it belongs."""
    machine = machine_of(model_from_dict(tomllib.loads(FULL)))
    np.testing.assert_allclose(machine.drive.kp, [600.0, 500.0, 160000.0])
    assert machine.drive.feedforward == "rigid-body"
    assert machine.effects == (CableStretch(2, 120.0),)
    np.testing.assert_allclose(machine.body.links.mass, [0.494, 0.75, 0.231])
    np.testing.assert_allclose(machine.body.gravity, [0, 0, -9.81])
    np.testing.assert_allclose(machine.body.links.payload, 0.1)
    np.testing.assert_allclose(machine.T_tracker_base, se3.exp(np.array([0, 0, 0, 0, 0.5, 0])) + np.eye(4, k=3) * 0.1)
    assert machine.noise.tracker_white == 1.5e-4
    assert machine.body.types == "RRP"


@pytest.mark.parametrize("name", [*preset_names(), "full"])
def test_file_round_trip(name, tmp_path):
    """Written and read again a model is the same, also in the machine it makes, and so is its text."""
    model = model_from_dict(tomllib.loads(FULL + MORE)) if name == "full" else preset(name)
    write_model(model, tmp_path / "model.toml")
    again = read_model(tmp_path / "model.toml")
    assert again == model
    assert machine_of(again).effects == machine_of(model).effects
    assert model_text(again) == model_text(model)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("gravitiy = [0, 0, 1]\n{}", "unknown key gravitiy"),
        ("{}\nwidth = 2.0", "no key width"),
        ("{}\n[noise2]\nwhite = 1.0", "unknown key noise2"),
        ("{}\n[faults]\nlost = 0.5", "unknown key faults.lost"),
        ("{}\n[[effects]]\nname = 'wobble'\njoint = 1", "wobble"),
    ],
)
def test_unknown_keys_are_named(change, message, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(change.format(FULL), encoding="utf-8")
    with pytest.raises(DataError, match=message):
        read_model(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('arm = "raven2_left"', "", "arm is missing"),
        ("kp = [600.0,", "kp = [-600.0,", "controller.kp.0"),
        ("kp = [600.0,", 'kp = ["600",', "controller.kp.0"),
        ("kp = [600.0, 500.0, 160000.0]", "kp = [600.0, 500.0]", "kp must have 3 numbers"),
        ('feedback = "motor"', 'feedback = "joint"', "controller.feedback"),
        ("joints = [1, 2, 3]", "joints = [1, 2, 9]", "1 to 6"),
        ("joints = [1, 2, 3]", "joints = [1, 2, 2]", "different"),
        ("joints = [1, 2, 3]", "joints = []", "joints"),
        ("wrist = [0.0, 0.0, 0.0]", "wrist = [0.0]", "wrist must have 3"),
        ('arm = "raven2_left"', 'arm = "raven3"', "raven3"),
        ("payload = 0.1", "payload = nan", "payload"),
        ("joint = 2", "joint = 6", "joint 6"),
    ],
)
def test_bad_values_are_refused(old, new, message, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(FULL.replace(old, new), encoding="utf-8")
    with pytest.raises(DataError, match=message):
        machine_of(read_model(path))


@pytest.mark.parametrize("text", ["arm = ", "\x00", "[["])
def test_what_is_no_toml_is_refused(text, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match="no TOML"):
        read_model(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(DataError, match="cannot read"):
        read_model(tmp_path / "none.toml")


def test_silence_means_the_arms_own_numbers():
    """A model that names only the arm has that arm's masses, gravity, home and offsets, and no noise."""
    arm = arm_named("raven2_right")
    machine = machine_of(model_from_dict({"arm": "raven2_right", "joints": [1, 2, 3]}))
    np.testing.assert_allclose(machine.body.links.mass, [link.mass for link in arm.links])
    np.testing.assert_allclose(machine.body.gravity, arm.gravity)
    np.testing.assert_allclose(machine.body.held, arm.home[3:])
    q = arm.home[None]
    np.testing.assert_allclose(machine.body.forward(q[:, :3]), arm.forward(q))


def test_theta_offsets_of_the_table_are_the_arms_own():
    """The documented offsets reproduce the arm's own forward map; the insertion's fixed angle is the table's."""
    named = machine_of(
        model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "theta_offset_deg": [205, 180, 0, 0, -90, 0]})
    )
    plain = machine_of(model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3]}))
    q = np.array([[0.5, 1.5, 0.4]])
    np.testing.assert_allclose(named.body.forward(q), plain.body.forward(q), atol=1e-12)


def test_bare_joints_have_joints_and_nothing_else():
    """Without kinematics there are joint signals only, for whichever joint numbers the model has."""
    model = model_from_dict(
        {
            "arm": "joints",
            "joints": [4, 6],
            "joint_types": "RP",
            "effects": [{"name": "homing_offset", "joint": 6, "offset": 0.01}],
        }
    )
    log = joint_motion_log(model, trajectories=2, seconds=1.0)
    assert log.signals == ("setpoint_jp", "measured_jp", "measured_jv", "measured_jf", "external_jp")
    np.testing.assert_allclose(log.measured_jp - log.external_jp, [[0.0, 0.01]] * len(log), atol=1e-12)


def test_an_unknown_preset_is_refused():
    with pytest.raises(DataError, match="raven2_debridement"):
        preset("moon_lander")
