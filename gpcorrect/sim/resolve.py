"""From a model file to the machine it describes, with the arm's own numbers where the file is silent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Arm, Chain, Robot, arm_named, read_robot
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body, Drive, Links
from gpcorrect.sim.dynamics import mean_inertia
from gpcorrect.sim.effects import ChainEffect, LoadEffect, TipEffect
from gpcorrect.sim.effects.geometry import HomingOffset
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.model import Model, Pose
from gpcorrect.sim.settings import Noise, TrackerFaults
from gpcorrect.types import FloatArray

BARE_JOINTS = "joints"  # the `arm` of a model without kinematics

SPREAD = {"R": np.deg2rad(0.3), "P": 5e-4}  # of a joint's zero from one homing to the next (RAVEN-II calibration paper)
BANDWIDTH_HZ = 10.0  # undamped natural frequency of the closed loop, a common choice for cable-driven arms
DAMPING_RATIO = 1.0  # critical: the fastest loop that does not overshoot
ROTOR_RE40 = 1.42e-5  # kg m^2, catalogue of maxon motors, RE 40 (joints 1 to 3 of RAVEN-II)
ROTOR_RE30 = 3.35e-6  # kg m^2, the same, RE 30 (its tool joints)
TYPICAL = {"R": 0.05, "P": 5.0}  # kg m^2 and kg; chosen by hand where no motor is published, as of a surgical arm


def robot_of(model: Model) -> Robot | None:
    """Return the robot of a model's robot file; None where it names none.

    Parameters
    ----------
    model : Model, as read from a file
    """
    return None if model.robot is None else read_robot(model.robot, tool=model.tool, base=model.base)


def arm_of(model: Model) -> Arm | None:
    """Return the arm that a model names or whose robot file it names; None for bare joints.

    Parameters
    ----------
    model : Model, as read from a file, or packaged

    Raises
    ------
    DataError
        No arm has the name.
    """
    robot = robot_of(model)
    if robot is not None:
        return robot.arm
    return None if model.arm == BARE_JOINTS else arm_named(model.arm)


def has_controller(model: Model) -> bool:
    """Return whether the gains of the servo loop are known: from the model, or its robot file's position servos.

    Parameters
    ----------
    model : Model, as read from a file, or packaged
    """
    robot = robot_of(model)
    known = robot is not None and robot.drives.servo[[number - 1 for number in model.joints]].all()
    return model.controller is not None or bool(known)


def machine_of(model: Model) -> Machine:
    """Return the machine that a model describes.

    Parameters
    ----------
    model : Model, as read from a file, or packaged

    Raises
    ------
    DataError
        A list has not one number a joint, or a name is unknown.
    """
    arm, robot = arm_of(model), robot_of(model)
    body = _bare_body(model) if arm is None else _arm_body(model, arm, robot)
    noise = model.noise or Noise()
    for name in ("external_jp_white", "external_jp_ar_std", "encoder_step"):
        if getattr(noise, name):
            _check_length(f"noise.{name}", getattr(noise, name), len(body.joints))
    for effect in model.effects:
        if body.chain is None and isinstance(effect, LoadEffect | ChainEffect | TipEffect):
            raise DataError(
                f"effect {effect.about.name} needs an arm, the model has bare joints.",
                hint="Name the arm, or leave the effect out.",
            )
    return Machine(
        arm=model.arm,
        body=body,
        drive=_drive(model, body, robot),
        log_rate_hz=model.log_rate_hz,
        effects=model.effects,
        noise=noise,
        faults=model.faults or TrackerFaults(),
        T_tracker_base=_matrix(model.T_tracker_base),
        T_tip_marker=_matrix(model.T_tip_marker),
        description=arm,
    )


def rehomed(model: Model, sessions: int, rng: np.random.Generator) -> Model:
    """Return the model with one homing offset a session on every joint: its own offset plus a new chance each time.

    Parameters
    ----------
    model : Model, the machine
    sessions : int, homings; one leaves the model as it is
    rng : numpy.random.Generator
    """
    if sessions == 1:
        return model
    known = {e.joint: np.atleast_1d(e.offset)[0] for e in model.effects if isinstance(e, HomingOffset)}
    others = [e for e in model.effects if not isinstance(e, HomingOffset)]
    homed = []
    for number, kind in zip(model.joints, machine_of(model.with_effects()).body.types, strict=True):
        offsets = known.get(number, 0.0) + SPREAD[kind] * rng.standard_normal(sessions)
        homed.append(HomingOffset(number, tuple(offsets.tolist())))
    return model.with_effects(*homed, *others)


def _drive(model: Model, body: Body, robot: Robot | None) -> Drive:
    """Drive as the model file says, or else its robot file; where both are silent, gains of the usual bandwidth."""
    dof, columns, controller = len(body.joints), body.columns, model.controller
    if model.transmission is not None:
        inertia = _check_length("transmission.motor_inertia", model.transmission.motor_inertia, dof)
    else:
        inertia = _motor_inertia(model.arm, body) if robot is None else robot.drives.armature[columns]
    if controller is not None:
        kp = _check_length("controller.kp", controller.kp, dof)
        kd = _check_length("controller.kd", controller.kd, dof)
        ki = None if controller.ki is None else _check_length("controller.ki", controller.ki, dof)
        drive = Drive(kp, kd, inertia, controller.rate_hz, controller.feedforward, ki=ki)
    else:
        omega = 2 * np.pi * BANDWIDTH_HZ
        moved = inertia if robot is None else inertia + mean_inertia(body, robot.arm.home[columns][None, None])
        kp, kd = moved * omega**2, 2 * DAMPING_RATIO * omega * moved
        if robot is None:
            return Drive(kp, kd, inertia)
        servo, known = robot.drives.servo[columns], robot.drives
        kp, kd = np.where(servo, known.kp[columns], kp), np.where(servo, 0.0, kd)
        kv = np.where(servo, known.kv[columns], 0.0)
        drive = Drive(kp, kd, inertia, 1.0 / robot.step, kv=kv, brakes_late=robot.brakes_late)
    if robot is None:
        return drive
    known = robot.drives
    friction, damping, limit = known.friction[columns], known.damping[columns], known.limit[columns]
    onset = np.stack([known.onset[columns], known.onset_time[columns]])
    return replace(drive, friction=friction, damping=damping, limit=limit, onset=onset)


def _motor_inertia(arm: str, body: Body) -> FloatArray:
    """Rotor inertia reflected to each moving joint `(dof,)`, kg m^2 or kg."""
    if not arm.startswith("raven2"):
        return np.array([TYPICAL[kind] for kind in body.types])
    transmission = arm_named(arm).transmission
    assert transmission is not None
    reflected: FloatArray = np.array([ROTOR_RE40] * 3 + [ROTOR_RE30] * 3) * transmission.ratios**2
    return reflected[body.columns]


def _bare_body(model: Model) -> Body:
    types = model.joint_types or "R" * len(model.joints)
    if len(types) != len(model.joints):
        raise DataError(f"joint_types has {len(types)} letters, the model has {len(model.joints)} joints.")
    return Body(model.joints, types, None, np.zeros(0), Links.none(), np.zeros(3))


def _arm_body(model: Model, arm: Arm, robot: Robot | None) -> Body:
    if max(model.joints) > arm.dof or len(set(model.joints)) != len(model.joints):
        raise DataError(f"joints must be different numbers from 1 to {arm.dof}, got {list(model.joints)}.")
    others = [i for i in range(arm.dof) if i + 1 not in model.joints]
    held = arm.home[others]
    if model.wrist is not None and others:  # where no joint is left for it, it says nothing
        held = _check_length("wrist", model.wrist, len(others))
    types = "".join(arm.joint_types[number - 1] for number in model.joints)
    if model.joint_types not in (None, types):
        raise DataError(f"joint_types {model.joint_types} contradicts {model.arm}, whose joints are {types}.")
    gravity = arm.gravity if model.gravity is None else np.array(model.gravity)
    if robot is not None and model.theta_offset_deg is not None:
        raise DataError("theta_offset_deg is of Denavit-Hartenberg tables.", hint="Change ref in the robot file.")
    columns = [number - 1 for number in model.joints]
    springs = None if robot is None else np.stack([robot.drives.stiffness[columns], robot.drives.rest[columns]])
    springs = None if springs is None or not springs[0].any() else springs
    return Body(model.joints, types, _chain(model, arm), held, _links(model, arm), gravity, springs)


def _chain(model: Model, arm: Arm) -> Chain:
    if model.theta_offset_deg is None:
        return arm.chain
    offsets = np.deg2rad(_check_length("theta_offset_deg", model.theta_offset_deg, arm.dof))
    rows = zip(arm.chain.joints, offsets, strict=True)
    joints = tuple(replace(row, theta=float(theta)) if row.kind == "R" else row for row, theta in rows)
    return replace(arm.chain, joints=joints)


def _links(model: Model, arm: Arm) -> Links:
    table, payload = model.links, np.array([model.payload])
    if table is None:
        com = np.array([link.com for link in arm.links]).reshape(-1, 3)
        inertia = np.array([link.inertia for link in arm.links]).reshape(-1, 3, 3)
        products = inertia[:, [0, 0, 1], [1, 2, 2]]
        moments = np.diagonal(inertia, axis1=1, axis2=2)
        return Links(np.array([link.mass for link in arm.links]), com, moments, payload, products)
    if len(table.mass) > arm.dof:
        raise DataError(f"links.mass has {len(table.mass)} numbers, the arm has {arm.dof} links.")
    com = np.array(table.com).reshape(-1, 3)
    moments = np.zeros(com.shape) if table.inertia_diagonal is None else np.array(table.inertia_diagonal).reshape(-1, 3)
    return Links(np.array(table.mass), com, moments, payload)


def _matrix(pose: Pose | None) -> FloatArray:
    if pose is None:
        return np.eye(4)
    return se3.pose(se3.matrix_from_rotvec(np.array(pose.rotvec)), np.array(pose.translation))


def _check_length(name: str, values: tuple[float, ...], wanted: int) -> FloatArray:
    if len(values) != wanted:
        raise DataError(f"{name} must have {wanted} numbers, one a joint, got {len(values)}.")
    return np.array(values, dtype=np.float64)
