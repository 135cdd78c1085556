"""Robot files, MJCF and URDF, read by MuJoCo: one serial arm of the file, without its shapes.

MuJoCo is an extra, and is imported when a file is read.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.arms.arm import Arm, Link
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.robot_description import check_couplings, couplings, parse, settle, stamps, strip
from gpcorrect.arms.robot_drives import JointDrives, drives_of
from gpcorrect.arms.robot_path import (
    HOME,
    ArmPath,
    about_z,
    arm_path,
    joint_frame,
    mujoco_library,
    pose_of,
    to_common_normal,
)
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

LONGEST = 50.0  # m that an arm's links come to: a crane's; in millimetres the shortest arm is longer
SUFFIXES = (".xml", ".mjcf", ".urdf")
TURN = np.pi  # rad to either side of its zero that a joint without limits may turn


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
        The same object while the file and those that it includes stay the same.

    Raises
    ------
    MissingExtraError
        MuJoCo is not installed.
    DataError
        The file is no robot file, cannot be compiled, or holds no such serial arm; the message says why.
    """
    names = None if joints is None else tuple(joints)
    return _read(str(Path(path)), stamps(path), names, tool, base)


@lru_cache(maxsize=32)
def _read(
    path: str,
    stamp: tuple[tuple[str, int, int], ...],
    joints: tuple[str, ...] | None,
    tool: str | None,
    base: str | None,
) -> Robot:
    spec, file = parse(path), Path(path).name
    tied = couplings(spec)
    strip(spec)
    model = settle(spec, path)
    found = arm_path(model, file, joints, tool, base)
    chain, turned = _chain(model, found)
    drives, remarks = drives_of(model, found, chain.limits)
    remarks = [*found.remarks, *check_couplings(tied, found.names, file), *remarks]
    arm = Arm(
        name=Path(path).stem,
        chain=chain,
        home=_home(model, found),
        gravity=pose_of(model, found.base)[:3, :3].T @ model.opt.gravity,
        links=_links(model, found),
    )
    step, late = float(model.opt.timestep), model.opt.integrator == mujoco_library().mjtIntegrator.mjINT_EULER
    return Robot(arm, found.names, found.tool, drives, step, bool(late), tuple(remarks), turned)


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
    lower, upper = map(float, model.jnt_range[j])
    if lower > upper:  # MuJoCo takes it for a joint without limits
        raise DataError(
            f"the range of joint {model.joint(j).name!r} ends below its beginning: {lower:g} to {upper:g}.",
            hint="Exchange its two ends: lower and upper of a URDF's limit, range in MJCF.",
        )
    if model.jnt_limited[j]:
        return lower, upper
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
    """Masses in the joints' frames; what hangs beside the arm rides on the link that carries it, its joints at home."""
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
