import itertools
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from robot_files import URDF, write_mjcf, write_urdf

from gpcorrect.arms import RobotEdit, is_robot_file, read_robot
from gpcorrect.errors import DataError, MissingExtraError

mujoco = pytest.importorskip("mujoco", reason="robot files need mujoco: pip install 'gpcorrect[mujoco]'")

TIP = {"tool": "tip"}
MASS = '<inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/>'
PLANAR = f"""<mujoco><compiler angle="radian"/><worldbody>
<body name="one"><joint name="a" axis="0 1 0" range="-2 2"/>{MASS}
<body name="two" pos="{{}}"><joint name="b" axis="0 1 0" range="-2 2"/>{MASS}
<body name="tip" pos="0.05 0 0.2"/></body></body></worldbody></mujoco>"""


def compiled(path):
    """MuJoCo's own model of a file, without the meshes, which are nowhere."""
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in [g for body in spec.bodies for g in body.geoms if g.meshname]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    spec.compiler.fusestatic = False
    return spec.compile()


def place_of(model, data, name):
    """Position and rotation of a body or site."""
    sites = [model.site(s).name for s in range(model.nsite)]
    item = data.site(name) if name in sites else data.body(name)
    return item.xpos, item.xmat.reshape(3, 3)


def posed(model, joints, q):
    """MuJoCo's data with the named joints at these values."""
    data = mujoco.MjData(model)
    for name, value in zip(joints, q, strict=True):
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    return data


@pytest.mark.parametrize(
    ("write", "tool"), [(write_mjcf, "tip"), (write_mjcf, "wrist"), (write_urdf, "flange"), (write_urdf, "two")]
)
def test_forward_kinematics_are_mujocos(tmp_path, write, tool):
    """The tip's pose agrees with mj_kinematics to 1e-9 m and rad at random joints, whatever axes, anchors and zeros."""
    path = write(tmp_path)
    robot, model = read_robot(path, tool=tool), compiled(path)
    rng = np.random.default_rng(0)
    for q in rng.uniform(*robot.arm.limits.T, (50, robot.arm.dof)):
        position, rotation = place_of(model, posed(model, robot.joints, q), tool)
        T = robot.arm.forward(q)
        np.testing.assert_allclose(T[:3, 3], position, atol=1e-9)
        np.testing.assert_allclose(T[:3, :3], rotation, atol=1e-9)


def test_a_base_body_is_the_frame_of_everything(tmp_path):
    """Poses and gravity are given in the base body's frame."""
    path = write_mjcf(tmp_path)
    robot, model = read_robot(path, tool="tip", base="stand"), compiled(path)
    q = np.array([0.4, -0.3, 0.05, 1.0])
    data = posed(model, robot.joints, q)
    (p_base, R_base), (p_tip, R_tip) = place_of(model, data, "stand"), place_of(model, data, "tip")
    T = robot.arm.forward(q)
    np.testing.assert_allclose(T[:3, 3], R_base.T @ (p_tip - p_base), atol=1e-9)
    np.testing.assert_allclose(T[:3, :3], R_base.T @ R_tip, atol=1e-9)
    np.testing.assert_allclose(robot.arm.gravity, R_base.T @ model.opt.gravity, atol=1e-12)


def test_numbers_of_the_drives_are_read_in_joint_units(tmp_path):
    """A gear scales a servo's gains by its square, springs and frictions are the joints'."""
    drives = read_robot(write_mjcf(tmp_path), **TIP).drives
    np.testing.assert_allclose(drives.kp, [900, 800, 16 * 250, 60])
    np.testing.assert_allclose(drives.kv, [60, 60, 16 * 20, 4])
    np.testing.assert_allclose(drives.limit, [np.inf, 60, np.inf, np.inf])
    np.testing.assert_allclose(drives.friction, [0, 0.2, 0, 0])
    np.testing.assert_allclose(drives.damping, [0.5, 0, 0, 0.05])
    np.testing.assert_allclose(drives.armature, [0.1, 0.08, 2, 0.02])
    np.testing.assert_allclose([drives.stiffness[2], drives.rest[2]], [40, 0.02])


