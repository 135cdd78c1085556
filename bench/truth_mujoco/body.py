"""An arm and its drives as a MuJoCo model, built link by link with MjSpec."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truth_mujoco.arms import Arm

if TYPE_CHECKING:
    from truth_mujoco.plant import Plant

Array = NDArray[np.float64]

STEP, SUBSTEPS = 0.5e-3, 2  # s, and steps of a control period
PAYLOAD = "payload"
TINY = 1e-6  # kg of an empty payload that a bending shaft carries
# Friction as hard as MuJoCo allows: a joint that sticks creeps by a part in 1e4 of its free acceleration
FRICTION_SOLREF, FRICTION_SOLIMP = (0.001, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
CABLE_DAMPING = 0.12  # of critical, on the link's inertia; steel rope on pulleys
TOOL_ARMATURE = 0.02  # kg that the bending shaft moves along without a weight; only slows its ringing down


def _shift(x: float, z: float) -> Array:
    T = np.eye(4)
    T[0, 3], T[2, 3] = x, z
    return T


def _turn(axis: str, angle: float) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return T


def _row(row: Array, modified: bool) -> tuple[Array, Array]:
    """Return transforms before and after the joint's own motion along or about z."""
    alpha, a, d, theta = row
    along, across = _turn("z", theta) @ _shift(0.0, d), _shift(a, 0.0) @ _turn("x", alpha)
    return (across @ along, np.eye(4)) if modified else (along, across)


def link_frame(arm: Arm, rows: Array, j: int) -> Array:
    """Return the frame `(4, 4)` of a link in its body's frame."""
    return _row(rows[j], arm.modified)[1]


def _place(body: mujoco.MjsBody, T: Array) -> None:
    body.pos = T[:3, 3]
    body.quat = Rotation.from_matrix(T[:3, :3]).as_quat()[[3, 0, 1, 2]]


def _weigh(body: mujoco.MjsBody, frame: Array, mass: float, centre: Array, moment: Array) -> None:
    body.explicitinertial = True
    body.mass, body.inertia = mass, moment
    body.ipos = (frame @ np.append(centre, 1.0))[:3]
    body.iquat = Rotation.from_matrix(frame[:3, :3]).as_quat()[[3, 0, 1, 2]]


def _skeleton(arm: Arm, rows: Array, gravity: Array, bends: Array | None = None) -> mujoco.MjSpec:
    """Return links, held joints and the place of the payload at the tip; no drives yet."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = STEP
    spec.option.gravity = gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    parent, after = spec.worldbody, _turn("x", arm.base_turn)
    for i, row in enumerate(rows):
        before, beyond = _row(row, arm.modified)
        body = parent.add_body(name=f"link{i + 1}")
        _place(body, after @ before)
        if i < arm.dof:
            kind = mujoco.mjtJoint.mjJNT_HINGE if arm.types[i] == "R" else mujoco.mjtJoint.mjJNT_SLIDE
            body.add_joint(name=f"joint{i + 1}", type=kind, axis=[0, 0, 1])
            _weigh(body, beyond, arm.mass[i], arm.centre[i], arm.moment[i])
        parent, after = body, beyond
    tip = parent.add_body(name="tip")
    _place(tip, after @ _turn("z", arm.tool_turns[0]) @ _turn("x", arm.tool_turns[1]))
    payload = tip.add_body(name=PAYLOAD)
    payload.explicitinertial = True
    if bends is not None:
        payload.mass, payload.inertia = TINY, np.full(3, TINY)
        for i, axis in enumerate(bends):
            payload.add_joint(name=f"bend{i}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, armature=TOOL_ARMATURE)
    return spec


def nominal_model(arm: Arm, gravity: Array) -> mujoco.MjModel:
    """Return the arm as its controller knows it: the motors' inertia as armature, no friction."""
    return _nominal(arm, gravity).compile()


def robot_xml(arm: Arm, gravity: Array) -> str:
    """Return the same as an MJCF file with joint limits, for models that are robot files; the tool is the body `tip`.

    A joint may go half as far again as it does.
    """
    spec = _nominal(arm, gravity)
    for j, (low, high) in enumerate(arm.ranges):
        joint, more = spec.joint(f"joint{j + 1}"), 0.25 * (high - low)
        joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, [low - more, high + more]
    spec.compile()
    return str(spec.to_xml())


