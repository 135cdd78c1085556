"""What a robot file's options, tendons, actuators and parts say beside the arm: honoured, refused, or remarked on."""

import numpy as np
import pytest
from robot_files import write_mjcf

from gpcorrect.arms import read_robot
from gpcorrect.errors import DataError

mujoco = pytest.importorskip("mujoco", reason="robot files need mujoco: pip install 'gpcorrect[mujoco]'")

TIP = {"tool": "tip"}
OPTION = '<option timestep="0.001" integrator="implicitfast"/>'
LIFT_SERVO = '<position joint="lift" kp="800" kv="60" forcerange="-60 60"/>'
ARM = """
<mujoco><compiler angle="radian"/>{option}<worldbody>
  <body name="one"><inertial pos="0.1 0 0" mass="2" diaginertia="0.02 0.02 0.02"/>
    <joint name="a" axis="0 1 0" range="-3 3" armature="0.1" {joint}/>
    <body name="two" pos="0.4 0 0"><inertial pos="0.1 0 0" mass="2" diaginertia="0.02 0.02 0.02"/>
      <joint name="b" axis="0 1 0" range="-3 3" armature="0.1"/>
      <site name="tip" pos="0.2 0 0"/>
      <body name="three" pos="0.4 0 0"><inertial pos="0.3 0 0" mass="3" diaginertia="0.02 0.02 0.02"/>
        <joint name="c" axis="0 1 0" range="-3 3"/>
      </body>
    </body>
  </body>
</worldbody>
<actuator>{actuators}</actuator>{rest}</mujoco>
"""
SERVOS = '<position name="p" joint="a" kp="200" kv="5" armature="0.2" damping="0.7"/><position joint="b" kp="200"/>'


def arm(folder, option="", joint="", actuators=SERVOS, rest=""):
    path = folder / "arm.xml"
    path.write_text(ARM.format(option=option, joint=joint, actuators=actuators, rest=rest), encoding="utf-8")
    return path


def remarks(path, **chosen):
    return "; ".join(read_robot(path, **(chosen or TIP)).remarks)


FLAGS = ["", "gravity", "spring", "damper", "frictionloss", "actuation", "constraint"]


@pytest.mark.parametrize("flag", FLAGS)
def test_what_a_flag_switches_off_is_read_as_mujoco_has_it(tmp_path, flag):
    """Weight, spring, damping, friction and the servo's torque are those of MuJoCo's own run of the file."""
    joint = 'stiffness="3" springref="0.3" damping="2" frictionloss="0.5"'
    option = f'<option><flag {flag}="disable"/></option>' if flag else ""
    path = arm(tmp_path, option, joint)
    robot, model = read_robot(path, joints=["c"]), mujoco.MjModel.from_xml_path(str(path))
    data, drives = mujoco.MjData(model), robot.drives
    data.qvel[0], data.ctrl[0] = 1.0, 0.5
    mujoco.mj_forward(model, data)
    assert drives.damping[0] == pytest.approx(-data.qfrc_damper[0])
    assert drives.stiffness[0] * drives.rest[0] == pytest.approx(data.qfrc_spring[0])
    assert np.nan_to_num(0.5 * drives.kp - drives.kv)[0] == pytest.approx(data.qfrc_actuator[0])
    assert drives.friction[0] == (0.5 if (data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF).any() else 0.0)
    assert bool(robot.arm.gravity.any()) == bool(data.qfrc_gravcomp.any() or data.qfrc_bias.any())
    assert drives.armature[0] == pytest.approx(0.3)


def test_actuators_of_a_group_that_is_switched_off_drive_nothing(tmp_path):
    """Its joint has no servo, which is said; the other keeps its own."""
    servos = SERVOS.replace('name="p"', 'name="p" group="1"')
    robot = read_robot(arm(tmp_path, '<option actuatorgroupdisable="1"/>', actuators=servos), **TIP)
    assert robot.drives.servo.tolist() == [False, True]
    assert "actuator 'p' is switched off" in "; ".join(robot.remarks)


@pytest.mark.parametrize("numbers", ['density="1000"', 'viscosity="10"'])
def test_drag_is_said_not_to_be_simulated(tmp_path, numbers):
    """Of water as of air; a wind without either is nothing."""
    assert "drag" in remarks(arm(tmp_path, f"<option {numbers}/>"))
    assert not remarks(arm(tmp_path, '<option wind="1 0 0"/>'))


