import tomllib
from dataclasses import replace

import numpy as np
import pytest
from robot_files import write_mjcf, write_urdf

from gpcorrect.arms import RobotEdit
from gpcorrect.errors import DataError
from gpcorrect.sim import effect_from_dict, joint_motion_log, machine_of, model_from_dict, read_model, write_model
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.sim.joint_motion import joint_motion_plan, joint_ranges
from gpcorrect.sim.live_robot import LiveRobot
from gpcorrect.sim.model import model_key, write_completed
from gpcorrect.sim.plant import run

mujoco = pytest.importorskip("mujoco", reason="robot files need mujoco: pip install 'gpcorrect[mujoco]'")

JOINTS = ("pan", "lift", "slide", "roll")
GEAR = np.array([1.0, 1.0, 4.0, 1.0])  # of the small arm's servos: a command to one is in its own length


def small(folder, **keys):
    """Model of the small arm up to its tip."""
    return model_from_dict({"robot": write_mjcf(folder).name, "tool": "tip", **keys}, folder=folder)


def completed(model, folder):
    """Model as its files say, written beside each other into a folder of their own."""
    (folder / "study").mkdir()
    return read_model(write_completed(model, folder / "study" / "model.toml").model)


def mujoco_model(path):
    """MuJoCo's own model of a file without shapes, the finger held."""
    spec = mujoco.MjSpec.from_file(str(path))
    fingers = [joint for joint in spec.joints if joint.name == "grip"]
    for element in [*(g for b in spec.bodies for g in b.geoms if g.meshname), *spec.meshes, *fingers]:
        spec.delete(element)
    for actuator in [a for a in spec.actuators if a.target == "grip"]:
        spec.delete(actuator)
    return spec.compile()


def followed(path, plan, start):
    """Joints `(n, 4)` of MuJoCo's arm under the servo commands of a plan's first run, from rest at `start` (4,)."""
    model = mujoco_model(path)
    data, step = mujoco.MjData(model), model.opt.timestep
    data.qpos[:] = start
    spline, stride, path = plan.spline(), round(1.0 / (plan.rate_hz * step)), []
    for i in range(len(plan.q)):
        path.append(data.qpos.copy())
        for part in range(stride):
            data.ctrl[:] = GEAR * spline(i / plan.rate_hz + part * step)[0]
            mujoco.mj_step(model, data)
    return np.array(path)


def plan_for(model, seconds=8.0):
    return joint_motion_plan(joint_ranges(model), 1, seconds, 100.0, np.random.default_rng(0))