def _nominal(arm: Arm, gravity: Array) -> mujoco.MjSpec:
    spec = _skeleton(arm, arm.rows, gravity)
    for j in range(arm.dof):
        spec.joint(f"joint{j + 1}").armature = arm.motor_inertia[j]
    return spec


def kinematics(arm: Arm, rows: Array) -> mujoco.MjModel:
    """Return the arm with another table, for poses and for the load that its links ask of the joints."""
    return _skeleton(arm, rows, arm.gravity).compile()


def tips(model: mujoco.MjModel, q: Array) -> Array:
    """Tool poses `(n, 4, 4)` of joint values `(n, k)`."""
    data, tip = mujoco.MjData(model), model.body("tip").id
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for i, values in enumerate(q):
        data.qpos[: len(values)] = values
        mujoco.mj_kinematics(model, data)
        T[i, :3, 3], T[i, :3, :3] = data.xpos[tip], data.xmat[tip].reshape(3, 3)
    return T


def compiled(plant: Plant) -> mujoco.MjModel:
    """Return links and drives: a rigid drive is its link's armature, an elastic one a rotor on a tendon."""
    arm = plant.arm
    spec = _skeleton(arm, plant.rows, plant.gravity, bends=plant.bends)

    for j in range(arm.dof):
        link = spec.joint(f"joint{j + 1}")
        motor = link
        if plant.elastic[j]:
            rotor = spec.worldbody.add_body(name=f"rotor{j + 1}", gravcomp=1.0)
            rotor.explicitinertial = True
            rotor.mass, rotor.inertia = arm.motor_inertia[j], np.full(3, arm.motor_inertia[j])
            motor = rotor.add_joint(name=f"motor{j + 1}", type=link.type, axis=[0, 0, 1])
            _tendon(spec, plant, j)
        else:
            motor.armature = arm.motor_inertia[j]
        motor.frictionloss = plant.friction_start(j)
        motor.solref_friction, motor.solimp_friction = FRICTION_SOLREF, FRICTION_SOLIMP
        motor.damping = [plant.viscous[j], 0.0, 0.0]
        drive = spec.add_actuator(name=f"drive{j + 1}", target=motor.name)
        drive.trntype = mujoco.mjtTrn.mjTRN_JOINT
        if np.isfinite(plant.torque_limit[j]):
            drive.forcelimited, drive.forcerange = 1, plant.torque_limit[j] * np.array([-1.0, 1.0])
        if plant.stop_stiffness[j] > 0:
            _stop(spec, plant, j)
    for shape in plant.shapes:
        shape(spec)
    return spec.compile()


def _spring(tendon: mujoco.MjsTendon, stiffness: float, cubic: float, damping: float) -> None:
    tendon.stiffness, tendon.damping = [stiffness, 0.0, cubic], [damping, 0.0, 0.0]


def _tendon(spec: mujoco.MjSpec, plant: Plant, j: int) -> None:
    """Cable: a tendon as long as motor less link."""
    cable = spec.add_tendon(name=f"cable{j + 1}", springlength=[0.0, 0.0])
    cable.wrap_joint(f"motor{j + 1}", 1.0)
    cable.wrap_joint(f"joint{j + 1}", -1.0)
    k = plant.stiffness[j]
    _spring(cable, k, plant.cubic[j], 2 * CABLE_DAMPING * np.sqrt(k * plant.link_inertia[j]))


def _stop(spec: mujoco.MjSpec, plant: Plant, j: int) -> None:
    """One-sided spring on the link: a tendon whose springlength leaves the free range slack."""
    stop = spec.add_tendon(name=f"stop{j + 1}")
    stop.wrap_joint(f"joint{j + 1}", 1.0)
    far = 1e3
    free = [-far, plant.stop_place[j]] if plant.stop_side[j] > 0 else [plant.stop_place[j], far]
    stop.springlength = free
    _spring(stop, plant.stop_stiffness[j], 0.0, 0.0)