FIXED = '<tendon><fixed name="t" {}><joint joint="{}" coef="1"/><joint joint="{}" coef="-1"/></fixed></tendon>'
STRING = '<tendon><spatial name="t"{}><site site="tip"/><site site="eye"/></spatial></tendon>'
HELD = '<equality><tendon tendon1="t"/></equality>'


def test_a_tendon_that_ties_joints_of_the_arm_is_a_closed_loop(tmp_path):
    """As the same constraint of two joints; one that is inactive, switched off or of other joints ties nothing."""
    tied = FIXED.format("", "a", "b") + HELD
    with pytest.raises(DataError, match=r"equality constraint of tendon 't' ties a, b and closes a loop.*false"):
        read_robot(arm(tmp_path, rest=tied), **TIP)
    assert not remarks(arm(tmp_path, rest=tied.replace("/></eq", ' active="false"/></eq')))
    assert not remarks(arm(tmp_path, '<option><flag equality="disable"/></option>', rest=tied))
    assert "tendon 't' is not simulated" in remarks(arm(tmp_path, rest=FIXED.format("", "b", "c") + HELD))
    assert not remarks(arm(tmp_path, rest=FIXED.format("", "c", "c") + HELD))


@pytest.mark.parametrize("load", ['stiffness="300"', 'damping="2"', 'frictionloss="1"', 'armature="1"', 'range="0 1"'])
def test_a_tendon_that_resists_is_said_not_to_be_simulated(tmp_path, load):
    """One that only has a length is nothing."""
    assert "tendon 't' is not simulated" in remarks(arm(tmp_path, rest=FIXED.format(load, "a", "b")))
    assert not remarks(arm(tmp_path, rest=FIXED.format("", "a", "b")))


def test_a_string_acts_on_the_joints_between_its_ends(tmp_path):
    """From the base to the tip on all; along one link on none."""
    string = STRING.format(' stiffness="9"')
    for carrier, acts in (("<worldbody>", True), ('<joint name="b"', False)):
        path = arm(tmp_path, rest=string)
        site = '<site name="eye"/>'
        new = carrier + site if acts else site + carrier
        path.write_text(path.read_text().replace(carrier, new), encoding="utf-8")
        assert ("tendon 't' is not simulated" in remarks(path)) == acts


def test_a_grippers_tendon_actuator_leaves_the_home_of_the_arm(tmp_path):
    """The key frame keeps the commands of those actuators that stay, as in MuJoCo's own grippers' files."""
    key = '<keyframe><key name="home" qpos="0.3 0.4 0.2" ctrl="0.3 255 0.4"/></keyframe>'
    servos = SERVOS.replace("/><", '/><general name="grip" tendon="t"/><')
    robot = read_robot(arm(tmp_path, actuators=servos, rest=FIXED.format("", "c", "c") + key), **TIP)
    np.testing.assert_allclose(robot.arm.home, [0.3, 0.4])
    assert not robot.remarks
    path = arm(tmp_path, actuators=servos, rest=FIXED.format("", "b", "c") + key)
    assert remarks(path) == "actuator 'grip' at tendon 't' is not simulated"


def test_joints_behind_the_arm_are_held_at_home(tmp_path):
    """Gravity's torque is MuJoCo's with the last joint folded, as the key frame has it, and the arm anywhere."""
    path = arm(tmp_path, rest='<keyframe><key name="home" qpos="0 0 2.5"/></keyframe>')
    robot, model = read_robot(path, joints=["a", "b"]), mujoco.MjModel.from_xml_path(str(path))
    assert robot.joints == ("a", "b")
    data = mujoco.MjData(model)
    for q in ([0.0, 0.0], [0.4, -0.9]):
        data.qpos[:] = [*q, 2.5]
        mujoco.mj_forward(model, data)
        links, centres = robot.arm.links, []
        frames = robot.arm.chain.frames(np.array(q))
        centres = [T[:3, :3] @ link.com + T[:3, 3] for T, link in zip(frames, links, strict=True)]
        masses = np.array([link.mass for link in links])
        np.testing.assert_allclose(masses @ centres / masses.sum(), data.subtree_com[0], atol=1e-9)


