"""Effects in a robot file's own words: what is written acts as it is meant, or stays beside the file."""

import numpy as np
import pytest
from robot_files import write_mjcf

from gpcorrect.arms import RobotEdit, read_robot
from gpcorrect.errors import DataError
from gpcorrect.sim import effect_from_dict, machine_of, read_model
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.model import model_from_dict, write_completed

mujoco = pytest.importorskip("mujoco", reason="robot files need mujoco: pip install 'gpcorrect[mujoco]'")

TIP = {"tool": "tip"}
PAN, ROLL = 'axis="0.1 -0.2 1" pos="0.01 0 0.02" range="-2.5 2.5"', '<joint name="roll" axis="0 0 -1" range="-3 3"'
SITE = '<site name="tip" pos="0.05 0.01 0.02" euler="0.4 0.2 -0.3"/>'
OPTION = '<option timestep="0.001" integrator="implicitfast"/>'
FRAME = '<frame pos="0.03 -0.02 0.05" euler="0.3 0.5 -0.2">{}</frame>'
FRAMED = [  # the joint inside of a frame with another, and the site inside of one
    (f'{ROLL} armature="0.02" damping="0.05"/>', FRAME.format(f'{ROLL} pos="0 0.01 0" armature="0.02"/>')),
    (SITE, FRAME.format(SITE)),
]


def drives(path):
    return read_robot(path, **TIP).drives


def completed(path, *effects):
    """Return a model with these effects, and what was written of it."""
    found = [effect_from_dict(effect) for effect in effects]
    model = model_from_dict({"robot": path.name, **TIP}, folder=path.parent).with_effects(*found)
    return model, write_completed(model, path.parent / "new.toml")


def load(model):
    """Torques `(4,)` that hold a model's arm up at some joint values."""
    machine = machine_of(model)
    body = machine.actual_body(machine.body.links.payload)
    return posture_at(body, np.array([[[0.4, -0.3, 0.05, 1.0]]])).gravity_load()[0, 0]


def tip(model, q):
    machine = machine_of(model)
    return machine.actual_body(machine.body.links.payload).forward(q[None, None])[0, 0]


