"""From a model file to the machine it describes, with the arm's own numbers where the file is silent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Arm, Chain, arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body, Links
from gpcorrect.sim.defaults import default_controller, motor_inertia
from gpcorrect.sim.effects import ChainEffect, LoadEffect, TipEffect
from gpcorrect.sim.machine import Drive, Machine
from gpcorrect.sim.model import LinkTable, Model, Pose
from gpcorrect.sim.settings import Noise, TrackerFaults
from gpcorrect.types import FloatArray

__all__ = ["BARE_JOINTS", "machine_of"]

BARE_JOINTS = "joints"


def machine_of(model: Model) -> Machine:
    """Return the machine that a model describes.

    Raises
    ------
    DataError
        A list has not one number a joint, or a name is unknown.
    """
    body = _bare_body(model) if model.arm == BARE_JOINTS else _arm_body(model, arm_named(model.arm))
    dof = len(body.joints)
    if model.noise is not None:
        for name in ("external_jp_white", "external_jp_ar_std", "encoder_step"):
            _check_length(f"noise.{name}", getattr(model.noise, name), dof, optional=True)
    if body.chain is None:
        _check_no_arm_effects(model)
    return Machine(
        arm=model.arm,
        body=body,
        drive=_drive(model, body),
        log_rate_hz=model.log_rate_hz,
        effects=model.effects,
        noise=model.noise or Noise(),
        faults=model.faults or TrackerFaults(),
        T_tracker_base=_matrix(model.T_tracker_base),
        T_tip_marker=_matrix(model.T_tip_marker),
    )


def _check_no_arm_effects(model: Model) -> None:
    for effect in model.effects:
        if isinstance(effect, LoadEffect | ChainEffect | TipEffect):
            raise DataError(
                f"effect {effect.about.name} needs an arm, the model has bare joints.",
                hint="Name the arm, or leave the effect out.",
            )


def _drive(model: Model, body: Body) -> Drive:
    inertia = (
        motor_inertia(model.arm, body)
        if model.transmission is None
        else _check_length("transmission.motor_inertia", model.transmission.motor_inertia, len(body.joints))
    )
    controller = model.controller or default_controller(inertia)
    return Drive(
        kp=_check_length("controller.kp", controller.kp, len(inertia)),
        kd=_check_length("controller.kd", controller.kd, len(inertia)),
        motor_inertia=inertia,
        rate_hz=controller.rate_hz,
        feedforward=controller.feedforward,
    )


def _bare_body(model: Model) -> Body:
    types = model.joint_types or "R" * len(model.joints)
    if len(types) != len(model.joints):
        raise DataError(f"joint_types has {len(types)} letters, the model has {len(model.joints)} joints.")
    return Body(model.joints, types, None, np.zeros(0), Links.none(), np.zeros(3))


def _arm_body(model: Model, arm: Arm) -> Body:
    if max(model.joints) > arm.dof or len(set(model.joints)) != len(model.joints):
        raise DataError(f"joints must be different numbers from 1 to {arm.dof}, got {list(model.joints)}.")
    others = [i for i in range(arm.dof) if i + 1 not in model.joints]
    held = arm.home[others] if model.wrist is None else _held(model.wrist, others)
    types = "".join(arm.joint_types[number - 1] for number in model.joints)
    if model.joint_types not in (None, types):
        raise DataError(f"joint_types {model.joint_types} contradicts {model.arm}, whose joints are {types}.")
    gravity = arm.gravity if model.gravity is None else np.array(model.gravity)
    return Body(model.joints, types, _chain(model, arm), held, _links(model, arm), gravity)


def _held(wrist: tuple[float, ...], others: list[int]) -> FloatArray:
    """Values of the other joints; a `wrist` that no joint is left for says nothing."""
    if not others:
        return np.zeros(0)
    return _check_length("wrist", wrist, len(others))


def _chain(model: Model, arm: Arm) -> Chain:
    if model.theta_offset_deg is None:
        return arm.chain
    offsets = np.deg2rad(_check_length("theta_offset_deg", model.theta_offset_deg, arm.dof))
    rows = zip(arm.chain.joints, offsets, strict=True)
    joints = tuple(replace(row, theta=float(theta)) if row.kind == "R" else row for row, theta in rows)
    return replace(arm.chain, joints=joints)


def _links(model: Model, arm: Arm) -> Links:
    payload = np.array([model.payload])
    if model.links is not None:
        return _links_of_table(model.links, payload, arm.dof)
    mass = np.array([link.mass for link in arm.links])
    com = np.array([link.com for link in arm.links]).reshape(-1, 3)
    return Links(mass, com, np.zeros(com.shape), payload)


def _links_of_table(table: LinkTable, payload: FloatArray, dof: int) -> Links:
    if len(table.mass) > dof:
        raise DataError(f"links.mass has {len(table.mass)} numbers, the arm has {dof} links.")
    com = np.array(table.com).reshape(-1, 3)
    moments = np.zeros(com.shape) if table.inertia_diagonal is None else np.array(table.inertia_diagonal).reshape(-1, 3)
    return Links(np.array(table.mass), com, moments, payload)


def _matrix(pose: Pose | None) -> FloatArray:
    if pose is None:
        return np.eye(4)
    return se3.pose(se3.matrix_from_rotvec(np.array(pose.rotvec)), np.array(pose.translation))


def _check_length(name: str, values: tuple[float, ...], wanted: int, *, optional: bool = False) -> FloatArray:
    if len(values) != wanted and not (optional and not values):
        raise DataError(f"{name} must have {wanted} numbers, one a joint, got {len(values)}.")
    return np.array(values, dtype=np.float64)