def test_inverse_dynamics_are_mujocos(tmp_path):
    """Gravity, inertia with products, velocity terms and springs of random states agree with mj_inverse to 1e-9."""
    machine, model = machine_of(small(tmp_path)), mujoco_model(tmp_path / "small.xml")
    flags = mujoco.mjtDisableBit
    model.opt.disableflags |= flags.mjDSBL_FRICTIONLOSS | flags.mjDSBL_LIMIT | flags.mjDSBL_DAMPER
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    for q, velocity, acceleration in rng.uniform(-1, 1, (20, 3, 4)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, velocity, acceleration
        mujoco.mj_inverse(model, data)
        still, moving = posture_at(machine.body, q[None, None]).loads(velocity[None, None], acceleration[None, None])
        torque = (still + moving)[0, 0] + machine.drive.motor_inertia * acceleration
        np.testing.assert_allclose(torque, data.qfrc_inverse, atol=1e-9)


def test_springs_hold_an_arm_whose_links_weigh_nothing(tmp_path):
    """As the same springs of the arm with weight do, where gravity is off."""
    model = small(tmp_path, gravity=[0, 0, 0])
    weightless = small(tmp_path, gravity=[0, 0, 0], links={"mass": [0.0], "com": [[0, 0, 0]]})
    q = np.array([[[0.4, -0.3, 0.05, 1.0]]])
    loads = [posture_at(machine_of(m).body, q).gravity_load()[0, 0] for m in (model, weightless)]
    np.testing.assert_allclose(loads[1], [0.0, 0.0, 40.0 * (0.05 - 0.02), 0.0], atol=1e-12)
    np.testing.assert_allclose(loads[1], loads[0], atol=1e-12)


@pytest.mark.parametrize("friction", ["", ' frictionloss="0.2"'])
@pytest.mark.parametrize("integrator", ["implicitfast", "Euler"])
def test_the_simulator_moves_as_mujoco_does(tmp_path, integrator, friction):
    """Both follow the same commands within 2e-6 rad and m, though the servos lag and sag; so with soft friction."""
    path = write_mjcf(tmp_path, (' frictionloss="0.2"', friction), ("implicitfast", integrator))
    model = model_from_dict({"robot": path.name, "tool": "tip"}, folder=tmp_path)
    plan = plan_for(model)
    ours = run(machine_of(model), plan).q[:, 0]
    theirs = followed(path, plan, ours[0])
    assert np.abs(theirs - plan.q[:, 0]).max() > 0.05
    np.testing.assert_allclose(ours, theirs, atol=2e-6)


GRIP, GRIP_SERVO = '<joint name="grip" type="slide" axis="0 1 0" range="0 0.04"/>', '<position joint="grip" kp="10"/>'
SOFTNESS = [
    "",
    ' solreffriction="0.05 1" solimpfriction="0.3 0.4 0.01"',
    ' solreffriction="-100 -60" solimpfriction="0.5 0.9 0.001 0.5 2"',
    ' solreffriction="0.0005 1" solimpfriction="0.99 0.99 0.001 0.5 2"',
    ' solreffriction="0.02 1" solimpfriction="0.8 0.95 0 0.5 2"',
]
ONE_JOINT = """
<mujoco><option timestep="0.001" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody><body name="link">
    <inertial pos="0 0 0.1" mass="1" diaginertia="0.05 0.05 0.05"/>
    <joint name="turn" axis="0 0 1" range="-2 2" armature="0.25" damping="0.5" frictionloss="0.8"{softness}/>
  </body></worldbody>
  <actuator><position joint="turn" kp="500" kv="30"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("softness", SOFTNESS, ids=["default", "softer", "direct", "hardest", "flat"])
def test_friction_of_one_joint_is_mujocos(tmp_path, softness):
    """A joint alone creeps, slips and turns round under MuJoCo's friction loss as it does in MuJoCo, to 1e-8 rad."""
    (tmp_path / "one.xml").write_text(ONE_JOINT.format(softness=softness))
    model = model_from_dict({"robot": "one.xml"}, folder=tmp_path)
    plan = plan_for(model)
    ours = run(machine_of(model), plan).q[:, 0, 0]
    theirs, spline = mujoco.MjModel.from_xml_path(str(tmp_path / "one.xml")), plan.spline()
    data, path = mujoco.MjData(theirs), []
    data.qpos[:] = ours[0]
    for i in range(10 * len(plan.q)):
        path.append(data.qpos[0])
        data.ctrl[:] = spline(i * 1e-3)[0]
        mujoco.mj_step(theirs, data)
    np.testing.assert_allclose(ours, path[::10], atol=1e-8)


@pytest.mark.parametrize("softness", SOFTNESS[:3], ids=["default", "softer", "direct"])
@pytest.mark.parametrize(("integrator", "within"), [("Euler", 2e-6), ("implicitfast", 1e-4)])
def test_friction_of_an_arm_is_as_soft_as_mujocos(tmp_path, softness, integrator, within):
    """With friction in every joint both stay that near, rad and m; dry friction of the same size is 1e-3 away.

    What an implicit `kv` takes of the acceleration in a step depends on the joint's inertia, which the loop has as a
    mean. The finger is left out, for MuJoCo's R counts by what moves.
    """
    places = ('armature="0.1" damping="0.5"', 'armature="0.08" frictionloss="0.2"', 'armature="2"', 'armature="0.02"')
    losses = zip(places, (3.0, 2.0, 4.0, 0.2), strict=True)
    rough = [(old, old.replace(' frictionloss="0.2"', "") + f' frictionloss="{f}"{softness}') for old, f in losses]
    path = write_mjcf(tmp_path, *rough, (GRIP, ""), (GRIP_SERVO, ""), ("implicitfast", integrator))
    model = model_from_dict({"robot": path.name, "tool": "tip"}, folder=tmp_path)
    plan, machine = plan_for(model), machine_of(model)
    ours = run(machine, plan).q[:, 0]
    dry = run(replace(machine, drive=replace(machine.drive, onset=None)), plan).q[:, 0]
    theirs = followed(path, plan, ours[0])
    np.testing.assert_allclose(ours, theirs, atol=within)
    assert np.abs(dry - theirs).max() > 1e-3


def test_saturated_servos_move_as_mujocos_do(tmp_path):
    """A force range cuts a servo's whole torque, its damping too: within 1e-3 rad of MuJoCo, of a lag of 0.06."""
    limited = ('joint="pan" kp="900" kv="60"', 'joint="pan" kp="900" kv="60" forcerange="-4 4"')
    path = write_mjcf(tmp_path, (' frictionloss="0.2"', ""), limited)
    model = model_from_dict({"robot": path.name, "tool": "tip"}, folder=tmp_path)
    plan = plan_for(model)
    ours = run(machine_of(model), plan)
    assert np.abs(ours.torque[:, 0, 0]).max() > 4.2
    np.testing.assert_allclose(ours.q[:, 0], followed(path, plan, ours.q[0, 0]), atol=1e-3)


FOUND = [
    {"name": "coulomb_friction", "joint": 1, "torque": 5.0},
    {"name": "coulomb_friction", "joint": 4, "torque": 0.2, "side": "joint"},
    {"name": "viscous_friction", "joint": 2, "damping": 6.0},
    {"name": "payload", "joint": "all", "mass": 0.4},
    {"name": "dh_error", "joint": 2, "a": 0.01, "alpha": 0.02, "d": -0.01, "theta": 0.03},
    {"name": "inertia_error", "joint": 2, "inertia": 0.3},
    {"name": "link_mass_error", "joint": 2, "mass": 0.5},
    {"name": "missing_friction", "joint": 1, "part": 0.4, "term": "viscous"},
    {"name": "joint_spring", "joint": 2, "stiffness": 20.0, "push": 8.0},
    {"name": "joint_spring", "joint": 2, "stiffness": 5.0, "push": -1.0},
    {"name": "joint_spring", "joint": 4, "stiffness": 1.5, "push": -0.45},
    {"name": "gravity_error", "joint": "base", "x": 0.4, "y": -0.6, "z": 0.1},
    {"name": "backlash", "joint": 1, "radius": 0.003},
    {"name": "coulomb_friction", "joint": 2, "torque": 1.0, "rest": "soft", "onset": 0.01},
    {"name": "payload", "joint": "all", "mass": 0.3, "x": 0.12, "y": -0.08, "z": 0.1, "place": "beside"},
]


def test_effects_are_written_in_the_files_own_words_and_both_simulators_agree(tmp_path):
    """What was found is in the new robot file, the rest beside it; MuJoCo moves that file within 5e-5 rad of ours.

    The effects move the arm by a hundred times that.
    """
    nominal = small(tmp_path)
    model = nominal.with_effects(*map(effect_from_dict, FOUND))
    (tmp_path / "study").mkdir()
    written = write_completed(model, tmp_path / "study" / "model.toml")
    again, document = read_model(written.model), tomllib.loads(written.model.read_text())
    assert document["robot"] == "model.xml"
    assert [e["name"] for e in document["effects"]] == ["backlash"]
    plan = plan_for(again)
    before, ours = (run(machine_of(m.with_effects()), plan).q[:, 0] for m in (nominal, again))
    assert np.abs(ours - before).max() > 5e-3
    np.testing.assert_allclose(ours, followed(written.robot, plan, ours[0]), atol=5e-5)
    without = model.with_effects(*(e for e in model.effects if e.about.name != "backlash"))
    np.testing.assert_allclose(run(machine_of(without), plan).q[:, 0], ours, atol=2e-5)  # six digits in the file


def test_friction_behind_a_soft_transmission_stays_beside_the_file(tmp_path):
    """A robot file has no friction behind a cable: on the far side of one that stretches, friction stays an effect."""
    effects = [
        {"name": "coulomb_friction", "joint": 1, "torque": 2.0, "side": "joint"},
        {"name": "coulomb_friction", "joint": 2, "torque": 2.0, "side": "motor"},
        {"name": "cable_stretch", "joint": 1, "stiffness": 200.0},
        {"name": "cable_stretch", "joint": 2, "stiffness": 200.0},
    ]
    model = small(tmp_path).with_effects(*map(effect_from_dict, effects))
    again = completed(model, tmp_path)
    assert [(e.about.name, e.joint) for e in again.effects] == [
        ("coulomb_friction", 1),
        ("cable_stretch", 1),
        ("cable_stretch", 2),
    ]


def test_friction_that_bends_stays_beside_the_file(tmp_path):
    """MuJoCo's friction does not bend before it slips: written as a frictionloss it would be another one."""
    friction = {"name": "coulomb_friction", "joint": 1, "torque": 2.0, "rest": "elastic", "bristle": 100.0}
    model = small(tmp_path).with_effects(effect_from_dict(friction))
    again = completed(model, tmp_path)
    assert again.effects == model.effects


UNSERVED = [
    ('<position joint="pan" kp="900" kv="60"/>', ""),
    ('<position joint="lift" kp="800" kv="60" forcerange="-60 60"/>', ""),
    ('<position joint="slide" kp="250" kv="20" gear="4"/>', ""),
    ('<position joint="roll" kp="60" kv="4"/>', ""),
]


@pytest.mark.parametrize("loaded", [False, True])
def test_a_controller_that_holds_the_arm_up_where_it_is_moves_it_as_in_mujoco(tmp_path, loaded):
    """MuJoCo's arm under the same law, torques by its own gravity, also with a load that the controller ignores."""
    kp, kd = np.array([900.0, 800.0, 4000.0, 60.0]), np.array([60.0, 60.0, 320.0, 4.0])
    model = model_from_dict(
        {
            "robot": write_mjcf(tmp_path, *UNSERVED, ("implicitfast", "Euler")).name,
            "tool": "tip",
            "controller": {"kp": kp.tolist(), "kd": kd.tolist(), "feedforward": "gravity-measured"},
        },
        folder=tmp_path,
    )
    plan, known = plan_for(model, seconds=4.0), mujoco_model(tmp_path / "small.xml")
    edit = RobotEdit(tmp_path / "small.xml", tool="tip")
    if loaded:
        edit.add_payload(0.4)
    edit.write(tmp_path / "true.xml")
    true = mujoco_model(tmp_path / "true.xml")
    ours = run(machine_of(model.with_effects(*[effect_from_dict(FOUND[3])] if loaded else [])), plan).q[:, 0]
    data, held, spline, step = mujoco.MjData(true), mujoco.MjData(known), plan.spline(), true.opt.timestep
    data.qpos[:], path = ours[0], []
    for i in range(10 * len(plan.q)):
        path.append(data.qpos.copy())
        held.qpos[:] = data.qpos
        mujoco.mj_forward(known, held)
        wanted, rate = spline(i * step)[0], spline(i * step, 1)[0]
        data.qfrc_applied[:] = kp * (wanted - data.qpos) + kd * (rate - data.qvel) + held.qfrc_bias - held.qfrc_spring
        mujoco.mj_step(true, data)
    np.testing.assert_allclose(ours, path[::10], atol=5e-6)
    assert np.abs(ours - plan.q[:, 0]).max() > (1e-3 if loaded else 1e-4)


def test_what_a_controller_would_feed_forward_stays_beside_the_file(tmp_path):
    """A payload in the robot file would be known to a controller that computes torques from it, as it was not."""
    gains = {"kp": [900.0, 800.0, 4000.0, 60.0], "kd": [60.0, 60.0, 320.0, 4.0], "feedforward": "rigid-body"}
    model = small(tmp_path, controller=gains).with_effects(effect_from_dict(FOUND[3]), effect_from_dict(FOUND[4]))
    again = completed(model, tmp_path)
    assert again.effects == model.effects


def test_a_motor_whose_inertia_the_model_states_stays_beside_the_file(tmp_path):
    """With a `[transmission]` the file's `armature` is not read: written there, the effect would be lost."""
    gains = {"kp": [900.0, 800.0, 4000.0, 60.0], "kd": [60.0, 60.0, 320.0, 4.0]}
    stated = {"motor_inertia": [0.3, 0.3, 2.0, 0.01]}
    heavier = effect_from_dict({"name": "inertia_error", "joint": 2, "inertia": 0.3})
    model = small(tmp_path, controller=gains, transmission=stated).with_effects(heavier)
    assert completed(model, tmp_path).effects == (heavier,)


def test_a_stop_moves_the_range_and_keeps_its_stiffness(tmp_path):
    """The range of the file ends where the stop was found; the stop stays an effect."""
    stop = {"name": "joint_stop", "joint": 1, "stiffness": 300.0, "limit": 0.8, "end": "upper"}
    model = small(tmp_path).with_effects(effect_from_dict(stop))
    again = completed(model, tmp_path)
    assert again.effects == model.effects
    np.testing.assert_allclose(machine_of(again).description.limits[0], [-2.5, 0.8])


def test_a_urdf_runs_with_the_controller_of_a_model_file(tmp_path):
    """A URDF has no servo: gains come from the model file, or are those of a fast loop around its inertia."""
    write_urdf(tmp_path)
    bare = read_model(tmp_path / "plain.urdf")
    assert len(joint_motion_log(bare, 2, 4.0)) == 800
    gains = {"kp": [2000.0, 2000.0, 5000.0], "kd": [200.0, 200.0, 500.0]}
    known = model_from_dict({"robot": "plain.urdf", "controller": gains}, folder=tmp_path)
    np.testing.assert_allclose(machine_of(known).drive.kp, gains["kp"])
    np.testing.assert_allclose(machine_of(known).drive.friction, 0.3)


def test_joints_are_names_or_numbers(tmp_path):
    """Names become numbers from the base on; the others are held at rest."""
    by_name = small(tmp_path, joints=["lift", "roll"])
    assert by_name.joints == (2, 4)
    assert small(tmp_path, joints=[2, 4]).joints == (2, 4)
    assert small(tmp_path).joints == (1, 2, 3, 4)
    assert machine_of(by_name).body.types == "RR"


def test_a_model_file_names_its_robot_file_relative_to_itself(tmp_path):
    """Written anywhere, it reads back as the same model."""
    model = small(tmp_path, payload=0.2)
    (tmp_path / "a" / "b").mkdir(parents=True)
    write_model(model, tmp_path / "a" / "b" / "model.toml")
    assert tomllib.loads((tmp_path / "a" / "b" / "model.toml").read_text())["robot"] == "../../small.xml"
    assert model_key(read_model(tmp_path / "a" / "b" / "model.toml")).endswith(model_key(model)[-64:])


def test_the_key_of_a_model_changes_with_its_robot_file(tmp_path):
    """Another mass in the same file is another model."""
    before = model_key(small(tmp_path))
    write_mjcf(tmp_path, ('mass="1.5"', 'mass="1.6"'))
    after = model_key(model_from_dict({"robot": "small.xml", "tool": "tip"}, folder=tmp_path))
    assert before != after


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"joints": ["lift", "wave"]}, "no joint 'wave'"),
        ({"joints": [2, 7]}, "numbers from 1 to 4"),
        ({"theta_offset_deg": [0.0, 0.0, 0.0, 0.0]}, "Denavit-Hartenberg tables"),
        ({"robot": "absent.xml"}, "cannot read the robot file .*absent.xml"),
    ],
)
def test_bad_robot_keys_are_refused(tmp_path, keys, message):
    """An unknown name or number and a missing file are named."""
    with pytest.raises(DataError, match=message):
        machine_of(small(tmp_path, **keys))