@pytest.mark.parametrize(
    ("softness", "b", "d"),
    [
        ("", 2.0 / (0.95 * 0.02), 0.9),
        (' solreffriction="0.0005 1" solimpfriction="0.8 0.9 0.001"', 2.0 / (0.9 * 0.002), 0.8),
        (' solreffriction="-100 -60" solimpfriction="0.8 0.9 0"', 60.0 / 0.9, 0.85),
    ],
    ids=["default", "at two steps", "direct, flat"],
)
def test_a_files_friction_is_as_soft_as_mujocos_documentation_says(tmp_path, softness, b, d):
    """Of time constant and impedances comes b, and R of the impedance and the inertia; the onset is F R / b."""
    path = write_mjcf(tmp_path, ('frictionloss="0.2"', f'frictionloss="0.2"{softness}'))
    model, drives = compiled(path), read_robot(path, **TIP).drives
    R = (1.0 - d) / d * model.dof_invweight0[model.joint("lift").dofadr[0]]
    np.testing.assert_allclose(drives.onset, [0.0, 0.2 * R / b, 0.0, 0.0])
    np.testing.assert_allclose(drives.onset_time, [0.0, 1.0 / b, 0.0, 0.0])


def test_soft_friction_reads_back_as_soft_as_it_was_written(tmp_path):
    """Alone, beside the file's own and with new masses; where no impedance says it, the file stays as it is."""
    path = write_mjcf(tmp_path)
    before, edit = read_robot(path, **TIP).drives, RobotEdit(path, tool="tip")
    assert edit.add_soft_friction(1, 0.6, 0.01, 0.0095)
    assert edit.add_soft_friction(2, 0.4, 0.02, 0.02)
    assert not edit.add_soft_friction(3, 1.0, 1e-9, 0.0095)
    assert not edit.add_soft_friction(4, 1.0, 0.01, 1e-5)
    edit.add_payload(0.8)
    edit.add_inertia(2, 0.3)
    edit.write(tmp_path / "new.xml")
    after = read_robot(tmp_path / "new.xml", **TIP).drives
    slopes = np.array([0.2 / before.onset[1], 0.4 / 0.02])
    np.testing.assert_allclose(after.friction, [0.6, 0.6, 0.0, 0.0])
    np.testing.assert_allclose(after.onset, [0.01, 0.6 / slopes.sum(), 0.0, 0.0], rtol=2e-4)
    times = [0.0095, slopes @ [0.0095, 0.02] / slopes.sum(), 0.0, 0.0]
    np.testing.assert_allclose(after.onset_time, times, rtol=2e-4)


def test_friction_that_was_written_dry_sticks(tmp_path):
    """Its onset is next to nothing, and it stops a joint within a step."""
    edit = RobotEdit(write_mjcf(tmp_path), tool="tip")
    edit.add_friction(2, 0.5)
    edit.write(tmp_path / "new.xml")
    robot = read_robot(tmp_path / "new.xml", **TIP)
    assert robot.drives.onset[1] < 1e-6
    assert robot.drives.onset_time[1] <= robot.step


def test_urdf_effort_and_friction_are_limits_and_friction(tmp_path):
    """A URDF's effort limits, damping and friction are read; it has no servo."""
    drives = read_robot(write_urdf(tmp_path)).drives
    np.testing.assert_allclose(drives.limit, 80)
    np.testing.assert_allclose(drives.friction, 0.3)
    np.testing.assert_allclose(drives.damping, 0.4)
    assert not drives.servo.any()


def test_numerical_inverse_reaches_what_forward_gives(tmp_path):
    """Joint values found along a path reach its poses."""
    robot = read_robot(write_mjcf(tmp_path), **TIP)
    path = np.array([0.1, 0.2, 0.05, 0.3]) + np.linspace(0, 0.3, 5)[:, None] * np.array([1, 1, 0.2, -1])
    poses = robot.arm.forward(path)
    np.testing.assert_allclose(robot.arm.forward(robot.arm.follow(poses, path[0])), poses, atol=1e-8)


def test_a_branch_is_chosen_by_joint_names_or_tool(tmp_path):
    """The named joints' branch is the arm; what hangs beside it rides along with its mass."""
    path = write_mjcf(tmp_path)
    by_joints = read_robot(path, joints=["pan", "roll"])
    assert by_joints.joints == ("pan", "lift", "slide", "roll")
    assert by_joints.arm.links[-1].mass == pytest.approx(0.45)
    assert read_robot(path, tool="finger").joints[-1] == "grip"