def test_spring_and_damping_add_up_with_those_of_a_time_constant(tmp_path):
    """MuJoCo's own run of the written file has both, also behind a payload, of which it would make others."""
    path = write_mjcf(tmp_path, (PAN, f'{PAN} springdamper="0.5 1"'))
    own = mujoco.MjSpec.from_file(str(path))
    edit, before = RobotEdit(path, **TIP), drives(path)
    assert before.damping[0] > 0.5
    assert edit.add_spring(1, 3.0, 0.0)
    edit.add_damping(1, 2.0)
    edit.add_payload(1.0)
    edit.write(tmp_path / "new.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    joint = model.joint("pan")
    assert own.joint("pan").springdamper[0] == 0.5
    np.testing.assert_allclose(joint.stiffness[0], before.stiffness[0] + 3.0, rtol=1e-5)
    np.testing.assert_allclose(joint.damping[0], before.damping[0] + 2.0, rtol=1e-5)


@pytest.mark.parametrize("flags", ['frictionloss="disable" spring="disable" damper="disable"', 'constraint="disable"'])
def test_what_is_written_acts_where_the_file_had_it_switched_off(tmp_path, flags):
    """What was off stays off: its numbers are zero, and those that are added are all there is."""
    flagged = OPTION.replace("/>", f"><flag {flags}/></option>")
    path = write_mjcf(tmp_path, (OPTION, flagged))
    edit, before = RobotEdit(path, **TIP), drives(path)
    edit.add_friction(2, 0.5)
    edit.add_damping(1, 2.0)
    edit.write(tmp_path / "new.xml")
    after, model = drives(tmp_path / "new.xml"), mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    np.testing.assert_allclose(before.friction, 0.0)
    np.testing.assert_allclose(after.friction, [0, 0.5, 0, 0])
    np.testing.assert_allclose(after.damping, before.damping + np.array([2, 0, 0, 0]))
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0
    mujoco.mj_forward(model, data)
    assert mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF in data.efc_type
    assert data.qfrc_damper[0] == pytest.approx(-after.damping[0])


def test_gravity_that_is_written_acts_where_the_file_had_it_switched_off(tmp_path):
    """All of it is the change."""
    path = write_mjcf(tmp_path, (OPTION, OPTION.replace("/>", '><flag gravity="disable"/></option>')))
    edit = RobotEdit(path, **TIP)
    assert edit.add_gravity((0.1, 0.0, -0.2))
    edit.write(tmp_path / "new.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    np.testing.assert_allclose(model.opt.gravity, [0.1, 0.0, -0.2])
    assert not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY


@pytest.mark.parametrize("changes", [[], FRAMED], ids=["plain", "in frames"])
@pytest.mark.parametrize(
    "effect",
    [
        {"name": "payload", "joint": "all", "mass": 0.7},
        {"name": "link_mass_error", "joint": 4, "mass": 0.7},
        {"name": "dh_error", "joint": 4, "a": 0.01, "alpha": 0.05, "d": 0.02, "theta": 0.03},
    ],
    ids=lambda effect: effect["name"],
)
def test_masses_and_geometry_are_written_where_they_are(tmp_path, changes, effect):
    """The written file weighs and reaches as the effect has it, also where joint and site lie in a frame."""
    path = write_mjcf(tmp_path, *changes)
    model, written = completed(path, effect)
    back, q = read_model(written.model), np.array([0.4, -0.3, 0.05, 1.0])
    assert len(written.words) == 1
    np.testing.assert_allclose(load(back), load(model), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(tip(back, q), tip(model, q), atol=2e-6)


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass':UserWarning")
@pytest.mark.parametrize("name", ["payload", "link_mass_error"])
def test_masses_stay_beside_a_file_that_fixes_the_total(tmp_path, name):
    """MuJoCo would scale what is written and all else."""
    path = write_mjcf(tmp_path, ("<compiler", '<compiler settotalmass="9"'))
    model, written = completed(path, {"name": name, "joint": "all" if name == "payload" else 2, "mass": 0.7})
    assert not written.words
    np.testing.assert_allclose(load(read_model(written.model)), load(model), rtol=1e-5)


@pytest.mark.parametrize(("limit", "held"), [(20.0, 20.0), (90.0, 60.0)])
def test_a_limit_of_torque_is_written_where_it_is_below_the_files(tmp_path, limit, held):
    """A saturation above it changes nothing."""
    _, written = completed(write_mjcf(tmp_path), {"name": "torque_saturation", "joint": 2, "limit": limit})
    assert len(written.words) == 1
    np.testing.assert_allclose(drives(written.robot).limit, [np.inf, held, np.inf, np.inf])


def test_a_limit_of_torque_stays_beside_a_servo_that_is_switched_off(tmp_path):
    """The file has no servo then."""
    path = write_mjcf(tmp_path, (OPTION, OPTION.replace("/>", '><flag actuation="disable"/></option>')))
    assert not RobotEdit(path, **TIP).limit_torque(2, 20.0)


def test_less_inertia_than_the_joint_has_stays_beside_the_file(tmp_path):
    """The rest may stand in the actuator; of the joint's own it is written."""
    path = write_mjcf(tmp_path, ('<position joint="pan" kp="900"', '<position joint="pan" kp="900" armature="0.3"'))
    for inertia, count in ((-0.2, 0), (-0.05, 1)):
        _, written = completed(path, {"name": "inertia_error", "joint": 1, "inertia": inertia})
        assert len(written.words) == count
        np.testing.assert_allclose(drives(written.robot).armature[0], 0.4 + inertia * count)


def test_both_ends_of_a_range_are_moved(tmp_path):
    """Two stops of one joint, in degrees too; one that leaves no range moves nothing, and stays beside the file."""
    stops = [
        {"name": "joint_stop", "joint": 1, "stiffness": 100.0, "limit": 0.5, "end": "upper"},
        {"name": "joint_stop", "joint": 1, "stiffness": 100.0, "limit": -0.6, "end": "lower"},
        {"name": "joint_stop", "joint": 4, "stiffness": 100.0, "limit": -3.5, "end": "upper"},
    ]
    before = read_robot(write_mjcf(tmp_path), **TIP).arm.limits
    degrees = write_mjcf(tmp_path, ('angle="radian" ', ""), ('range="-2.5 2.5"', 'range="-143 143"'))
    for path, own in ((degrees, None), (write_mjcf(tmp_path), before)):
        _, written = completed(path, *stops)
        after = read_robot(written.robot, **TIP).arm.limits
        np.testing.assert_allclose(after[0], [-0.6, 0.5], rtol=1e-5)
        assert len(read_model(written.model).effects) == 3
        if own is not None:
            np.testing.assert_allclose(after[1:], own[1:])


def test_a_stop_gives_no_other_end_to_a_joint_without_limits(tmp_path):
    """It turns on as before; the stop is in the model file."""
    path = write_mjcf(tmp_path, (' range="-3 3"', ""))
    _, written = completed(path, {"name": "joint_stop", "joint": 4, "stiffness": 9.0, "limit": 0.5, "end": "upper"})
    assert not mujoco.MjSpec.from_file(str(written.robot)).compile().joint("roll").limited[0]
    assert len(read_model(written.model).effects) == 1


ASSET = '<asset><mesh name="shell" file="nowhere.stl"/></asset>'
FACES = " ".join(f'file{side}="nowhere.png"' for side in ("right", "left", "up", "down", "front", "back"))
MISSING = {
    "texture": f'<texture name="sky" type="cube" {FACES}/>',
    "height field": '<hfield name="hills" file="nowhere.png" size="1 1 1 1"/>',
}


@pytest.mark.parametrize("asset", MISSING)
def test_files_whose_pictures_are_missing_are_written_without_them(tmp_path, asset):
    """As those whose meshes are."""
    path = write_mjcf(tmp_path, (ASSET, f"<asset>{MISSING[asset]}</asset>"), ('<geom type="mesh" mesh="shell"/>', ""))
    _, written = completed(path, {"name": "payload", "joint": "all", "mass": 0.7})
    assert read_robot(written.robot, **TIP).arm.links[-1].mass == pytest.approx(0.45 + 0.7)


def test_what_mujoco_cannot_compile_is_refused_by_name(tmp_path):
    """Be it the edit or a mesh that is none: the file and MuJoCo's reason are named, and nothing is written."""
    path = write_mjcf(tmp_path)
    edit = RobotEdit(path, **TIP)
    assert edit.limit_torque(2, 0.0)
    with pytest.raises(DataError, match=r"MuJoCo cannot read small\.xml as it was changed: .*invalid force range"):
        edit.write(tmp_path / "new.xml")
    assert not (tmp_path / "new.xml").exists()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "nowhere.stl").write_text("no mesh")
    with pytest.raises(DataError, match=r"MuJoCo cannot read .*small\.xml: .*nowhere\.stl"):
        RobotEdit(path, **TIP)
