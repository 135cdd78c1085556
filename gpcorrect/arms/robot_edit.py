"""A robot file changed in its own words, by MuJoCo's editable description, and written as MJCF."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.arms.robot_description import parse, settle, strip
from gpcorrect.arms.robot_drives import switched_off
from gpcorrect.arms.robot_file import read_robot
from gpcorrect.arms.robot_path import about_z, friction_onsets, joint_frame, mujoco_library
from gpcorrect.atomic import atomic_path
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

SOFTEST, HARDEST = 0.0001, 0.9999  # between which MuJoCo keeps impedances
GROWTH = (0.001, 0.5, 2.0)  # of an impedance with the distance from a limit, which friction does not have
POINT_INERTIA = 1e-9  # kg m^2: MuJoCo asks for some, of a body that is a point
PAYLOAD = "gpcorrect_payload"  # name of a body that is hung at the tip or at a link's centre of mass


class RobotEdit:
    """One serial arm of a robot file, to be changed and written.

    Parameters
    ----------
    path : str or Path, MJCF or URDF; it is not touched
    tool, base : str, optional, as of :func:`gpcorrect.arms.read_robot`

    Raises
    ------
    DataError
        The file cannot be read.
    """

    def __init__(self, path: str | Path, tool: str | None = None, base: str | None = None) -> None:
        self._path, self._based = Path(path).absolute(), base is not None
        self.robot = read_robot(path, tool=tool, base=base)
        self._spec = parse(path)
        if not self._has_assets():  # MuJoCo compiles what was changed, and for that reads the meshes
            strip(self._spec)
        self._model = settle(self._spec, path)  # as it was read: places of joints and sites in their bodies
        self._hold_damping()
        drives = self.robot.drives
        slopes = drives.friction / np.where(drives.onset > 0.0, drives.onset, np.inf)
        soft = np.stack([slopes, slopes * drives.onset_time], axis=1)
        self._soft = {joint: both for joint, both in enumerate(soft, start=1) if both[0] > 0.0}  # slope, inertia

    def add_friction(self, joint: int, torque: float) -> None:
        """Add dry friction to a joint, and let it stick as dry friction does, within a step or two.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        torque : float, N m or N
        """
        found = self._joint(joint)
        found.frictionloss += torque
        self._soft.pop(joint, None)
        found.solimp_friction = (HARDEST, HARDEST, *GROWTH)
        found.solref_friction = (2.0 * self.robot.step, 1.0)  # MuJoCo takes no less; its default glides for 10 ms

    def add_soft_friction(self, joint: int, torque: float, onset: float, onset_time: float) -> bool:
        """Add friction that grows over the first speeds; return whether a file's numbers reach that far.

        What the joint has already and what comes add up as they do in the servo loop: limits, slopes, and slopes times
        onset times, which are inertias.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        torque : float, N m or N
        onset, onset_time : float, rad/s or m/s, and s; above 0
        """
        slope, inertia = self._soft.get(joint, np.zeros(2)) + torque / onset * np.array([1.0, onset_time])
        impedance = self._impedance(joint, inertia)
        if not SOFTEST < impedance < HARDEST or inertia < self.robot.step * slope:
            return False
        self._joint(joint).frictionloss += torque
        self._soft[joint] = np.array([slope, inertia])
        return True

    def add_damping(self, joint: int, damping: float) -> None:
        """Add viscous damping to a joint.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        damping : float, N m s/rad or N s/m
        """
        found = self._joint(joint)
        found.damping = np.array(found.damping) + np.array([damping, 0.0, 0.0])

    def lose_friction(self, joint: int, term: str, part: float) -> bool:
        """Take a part of what the file states from a joint's friction; return whether the joint's own has as much.

        Soft friction grows as fast as before. Damping may stand in an actuator too, where it stays.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        term : str, "dry" or "viscous"
        part : float
        """
        found, drives = self._joint(joint), self.robot.drives
        if term == "dry":
            found.frictionloss -= part * drives.friction[joint - 1]
            return True
        left = np.array(found.damping) - np.array([part * drives.damping[joint - 1], 0.0, 0.0])
        if left[0] < 0.0:
            return False
        found.damping = left
        return True

    def add_inertia(self, joint: int, inertia: float) -> bool:
        """Add to the inertia of a joint's motor; return whether the joint's own stays at least zero.

        More may stand in an actuator, where it stays.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        inertia : float, kg m^2 or kg
        """
        found = self._joint(joint)
        if found.armature + inertia < 0.0:
            return False
        found.armature += inertia
        return True

    def add_spring(self, joint: int, stiffness: float, push: float) -> bool:
        """Add a spring to a joint, beside the one that it has; return whether the file can say so.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        stiffness : float, N m/rad or N/m; a push without any cannot be said
        push : float, torque or force with which it pushes back where the joint is at zero, N m or N
        """
        found = self._joint(joint)
        own = float(found.stiffness[0])
        if own + stiffness <= 0.0:
            return False
        unit = self._unit(found)
        rest = (own * unit * float(found.springref) - push) / (own + stiffness)
        found.stiffness = np.array(found.stiffness) + np.array([stiffness, 0.0, 0.0])
        found.springref = rest / unit
        return True

    def limit_torque(self, joint: int, limit: float) -> bool:
        """Limit the force of a joint's position servo, where it is not less already; return whether it has one.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        limit : float, N m or N
        """
        name, option = self.robot.joints[joint - 1], self._spec.option
        servos = [a for a in self._spec.actuators if a.target == name and not switched_off(option, a.group)]
        least = min(limit, float(self.robot.drives.limit[joint - 1]))
        for servo in servos:
            servo.forcelimited = True
            servo.forcerange = np.array([-least, least]) / abs(servo.gear[0])
        return bool(servos)

    def add_payload(self, mass: float, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bool:
        """Hang a point mass on the tool; return whether the file keeps masses as they are written.

        Parameters
        ----------
        mass : float, kg
        place : tuple of three floats, m, in the tip's frame
        """
        if self._spec.site(self.robot.tool) is None:
            return self._hang(self._spec.body(self.robot.tool), mass, np.array(place))
        site = self._model.site(self.robot.tool)
        at = site.pos + se3.matrix_from_quaternion(site.quat) @ place
        return self._hang(self._spec.body(self._model.body(site.bodyid[0]).name), mass, at)

    def add_link_mass(self, joint: int, mass: float) -> bool:
        """Put a point mass at the centre of mass of a joint's link; return whether the file keeps masses as written.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        mass : float, kg
        """
        T_body_joint, com = self._frame(joint), self.robot.arm.links[joint - 1].com
        return self._hang(self._joint(joint).parent, mass, T_body_joint[:3, :3] @ com + T_body_joint[:3, 3])

    def add_gravity(self, change: tuple[float, float, float]) -> bool:
        """Change gravity; return whether the arm's base is the file's world, in whose frame the file has it.

        Parameters
        ----------
        change : tuple of three floats, base frame, m/s^2
        """
        if self._based:
            return False
        self._spec.option.gravity = np.array(self._spec.option.gravity) + change
        return True

    def _hang(self, carrier: Any, mass: float, place: FloatArray) -> bool:
        if self._spec.compiler.settotalmass > 0.0:  # MuJoCo would scale all masses
            return False
        name = PAYLOAD
        while self._spec.body(name) is not None:
            name += "_"
        body = carrier.add_body(name=name, pos=place)
        body.mass, body.ipos, body.inertia = mass, np.zeros(3), np.full(3, POINT_INERTIA)
        body.explicitinertial = True
        return True

    def move_joint(self, joint: int, motion: FloatArray) -> bool:
        """Move a joint with all behind it; return whether the file can say so: its body has no other joint.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        motion : (4, 4) array, in the frame of the joint's row, whose z axis is the joint's, and x the common normal's
        """
        found = self._joint(joint)
        body = found.parent
        if len(body.joints) != 1 or body.frame is not None:
            return False
        quaternion, how, compiler = body.quat, mujoco_library().mjtOrientation.mjORIENTATION_QUAT, self._spec.compiler
        if body.alt.type != how:
            quaternion = self._spec.resolve_orientation(compiler.degree, compiler.eulerseq, body.alt)
        frame = self._frame(joint) @ about_z(self.robot.turned[joint - 1])
        moved = se3.from_parts(np.array(body.pos), np.array(quaternion)) @ frame @ motion @ se3.invert(frame)
        body.alt.type = how
        body.pos, body.quat = se3.to_parts(moved)
        return True

    def limit_range(self, joint: int, end: str, limit: float) -> None:
        """Move one end of a joint's range, as far as that leaves one; a joint without limits stays so.

        Parameters
        ----------
        joint : int, number on the arm, from 1
        end : str, "upper" or "lower"
        limit : float, joint value, rad or m
        """
        found = self._joint(joint)
        unit = self._unit(found)
        lower, upper = np.array(found.range) * unit
        ends = (lower, min(limit, upper)) if end == "upper" else (max(limit, lower), upper)
        if self._model.joint(found.name).limited[0] and ends[0] < ends[1]:
            found.range = np.array(ends) / unit

    def write(self, path: str | Path) -> None:
        """Write the file as MJCF, whole or not at all.

        Meshes are named relative to it. Where one is missing, shapes and sensors are left out, and the motion stays.

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        DataError
            It is the file that was read, or MuJoCo refuses what it was changed to.
        """
        target = Path(path).absolute()
        if target == self._path:
            raise DataError(f"{path} is the robot file that was read.", hint="Give another output folder.")
        self._hold_onsets()
        root = ElementTree.fromstring(self._spec.to_xml())
        compiler = root.find("compiler")
        if compiler is not None and root.find("asset") is not None:
            for folder in ("meshdir", "texturedir"):
                old = self._path.parent / compiler.get(folder, "")
                compiler.set(folder, Path(os.path.relpath(old, target.parent)).as_posix())
        with atomic_path(target) as temporary:
            ElementTree.ElementTree(root).write(temporary, encoding="utf-8")

    def _has_assets(self) -> bool:
        """Whether every mesh, height field, skin and texture of the file is there."""
        spec, meshes = self._spec, Path(self._spec.compiler.meshdir)
        files = [meshes / shape.file for shape in (*spec.meshes, *spec.hfields, *spec.skins) if shape.file]
        images = [image for texture in spec.textures for image in (texture.file, *texture.cubefiles)]
        files += [Path(spec.compiler.texturedir) / image for image in images if image]
        return all((self._path.parent / file).is_file() for file in files)

    def _hold_damping(self) -> None:
        """Write servos' damping as it is where the file gives a ratio, which MuJoCo would take of the new masses."""
        for servo in self._spec.actuators:
            kv = dict(zip(self.robot.joints, self.robot.drives.kv, strict=True)).get(servo.target, np.nan)
            if servo.biasprm[2] > 0.0 and np.isfinite(kv):
                servo.biasprm[2] = -kv / servo.gear[0] ** 2

    def _hold_onsets(self) -> None:
        """Write friction's softness as it is, which MuJoCo would take of the new masses."""
        there = friction_onsets(self._compiled())
        for joint, (slope, inertia) in self._soft.items():
            found, time = self._joint(joint), inertia / slope
            if not np.allclose(there[:, self._dof(joint)], (found.frictionloss / slope, time), rtol=1e-6, atol=0.0):
                impedance = np.clip(self._impedance(joint, inertia), SOFTEST, HARDEST)
                found.solimp_friction = (impedance, HARDEST, *GROWTH)
                found.solref_friction = (2.0 * time / HARDEST, 1.0)

    def _impedance(self, joint: int, inertia: float) -> float:
        """Return MuJoCo's impedance of a friction of this slope times onset time, 1 / R."""
        ratio = inertia * self._compiled().dof_invweight0[self._dof(joint)]
        return float(ratio / (1.0 + ratio))

    def _dof(self, joint: int) -> int:
        return int(self._model.joint(self.robot.joints[joint - 1]).dofadr[0])

    def _frame(self, joint: int) -> FloatArray:
        """Return the frame `(4, 4)` of a joint in its body's frame."""
        found = self._model.joint(self.robot.joints[joint - 1])
        return joint_frame(found.pos, found.axis)

    def _unit(self, joint: Any) -> float:
        """Rad or m in the unit in which the file has a joint's range and rest."""
        degrees = self._spec.compiler.degree and joint.type == mujoco_library().mjtJoint.mjJNT_HINGE
        return float(np.pi / 180.0) if degrees else 1.0

    def _compiled(self) -> Any:
        try:
            return self._spec.compile()
        except ValueError as error:
            message = " ".join(str(error).split()).removeprefix("Error: ")
            raise DataError(
                f"MuJoCo cannot read {self._path.name} as it was changed: {message}.",
                hint="Leave out the effect that it names, or keep it beside the file, in a model file.",
            ) from error

    def _joint(self, joint: int) -> Any:
        return self._spec.joint(self.robot.joints[joint - 1])
