"""Robot files, MJCF and URDF, read by MuJoCo: one serial arm of the file, without its shapes.

MuJoCo is an extra, and is imported when a file is read.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.arms.arm import Arm, Link
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.robot_path import (
    ArmPath,
    about_z,
    arm_path,
    friction_onsets,
    joint_frame,
    mujoco_library,
    pose_of,
    to_common_normal,
)
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray

LONGEST = 50.0  # m that an arm's links come to: a crane's; in millimetres the shortest arm is longer
SUFFIXES = (".xml", ".mjcf", ".urdf")
HOME = "home"  # key frame of the rest position, as MuJoCo's own models call it
TURN = np.pi  # rad to either side of its zero that a joint without limits may turn
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
FIRST_ELEMENT = re.compile(r"<\s*([A-Za-z_][\w:.-]*)")
NO_MASS = "mass and inertia of moving bodies"  # how MuJoCo's message begins


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


@dataclass(frozen=True, eq=False)
class Robot:
    """One serial arm of a robot file.

    Parameters
    ----------
    arm : Arm, kinematics, limits, masses, rest position and gravity
    joints : tuple of str, names of its joints, from the base
    tool : str, body or site whose frame is the tip
    drives : JointDrives, of its joints
    step : float, time step that the file asks for, s
    brakes_late : bool
        Whether servos brake by the speed before a step, as MuJoCo's Euler integrator has it, not by that behind it.
    remarks : tuple of str, what the file says that is not simulated here
    turned : tuple of float
        Angle of each row's x axis about the joint's axis from the x of the frame that the file has there, rad.
    """

    arm: Arm
    joints: tuple[str, ...]
    tool: str
    drives: JointDrives
    step: float
    brakes_late: bool = False
    remarks: tuple[str, ...] = ()
    turned: tuple[float, ...] = ()

    @property
    def digest(self) -> str:
        """SHA-256 of every number that the simulator takes of it."""
        chain, links = self.arm.chain, self.arm.links
        numbers = [getattr(self.drives, f.name) for f in fields(self.drives)]
        numbers += [chain.placements, chain.tool, chain.limits, self.arm.home, self.arm.gravity]
        numbers += [np.array([self.step, self.brakes_late])]
        numbers += [np.array([(j.theta, j.d) for j in chain.joints])]
        numbers += [np.concatenate([[link.mass], link.com, link.inertia.ravel()]) for link in links]
        return hashlib.sha256(b"".join(np.ascontiguousarray(n).tobytes() for n in numbers)).hexdigest()


def is_robot_file(path: str | Path) -> bool:
    """Return whether a file's name is that of a robot file: .xml, .mjcf or .urdf.

    Parameters
    ----------
    path : str or Path
    """
    return Path(path).suffix.lower() in SUFFIXES


def read_robot(
    path: str | Path, joints: Sequence[str] | None = None, tool: str | None = None, base: str | None = None
) -> Robot:
    """Return one serial arm of a robot file.

    Parameters
    ----------
    path : str or Path, MJCF or URDF
    joints : sequence of str, optional
        Names of joints on the arm; the arm then ends at the last of them. Needed where the file branches, unless
        `tool` says the same.
    tool : str, optional
        Body or site whose frame is the tip. When None, the only site on the last link, or the end of its only chain of
        fixed bodies; with several, the body behind the last joint.
    base : str, optional, body whose frame is the arm's base; the world when None

    Returns
    -------
    Robot
        The same object while the file stays the same.

    Raises
    ------
    MissingExtraError
        MuJoCo is not installed.
    DataError
        The file is no robot file, cannot be compiled, or holds no such serial arm; the message says why.
    """
    file = Path(path)
    try:
        stamp = file.stat()
    except OSError as error:
        raise DataError(f"cannot read the robot file {path}: {error.strerror}.") from error
    names = None if joints is None else tuple(joints)
    return _read(str(file), (stamp.st_mtime_ns, stamp.st_size), names, tool, base)


@lru_cache(maxsize=32)
def _read(
    path: str, stamp: tuple[int, int], joints: tuple[str, ...] | None, tool: str | None, base: str | None
) -> Robot:
    spec = parse(path)
    strip(spec)
    try:
        model = spec.compile()
    except ValueError as error:
        raise _refused(path, error) from error
    found = arm_path(model, Path(path).name, joints, tool, base)
    drives, remarks = _drives(model, found)
    chain, turned = _chain(model, found)
    arm = Arm(
        name=Path(path).stem,
        chain=chain,
        home=_home(model, found),
        gravity=pose_of(model, found.base)[:3, :3].T @ model.opt.gravity,
        links=_links(model, found),
    )
    step, late = float(model.opt.timestep), model.opt.integrator == mujoco_library().mjtIntegrator.mjINT_EULER
    return Robot(arm, found.names, found.tool, drives, step, bool(late), (*found.remarks, *remarks), turned)


def parse(path: str | Path) -> Any:
    """Return the file as MuJoCo's editable description (`MjSpec`), each body and joint named, a URDF without shapes.

    Parameters
    ----------
    path : str or Path
    """
    library = mujoco_library()
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"cannot read the robot file {path}: {error}.") from error
    root = FIRST_ELEMENT.search(COMMENT.sub("", text))
    if root is None or root[1] not in ("mujoco", "robot"):
        came = "no XML" if root is None else f"<{root[1]}>"
        hint = "Expand xacro files first."
        raise DataError(f"{path} begins with {came}, expected <mujoco> (MJCF) or <robot> (URDF).", hint=hint)
    try:
        spec = library.MjSpec.from_file(str(path))
    except ValueError as error:
        raise _refused(path, error) from error
    if root[1] == "robot":
        _delete(spec, [geom for body in spec.bodies for geom in body.geoms], spec.meshes)
        spec.compiler.fusestatic = False  # or a tool frame without mass is gone
    _name_all("body", spec.bodies)
    _name_all("joint", spec.joints)
    return spec


def _name_all(kind: str, elements: Sequence[Any]) -> None:
    """Give each element without a name its kind and number, for all that follows goes by names."""
    taken = {element.name for element in elements}
    for number, element in enumerate(elements):
        if not element.name:
            name = f"{kind} {number}"
            while name in taken:
                name += "_"
            element.name = name


def strip(spec: Any) -> None:
    """Delete from a description what has no part in the motion: shapes that give no mass, sensors, contacts, tendons.

    Parameters
    ----------
    spec : mujoco.MjSpec, changed in place
    """
    library, always = mujoco_library(), spec.compiler.inertiafromgeom == 1
    weighed = [body for body in spec.bodies if (body.explicitinertial and not always) or body.name == "world"]
    _delete(spec, [geom for body in weighed for geom in body.geoms])
    _delete(spec, [a for a in spec.actuators if a.trntype == library.mjtTrn.mjTRN_TENDON])
    _delete(spec, [e for e in spec.equalities if e.type == library.mjtEq.mjEQ_TENDON])
    _delete(spec, spec.sensors, spec.pairs, spec.excludes, spec.skins, spec.tendons)
    shapes = {geom.meshname for geom in spec.geoms}
    for geom in spec.geoms:
        geom.material = ""
    _delete(spec, spec.materials, spec.textures, [mesh for mesh in spec.meshes if mesh.name not in shapes])


def _delete(spec: Any, *groups: Iterable[Any]) -> None:
    for element in [element for group in groups for element in group]:
        spec.delete(element)


def _refused(path: str | Path, error: ValueError) -> DataError:
    message = " ".join(str(error).split()).removeprefix("Error: ").removeprefix("XML Error: ")
    if NO_MASS in message:
        return DataError(
            f"{path}: a moving body has no inertia: {message}.",
            hint="Give every moving link an <inertial> with mass and inertia (or, in MJCF, shapes to take it from).",
        )
    if "Element 'include'" in message:
        return DataError(f"{path}: {message}.", hint="Put the included file where this one says, relative to it.")
    if "opening file" in message:
        return DataError(
            f"{path}: {message}: a body without <inertial> takes its mass from that mesh.",
            hint="Put the mesh where the file says, or give the body an <inertial>.",
        )
    if "multiple parents" in message:
        return DataError(f"{path}: {message}: a closed loop.", hint="Only serial arms are read: cut the loop open.")
    return DataError(f"MuJoCo cannot read {path}: {message}.", hint="Correct the file; MuJoCo must load it.")


def _chain(model: Any, found: ArmPath) -> tuple[Chain, tuple[float, ...]]:
    """Return the chain whose joint frames have the axis as z and sit on the joint's anchor, and its rows' turns.

    Rows have their x along the common normal of the axis before and their own, as a table's would: an error of a row's
    length then is one of the link's, and that of its twist turns the one axis beside the other.
    """
    joints, turned, before = [], [], pose_of(model, found.base)
    for j in found.joint_ids:
        T_world_joint = pose_of(model, model.jnt_bodyid[j]) @ joint_frame(model.jnt_pos[j], model.jnt_axis[j])
        placement = se3.invert(before) @ T_world_joint
        turning = _turns(model, j)
        zero = -float(model.qpos0[model.jnt_qposadr[j]])
        lower, upper = _limits(model, j)
        theta, d = (zero, 0.0) if turning else (0.0, zero)
        turn = to_common_normal(placement)
        placement = placement @ about_z(turn)
        joints.append(Joint("R" if turning else "P", 0.0, 0.0, d, theta - turn, lower, upper, placement))
        turned.append(turn)
        before = T_world_joint
    tool = se3.invert(before) @ found.T_world_tool
    lengths = [np.linalg.norm(T[:3, 3]) for T in (*(j.placement for j in joints[1:]), tool) if T is not None]
    if (length := float(np.sum(lengths))) > LONGEST:
        raise DataError(
            f"the arm's links are {length:.3g} m long together: the file is not in metres.",
            hint="MJCF and URDF are in metres. Scale positions, sizes and meshes by 0.001 if it is in millimetres.",
        )
    return Chain(tuple(joints), "modified", tool=tool), tuple(turned)


def _turns(model: Any, j: int) -> bool:
    return bool(model.jnt_type[j] == mujoco_library().mjtJoint.mjJNT_HINGE)


def _limits(model: Any, j: int) -> tuple[float, float]:
    if model.jnt_limited[j]:
        lower, upper = model.jnt_range[j]
        return float(lower), float(upper)
    if not _turns(model, j):
        hint = "Give it a range in the robot file."
        raise DataError(f"the sliding joint {model.joint(j).name!r} has no range.", hint=hint)
    middle = float(model.qpos0[model.jnt_qposadr[j]])
    return middle - TURN, middle + TURN


def _home(model: Any, found: ArmPath) -> FloatArray:
    keys = [model.key(k).name for k in range(model.nkey)]
    rest = model.key_qpos[keys.index(HOME)] if HOME in keys else model.qpos0
    limits = np.array([_limits(model, j) for j in found.joint_ids])
    return np.asarray(np.clip(rest[model.jnt_qposadr[list(found.joint_ids)]], *limits.T))


def _links(model: Any, found: ArmPath) -> tuple[Link, ...]:
    """Masses in the joints' frames; what hangs beside the arm rides on the link that carries it, its joints at rest."""
    links = []
    for number, j in enumerate(found.joint_ids, start=1):
        anchor = joint_frame(model.jnt_pos[j], model.jnt_axis[j])
        T_link_world = se3.invert(pose_of(model, model.jnt_bodyid[j]) @ anchor)
        bodies = [b for b in range(model.nbody) if found.link_of[b] == number]
        frames = [
            T_link_world @ pose_of(model, b) @ se3.from_parts(model.body_ipos[b], model.body_iquat[b]) for b in bodies
        ]
        masses = model.body_mass[bodies]
        mass = float(masses.sum())
        com = sum((m * T[:3, 3] for m, T in zip(masses, frames, strict=True)), np.zeros(3)) / max(mass, 1e-300)
        inertia = np.zeros((3, 3))
        for b, m, T in zip(bodies, masses, frames, strict=True):
            r = T[:3, 3] - com
            inertia += T[:3, :3] @ np.diag(model.body_inertia[b]) @ T[:3, :3].T
            inertia += m * (r @ r * np.eye(3) - np.outer(r, r))
        links.append(Link(mass, com, inertia))
    return tuple(links)