def test_a_tool_without_a_robot_file_is_refused():
    """Tool and base are of a robot file."""
    with pytest.raises(DataError, match="of a robot file"):
        model_from_dict({"arm": "dvrk_psm", "joints": [1], "tool": "tip"})


def test_a_live_robot_of_a_robot_file_goes_to_joints_and_poses(tmp_path):
    """The simulated controller takes the file's limits, and reaches poses by the numerical inverse."""
    path = write_mjcf(tmp_path, (' type="slide" axis="1 0 0.2" range="-0.1 0.2"', ' axis="1 0 0.2" range="-1 1"'))
    robot = LiveRobot(
        machine_of(model_from_dict({"robot": path.name, "tool": "tip"}, folder=tmp_path)), np.random.default_rng(0)
    )
    robot.operate("enable")
    robot.operate("home")
    goal = robot.setpoint + 0.05
    robot.move_jp(goal)
    robot.advance(6.0)
    np.testing.assert_allclose(robot.setpoint, goal)
    with pytest.raises(DataError, match="beyond its limits"):
        robot.move_jp(np.full(4, 9.0))


def test_servos_of_a_file_need_no_gains_of_ours(tmp_path):
    """A file's servos stay where neither rotor nor links have inertia to choose gains by; a payload makes it move.

    Without one there is nothing to accelerate, which is said.
    """
    rotors = [(f' armature="{value}"', "") for value in ("0.1", "0.08", "2", "0.02")]
    keys = {"robot": write_mjcf(tmp_path, *rotors).name, "tool": "tip", "links": {"mass": [0.0], "com": [[0, 0, 0]]}}
    massless, loaded = (model_from_dict({**keys, "payload": kg}, folder=tmp_path) for kg in (0.0, 0.5))
    np.testing.assert_allclose(machine_of(massless).drive.kp, [900.0, 800.0, 4000.0, 60.0])
    assert len(joint_motion_log(loaded, 1, 1.0)) == 100
    with pytest.raises(DataError, match="column 1 has no inertia"):
        joint_motion_log(massless, 1, 1.0)
