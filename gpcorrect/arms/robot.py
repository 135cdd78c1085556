"""A robot as its file describes it: the arm, and what the file says of its drives."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields

import numpy as np

from gpcorrect.arms.arm import Arm
from gpcorrect.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class JointDrives:
    """What a robot file says of each joint's drive; all arrays `(dof,)`, N m and rad, or N and m.

    Parameters
    ----------
    armature : array
        Inertia of the rotor, reflected to the joint.
    damping, friction : array
        Viscous damping and dry friction.
    stiffness, rest : array
        Spring at the joint, and where it is at rest.
    kp, kv : array
        Of a position servo, `torque = kp (command - q) - kv q'`; NaN where the file has none.
    limit : array
        Largest torque or force; infinite where there is none.
    """

    armature: FloatArray
    damping: FloatArray
    friction: FloatArray
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
    arm : Arm
        Kinematics, limits, masses, rest position and gravity.
    joints : tuple of str
        Names of its joints, from the base.
    tool : str
        Body or site whose frame is the tip.
    drives : JointDrives
        Of its joints.
    step : float
        Time step that the file asks for, s.
    remarks : tuple of str
        What the file says that is not simulated here.
    """

    arm: Arm
    joints: tuple[str, ...]
    tool: str
    drives: JointDrives
    step: float
    remarks: tuple[str, ...] = ()

    @property
    def digest(self) -> str:
        """SHA-256 of every number that the simulator takes of it."""
        chain, links = self.arm.chain, self.arm.links
        numbers = [getattr(self.drives, f.name) for f in fields(self.drives)]
        numbers += [chain.placements, chain.tool, chain.limits, self.arm.home, self.arm.gravity, np.array(self.step)]
        numbers += [np.array([(j.theta, j.d) for j in chain.joints])]
        numbers += [np.concatenate([[link.mass], link.com, link.inertia.ravel()]) for link in links]
        return hashlib.sha256(b"".join(np.ascontiguousarray(n).tobytes() for n in numbers)).hexdigest()
