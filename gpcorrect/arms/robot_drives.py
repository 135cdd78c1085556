"""What MuJoCo's compiled model of a robot file says of the joints' drives: friction, springs, servos and limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.arms.robot_path import ArmPath, friction_onsets, mujoco_library
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray

ROUNDED = 1e-3  # of a joint's range, by which ranges that are meant to be the same differ: 6.2831 beside 2 pi


@dataclass(frozen=True, eq=False)
class JointDrives:
    """What a robot file says of each joint's drive; all arrays `(dof,)`, N m and rad, or N and m.

    Parameters
    ----------
    armature : array, inertia of the rotor, reflected to the joint
    damping, friction : array, viscous damping, and friction of fixed size
    onset : array
        Speed over which the friction grows, rad/s or m/s: MuJoCo's is soft. Below its limit it is
        `friction (v + onset_time v') / onset`.
    onset_time : array, s; both are 0 where there is no friction
    stiffness, rest : array, spring at the joint, and where it is at rest
    kp, kv : array, of a position servo, `torque = kp (command - q) - kv q'`; NaN where the file has none
    limit : array, largest torque or force; infinite where there is none
    """

    armature: FloatArray
    damping: FloatArray
    friction: FloatArray
    onset: FloatArray
    onset_time: FloatArray
    stiffness: FloatArray
    rest: FloatArray
    kp: FloatArray
    kv: FloatArray
    limit: FloatArray

    @property
    def servo(self) -> BoolArray:
        """(dof,) whether the joint has a position servo."""
        return np.isfinite(self.kp)


def drives_of(model: Any, found: ArmPath, limits: FloatArray) -> tuple[JointDrives, list[str]]:
    """Return the drives of an arm's joints, and what of them is not simulated.

    Parameters
    ----------
    model : mujoco.MjModel
    found : ArmPath
    limits : (dof, 2) array, of the joints, rad or m
    """
    ids = list(found.joint_ids)
    dofs = model.jnt_dofadr[ids]
    nothing = np.full(len(ids), np.nan)
    onset, onset_time = friction_onsets(model)[:, dofs]
    drives = JointDrives(
        armature=model.dof_armature[dofs].copy(),
        damping=model.dof_damping[dofs].copy(),
        friction=model.dof_frictionloss[dofs].copy(),
        onset=onset,
        onset_time=onset_time,
        stiffness=model.jnt_stiffness[ids].copy(),
        rest=model.qpos_spring[model.jnt_qposadr[ids]].copy(),
        kp=nothing.copy(),
        kv=nothing.copy(),
        limit=np.full(len(ids), np.inf),
    )
    remarks: list[str] = []
    for column, j in enumerate(ids):
        if model.jnt_actfrclimited[j]:
            what = f"actuatorfrcrange of joint {found.names[column]!r}"
            remarks += _hold_within(drives, column, model.jnt_actfrcrange[j], what)
    kinds = mujoco_library().mjtTrn
    for a in range(model.nu):
        on_joint = int(model.actuator_trntype[a]) in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)
        if on_joint and model.actuator_trnid[a, 0] in ids:
            column = ids.index(model.actuator_trnid[a, 0])
            remarks += _add_actuator(model, a, drives, column, limits[column])
    return drives, remarks


def switched_off(option: Any, group: int) -> bool:
    """Return whether a file's options switch actuators of this group off.

    Parameters
    ----------
    option : mujoco.MjOption, or that of an editable description
    group : int
    """
    every = bool(option.disableflags & mujoco_library().mjtDisableBit.mjDSBL_ACTUATION)
    return every or (group >= 0 and bool(option.disableactuator >> group & 1))


def _add_actuator(model: Any, a: int, drives: JointDrives, column: int, limits: FloatArray) -> list[str]:
    """Add an actuator's numbers to its joint's, and return what of it is not simulated."""
    gear, name = float(model.actuator_gear[a, 0]), f"actuator {model.actuator(a).name!r}"
    drives.armature[column] += gear**2 * model.actuator_armature[a]
    drives.damping[column] += gear**2 * model.actuator_damping[a]
    if switched_off(model.opt, int(model.actuator_group[a])):
        return [f"{name} is switched off in the file's options: its joint has no servo of it"]
    remarks = []
    if model.actuator_forcelimited[a]:
        remarks += _hold_within(drives, column, gear * model.actuator_forcerange[a], f"forcerange of {name}")
    if model.actuator_delay[a] > 0.0:
        remarks.append(f"the delay of {name}, {model.actuator_delay[a]:g} s, is not simulated")
    return remarks + _add_law(model, a, drives, column, limits)


def _add_law(model: Any, a: int, drives: JointDrives, column: int, limits: FloatArray) -> list[str]:
    """Add the gains of a servo, or the limit of a motor, and return what of it is not simulated."""
    library = mujoco_library()
    gear, name = float(model.actuator_gear[a, 0]), f"actuator {model.actuator(a).name!r}"
    gain, bias = float(model.actuator_gainprm[a, 0]), model.actuator_biasprm[a]
    fixed = model.actuator_gaintype[a] == library.mjtGain.mjGAIN_FIXED
    plain = model.actuator_dyntype[a] == library.mjtDyn.mjDYN_NONE
    if fixed and plain and model.actuator_biastype[a] == library.mjtBias.mjBIAS_NONE:  # a motor: it has no law
        ends = _command_range(model, a)
        return [] if ends is None else _hold_within(drives, column, gear * gain * ends, f"ctrlrange of {name}")
    affine = model.actuator_biastype[a] == library.mjtBias.mjBIAS_AFFINE
    servo = fixed and plain and affine and gain > 0.0 and bias[0] == 0.0 and np.isclose(gain, -bias[1])
    if not servo or np.isfinite(drives.kp[column]):
        return [f"{name} is no motor and no position servo (or its joint has two): not simulated"]
    drives.kp[column], drives.kv[column] = gear**2 * gain, -(gear**2) * float(bias[2])
    ends = _command_range(model, a)
    if ends is None or _covers(np.sort(ends / gear), limits):
        return []
    return [f"commands are not held within the ctrlrange of {name}, which is narrower than its joint's range"]


def _command_range(model: Any, a: int) -> FloatArray | None:
    """Return between which ends `(2,)` an actuator's commands are held; None where they are not."""
    free = model.opt.disableflags & mujoco_library().mjtDisableBit.mjDSBL_CLAMPCTRL
    return None if free or not model.actuator_ctrllimited[a] else np.array(model.actuator_ctrlrange[a])


def _covers(ends: FloatArray, limits: FloatArray) -> bool:
    slack = ROUNDED * float(np.ptp(limits))
    return bool(ends[0] <= limits[0] + slack and ends[1] >= limits[1] - slack)


def _hold_within(drives: JointDrives, column: int, ends: FloatArray, what: str) -> list[str]:
    """Limit a joint's torque or force by the nearer end of a range, and return what of it is not simulated."""
    lower, upper = np.sort(ends).tolist()
    if not lower < 0.0 < upper:
        raise DataError(
            f"the {what} lets it push one way only ({lower:g} to {upper:g} at the joint), expected both.",
            hint="A one-sided drive is not simulated: give the range both ends in a copy, or leave it out.",
        )
    drives.limit[column] = np.min([drives.limit[column], -lower, upper])
    return [] if np.isclose(-lower, upper) else [f"the {what} is not symmetric: its nearer end holds both ways"]