def _drives(model: Any, found: ArmPath) -> tuple[JointDrives, list[str]]:
    ids = list(found.joint_ids)
    dofs = model.jnt_dofadr[ids]
    nothing = np.full(len(ids), np.nan)
    onset, onset_time = friction_onsets(model)[:, dofs]
    limit = np.where(model.jnt_actfrclimited[ids], np.abs(model.jnt_actfrcrange[ids]).min(axis=1), np.inf)
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
        limit=limit,
    )
    remarks, kinds = [], mujoco_library().mjtTrn
    for a in range(model.nu):
        on_joint = int(model.actuator_trntype[a]) in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)
        if on_joint and model.actuator_trnid[a, 0] in ids:
            remarks += _add_actuator(model, a, drives, ids.index(model.actuator_trnid[a, 0]))
    return drives, remarks


def _add_actuator(model: Any, a: int, drives: JointDrives, column: int) -> list[str]:
    """Add an actuator's numbers to its joint's, and return what of it is not simulated."""
    library = mujoco_library()
    gear, name = float(model.actuator_gear[a, 0]), model.actuator(a).name
    drives.armature[column] += gear**2 * model.actuator_armature[a]
    drives.damping[column] += gear**2 * model.actuator_damping[a]
    if model.actuator_forcelimited[a]:
        force = abs(gear) * float(np.abs(model.actuator_forcerange[a]).min())
        drives.limit[column] = min(drives.limit[column], force)
    gain, bias = float(model.actuator_gainprm[a, 0]), model.actuator_biasprm[a]
    fixed = model.actuator_gaintype[a] == library.mjtGain.mjGAIN_FIXED
    plain = model.actuator_dyntype[a] == library.mjtDyn.mjDYN_NONE
    if fixed and plain and model.actuator_biastype[a] == library.mjtBias.mjBIAS_NONE:
        return []  # a motor: it has no law of its own
    affine = model.actuator_biastype[a] == library.mjtBias.mjBIAS_AFFINE
    servo = fixed and plain and affine and gain > 0.0 and bias[0] == 0.0 and np.isclose(gain, -bias[1])
    if not servo or np.isfinite(drives.kp[column]):
        return [f"actuator {name!r} is no motor and no position servo (or its joint has two): not simulated"]
    drives.kp[column], drives.kv[column] = gear**2 * gain, -(gear**2) * float(bias[2])
    return []