def test_a_motors_range_of_commands_limits_its_torque(tmp_path):
    """By gear and gain; unless the file has commands go free."""
    motors = '<motor joint="a" gear="-50" ctrlrange="-1 1"/><motor joint="b" gear="50"/>'
    np.testing.assert_allclose(read_robot(arm(tmp_path, actuators=motors), **TIP).drives.limit, [50.0, np.inf])
    free = arm(tmp_path, '<option><flag clampctrl="disable"/></option>', actuators=motors)
    np.testing.assert_allclose(read_robot(free, **TIP).drives.limit, np.inf)


@pytest.mark.parametrize(
    ("gear", "held", "said"),
    [(1, "-3 3", False), (1, "-2.999 3.1", False), (1, "-0.1 0.1", True), (-2, "-6 5.9", True)],
)
def test_a_servos_range_of_commands_that_is_narrower_than_its_joints_is_said(tmp_path, gear, held, said):
    """Commands are lengths of the actuator: joint values by its gear."""
    servo = f'<position name="p" joint="a" kp="200" gear="{gear}" ctrlrange="{held}"/>'
    assert (
        "commands are not held within the ctrlrange of actuator 'p'" in remarks(arm(tmp_path, actuators=servo))
    ) == said


def test_a_delay_of_an_actuator_is_said_not_to_be_simulated(tmp_path):
    """With its length."""
    servo = SERVOS.replace('name="p"', 'name="p" delay="0.02" nsample="12"')
    assert remarks(arm(tmp_path, actuators=servo)) == "the delay of actuator 'p', 0.02 s, is not simulated"


ONE_SIDED = {
    "forcerange": ("", '<position name="p" joint="a" kp="9" forcerange="0 80"/>'),
    "ctrlrange": ("", '<motor name="p" joint="a" ctrlrange="0 1"/>'),
    "actuatorfrcrange": ('actuatorfrcrange="0 5"', '<motor name="p" joint="a"/>'),
}


@pytest.mark.parametrize("what", ONE_SIDED)
def test_a_drive_that_pushes_one_way_is_refused(tmp_path, what):
    """The range is named, with its numbers."""
    joint, actuator = ONE_SIDED[what]
    with pytest.raises(DataError, match=f"the {what} of .* push one way only .0 to .*expected both") as refused:
        read_robot(arm(tmp_path, joint=joint, actuators=actuator), **TIP)
    assert refused.value.hint


def test_a_range_that_is_not_symmetric_holds_by_its_nearer_end(tmp_path):
    """Which is said."""
    path = write_mjcf(tmp_path, (LIFT_SERVO, LIFT_SERVO.replace("-60 60", "-80 60")))
    assert read_robot(path, **TIP).drives.limit[1] == 60.0
    assert "forcerange of actuator 'actuator 1' is not symmetric" in remarks(path)


HEIGHTS = '<asset><hfield name="hills" file="nowhere.png" size="1 1 1 1"/></asset>'
PAINTED = '<asset><material name="red" rgba="1 0 0 1"/></asset>'


def test_ground_and_paint_are_not_needed(tmp_path):
    """Neither the file of a height field, nor the material of a site."""
    hills = arm(tmp_path, rest=HEIGHTS)
    hills.write_text(hills.read_text().replace("<worldbody>", '<worldbody><geom type="hfield" hfield="hills"/>'))
    assert read_robot(hills, **TIP).arm.dof == 2
    red = arm(tmp_path, rest=PAINTED)
    red.write_text(red.read_text().replace('name="tip"', 'name="tip" material="red"'))
    assert read_robot(red, **TIP).arm.dof == 2


def test_a_file_whose_included_part_changed_is_read_again(tmp_path):
    """The part of a part too."""
    path, part, small = arm(tmp_path), tmp_path / "part.xml", tmp_path / "small_part.xml"
    path.write_text(path.read_text().replace("<worldbody>", '<include file="part.xml"/><worldbody>'))
    part.write_text('<mujoco><include file="small_part.xml"/></mujoco>')
    default = '<mujoco><default><joint damping="{}"/></default></mujoco>'
    small.write_text(default.format("0.1"))
    before = read_robot(path, **TIP)
    assert read_robot(path, **TIP) is before
    small.write_text(default.format("0.75"))
    np.testing.assert_allclose(before.drives.damping, [0.8, 0.1])
    np.testing.assert_allclose(read_robot(path, **TIP).drives.damping, [1.45, 0.75])