def test_the_tip_is_the_only_site_or_the_end_of_the_only_fixed_chain(tmp_path):
    """Without a tool's name the last link's one site or flange is the tip; of two, none is chosen."""
    path, flange = write_mjcf(tmp_path), write_urdf(tmp_path)
    assert read_robot(path, joints=["roll"]).tool == "tip"
    assert read_robot(flange).tool == "flange"
    second = '<joint name="side" type="fixed"><parent link="three"/><child link="camera"/></joint><link name="camera"/>'
    flange.write_text(URDF.replace("</robot>", second + "</robot>"), encoding="utf-8")
    assert read_robot(flange).tool == "three"
    two = write_mjcf(tmp_path, ('<site name="tip"', '<site name="lens"/><site name="tip"'))
    assert read_robot(two, joints=["roll"]).tool == "wrist"


def test_bodies_and_joints_without_names_are_read_and_edited(tmp_path):
    """They are called by kind and number; the arm is that of the file with names, and the edited file reads back."""
    names = [(f' name="{name}"', "") for name in ("wrist", "slider", "upper", "shoulder", "stand", "tip", "roll")]
    path = write_mjcf(tmp_path, *names, (ROLL_SERVO.replace(' name="roll"', ""), ""))
    robot = read_robot(path, joints=["pan", "joint 3"])
    assert robot.joints == ("pan", "lift", "slide", "joint 3")
    assert robot.tool == "body 5"
    q = np.array([0.4, -0.3, 0.05, 1.0])
    (tmp_path / "named").mkdir()
    named = read_robot(write_mjcf(tmp_path / "named"), tool="wrist")
    np.testing.assert_allclose(robot.arm.forward(q), named.arm.forward(q), atol=1e-12)
    edit = RobotEdit(path, tool=robot.tool)
    edit.add_friction(4, 0.5)
    edit.add_payload(0.3)
    edit.write(tmp_path / "new.xml")
    after = read_robot(tmp_path / "new.xml", tool=robot.tool)
    assert after.joints == robot.joints
    np.testing.assert_allclose(after.drives.friction - robot.drives.friction, [0, 0, 0, 0.5])


SECOND_ARM = '<body name="other"><joint name="away"/><geom size="0.1"/></body></worldbody>'
LOOP = '<equality><connect name="strut" body1="wrist" body2="stand" anchor="0 0 0"/></equality></mujoco>'

ROLL = '<joint name="roll" axis="0 0 -1" range="-3 3" armature="0.02" damping="0.05"/>'
ROLL_SERVO = '<position joint="roll" kp="60" kv="4"/>'
GRIP = '<joint name="grip" type="slide" axis="0 1 0" range="0 0.04"/>'
GRIP_SERVO = '<position joint="grip" kp="10"/>'
TIED = '<equality><joint joint1="roll" joint2="pan"/></equality></mujoco>'
STAND = 'euler="0.2 -0.1 0.4">'
FLOATING = f'{STAND}<freejoint name="loose"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
SLIDER_MASS = '<inertial pos="0 0 0.05" mass="0.8" diaginertia="0.002 0.002 0.001"/>'
SHOULDER_MASS = '<inertial pos="0.01 0.02 0.05" mass="2.5" fullinertia="0.02 0.03 0.025 0.004 -0.003 0.002"/>'
BRANCHES = r"2 branches.*\(1\) pan, lift, slide, roll, grip; \(2\) away.*joints = "

MILLIMETRES = [
    ('"slider" pos="0.25 0 0"', '"slider" pos="250 0 0"'),
    ('"wrist" pos="0.1 0 0"', '"wrist" pos="100 0 0"'),
]

REFUSED = {
    "two branches": ([("</worldbody>", SECOND_ARM)], {}, BRANCHES),
    "unknown joint": ([], {"joints": ["pan", "elbow"]}, "no joint 'elbow'. Its joints: pan, lift"),
    "unknown tool": ([], {"tool": "hand"}, "no tool 'hand'. Its bodies and sites: world, stand"),
    "unknown base": ([], {"tool": "tip", "base": "nowhere"}, "no base 'nowhere'. Its bodies: world"),
    "base beside": ([], {"tool": "tip", "base": "finger"}, "does not carry the tool"),
    "joint beside": ([("</worldbody>", SECOND_ARM)], {"tool": "tip", "joints": ["away"]}, "away is not between the wo"),
    "loop": ([("</mujoco>", LOOP)], TIP, "constraint strut closes a loop"),
    "free joint": ([(STAND, FLOATING)], TIP, "loose is a free or ball joint.*base"),
    "ball joint": ([(ROLL, '<joint name="roll" type="ball"/>'), (ROLL_SERVO, "")], TIP, "roll is a free or ball joint"),
    "no inertia": ([(SLIDER_MASS, "")], TIP, "has no inertia.*slider.*<inertial>"),
    "no mesh": ([(SHOULDER_MASS, "")], TIP, "nowhere.stl.*takes its mass from that mesh"),
    "no range": ([('axis="1 0 0.2" range="-0.1 0.2"', 'axis="1 0 0.2"')], TIP, "sliding joint 'slide' has no range"),
    "range backwards": ([('range="-2.5 2.5"', 'range="2.5 -2.5"')], TIP, "'pan' ends below its beginning: 2.5 to -2.5"),
    "tied joints": ([("</mujoco>", TIED)], TIP, "ties joints roll and pan closes a loop.*<mimic>"),
    "ball at the end": (
        [(GRIP, '<joint type="ball"/>'), (GRIP_SERVO, "")],
        {},
        "joint 4 is a free or ball.*tool before",
    ),
    "no include": ([("<worldbody>", '<include file="gone.xml"/><worldbody>')], TIP, "gone.xml.*Put the included file"),
    "millimetres": (MILLIMETRES, TIP, "links are .* m long together: the file is not in metres"),
    "broken": ([("<worldbody>", "<worldbody")], TIP, "MuJoCo cannot read"),
    "another": ([("<mujoco", "<sdf"), ("</mujoco", "</sdf")], TIP, "begins with <sdf>, expected <mujoco>"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_serial_arm_is_refused_with_the_reason(tmp_path, case):
    """Branches, loops, unknown names, free joints and missing masses are named, with what to do, within a second."""
    changes, chosen, message = REFUSED[case]
    path = write_mjcf(tmp_path, *changes)
    begun = time.monotonic()
    with pytest.raises(DataError, match=message) as refused:
        read_robot(path, **chosen)
    assert time.monotonic() - begun < 1.0
    assert refused.value.hint


INERTIA = '<link name="{}"><inertial><mass value="{}"/><inertia ixx="{}" iyy="{}" izz="{}" {}/></inertial></link>'
NO_PRODUCTS = 'ixy="0" ixz="0" iyz="0"'


def test_inertia_of_what_never_moves_is_not_asked_for(tmp_path):
    """A base and an antenna on it with impossible inertias, as public URDFs have them, change nothing of the arm."""
    impossible = INERTIA.format("base", 1, 0, 0, 0, NO_PRODUCTS) + INERTIA.format("antenna", 1, 1, 1, 9, NO_PRODUCTS)
    fixed = '<joint name="up" type="fixed"><parent link="base"/><child link="antenna"/></joint></robot>'
    path = tmp_path / "antenna.urdf"
    path.write_text(URDF.replace('<link name="base"/>', impossible).replace("</robot>", fixed), encoding="utf-8")
    arm, plain = read_robot(path).arm, read_robot(write_urdf(tmp_path)).arm
    for link, expected in zip(arm.links, plain.links, strict=True):
        np.testing.assert_array_equal(link.inertia, expected.inertia)
    edit = RobotEdit(path)
    edit.add_friction(1, 0.5)
    edit.write(tmp_path / "new.xml")
    np.testing.assert_allclose(read_robot(tmp_path / "new.xml").drives.friction, [0.8, 0.3, 0.3])


def test_an_impossible_inertia_of_what_moves_is_refused_with_the_way_out(tmp_path):
    """MuJoCo's own word for it, in the file, lets it be read."""
    fixed = '<joint name="on" type="fixed"><parent link="three"/><child link="plate"/></joint></robot>'
    text = URDF.replace("</robot>", INERTIA.format("plate", 1, 1, 1, 9, NO_PRODUCTS) + fixed)
    path = tmp_path / "plate.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=r"plate.*<compiler balanceinertia"):
        read_robot(path)
    balanced = '<robot name="plain"><mujoco><compiler balanceinertia="true"/></mujoco>'
    path.write_text(text.replace('<robot name="plain">', balanced), encoding="utf-8")
    assert read_robot(path).arm.links[2].mass == 3.0


def test_a_urdf_link_with_two_parents_is_a_closed_loop(tmp_path):
    """The loop is named."""
    extra = '<joint name="back" type="fixed"><parent link="base"/><child link="three"/></joint></robot>'
    path = tmp_path / "loop.urdf"
    path.write_text(URDF.replace("</robot>", extra), encoding="utf-8")
    with pytest.raises(DataError, match="closed loop"):
        read_robot(path)


def test_constraints_within_one_link_are_no_loop(tmp_path):
    """A gripper's own closed linkage rides on the last link."""
    grip = LOOP.replace('body1="wrist" body2="stand"', 'body1="wrist" body2="finger"')
    assert read_robot(write_mjcf(tmp_path, ("</mujoco>", grip)), **TIP).arm.dof == 4


def test_without_mujoco_the_extra_is_named(tmp_path, monkeypatch):
    """The error says which extra to install."""
    path = write_mjcf(tmp_path)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"gpcorrect\[mujoco\]"):
        read_robot(path, tool="tip")


def test_only_robot_files_are_taken_for_robot_files():
    """By their ending."""
    assert [is_robot_file(f"arm{end}") for end in (".xml", ".urdf", ".MJCF", ".toml")] == [True, True, True, False]


def test_an_edited_file_reads_back_as_edited(tmp_path):
    """Friction, damping, limits, range, payload and a moved joint are in the written file; the input stays."""
    path = write_mjcf(tmp_path)
    before, text = read_robot(path, **TIP), path.read_text()
    edit = RobotEdit(path, tool="tip")
    edit.add_friction(2, 0.5)
    edit.add_damping(1, 2.0)
    assert edit.limit_torque(3, 20.0)
    edit.limit_range(1, "upper", 1.25)
    edit.add_payload(0.3)
    motion = np.array([[1, 0, 0, 0.01], [0, 0.8, -0.6, 0.02], [0, 0.6, 0.8, 0.03], [0, 0, 0, 1]])
    assert edit.move_joint(2, motion)
    (tmp_path / "new").mkdir()
    edit.write(tmp_path / "new" / "small.xml")
    after = read_robot(tmp_path / "new" / "small.xml", **TIP)
    assert path.read_text() == text
    np.testing.assert_allclose(after.drives.friction, before.drives.friction + np.array([0, 0.5, 0, 0]))
    np.testing.assert_allclose(after.drives.damping, before.drives.damping + np.array([2, 0, 0, 0]))
    np.testing.assert_allclose(after.drives.limit, [np.inf, 60, 20, np.inf])
    np.testing.assert_allclose(after.arm.limits[0], [-2.5, 1.25])
    assert after.arm.links[-1].mass == pytest.approx(before.arm.links[-1].mass + 0.3)
    rows, q = list(before.arm.chain.joints), np.array([0.3, -0.4, 0.1, 0.7])
    rows[1] = replace(rows[1], placement=rows[1].placement @ motion)
    expected = replace(before.arm.chain, joints=tuple(rows)).forward(q)
    np.testing.assert_allclose(after.arm.chain.forward(q), expected, atol=5e-6)  # MuJoCo writes six digits


@pytest.mark.parametrize("direction", ["0 0 0.3", "0.3 0 0", "-0.1 0.2 0.3"])
def test_the_length_of_a_row_is_that_of_the_link(direction, tmp_path):
    """Between parallel axes x points from one to the other, however the file turns its frames: links grow along it."""
    path, longer = tmp_path / "planar.xml", tmp_path / "longer.xml"
    for file, scale in ((path, 1.0), (longer, 1.01)):
        moved = " ".join(str(scale * float(v)) for v in direction.split())
        file.write_text(PLANAR.format(moved))
    here, there = (read_robot(file).arm.chain for file in (path, longer))
    x, y, z = (0.01 * float(v) for v in direction.split())  # across the axes, which are along y, and along them
    for q in ([0.2, 0.5], [-1.0, 1.2]):
        away = []
        for a, d in itertools.product((-np.hypot(x, z), np.hypot(x, z)), (-y, y)):
            changed = replace(here, joints=(here.joints[0], replace(here.joints[1], a=a, d=d)))
            away.append(np.abs(changed.forward(q) - there.forward(q)).max())
        assert min(away) < 1e-9


def test_a_damping_ratio_stays_the_damping_it_was(tmp_path):
    """A servo whose damping MuJoCo takes of the arm's inertia keeps its own when a payload is added."""
    path = write_mjcf(tmp_path, ('kp="800" kv="60"', 'kp="800" dampratio="1"'))
    before, edit = read_robot(path, **TIP).drives.kv, RobotEdit(path, tool="tip")
    edit.add_payload(2.0)
    edit.write(tmp_path / "new.xml")
    np.testing.assert_allclose(read_robot(tmp_path / "new.xml", **TIP).drives.kv, before, rtol=1e-5)


def test_the_file_that_was_read_is_not_written_over(tmp_path):
    """Writing to the same path is refused."""
    path = write_mjcf(tmp_path)
    with pytest.raises(DataError, match="another output folder"):
        RobotEdit(path, tool="tip").write(path)
