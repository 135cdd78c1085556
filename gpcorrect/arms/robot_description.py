"""MuJoCo's editable description (`MjSpec`) of a robot file: read, put into plain numbers, and without its shapes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.arms.robot_drives import switched_off
from gpcorrect.arms.robot_path import mujoco_library
from gpcorrect.errors import DataError

COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
FIRST_ELEMENT = re.compile(r"<\s*([A-Za-z_][\w:.-]*)")
PART = re.compile(r"<\s*(?:include|model)\b[^>]*?\bfile\s*=\s*[\"']([^\"']+)")  # another robot file that is read too
NO_MASS = "mass and inertia of moving bodies"  # how MuJoCo's message begins


def stamps(path: str | Path) -> tuple[tuple[str, int, int], ...]:
    """Return name, time and size of a robot file and of those that it includes, which change when one is changed.

    Parameters
    ----------
    path : str or Path, MJCF or URDF

    Raises
    ------
    DataError
        The file itself cannot be read.
    """
    found: dict[str, tuple[str, int, int]] = {}
    waiting = [Path(path)]
    while waiting:
        file = waiting.pop()
        try:
            stamp, text = file.stat(), file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            if found:
                continue  # MuJoCo says which part is missing
            raise DataError(f"cannot read the robot file {path}: {getattr(error, 'strerror', error)}.") from error
        found[str(file)] = (str(file), stamp.st_mtime_ns, stamp.st_size)
        parts = [Path(path).parent / name for name in PART.findall(COMMENT.sub("", text))]
        waiting += [part for part in parts if str(part) not in found]
    return tuple(found.values())


def parse(path: str | Path) -> Any:
    """Return the file as MuJoCo's description, its bodies, joints, tendons and actuators named, a URDF without shapes.

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
        _weigh_only_what_moves(spec)
    _name_all("body", spec.bodies)
    _name_all("joint", spec.joints)
    _name_all("tendon", spec.tendons)
    _name_all("actuator", spec.actuators)
    return spec


def _weigh_only_what_moves(spec: Any) -> None:
    """Take the inertia of bodies that no joint moves: many public URDFs have some there that MuJoCo refuses."""
    for body in spec.bodies[1:]:  # behind the world
        if not (body.joints or _carrying(body)):
            body.mass, body.fullinertia, body.explicitinertial = 0.0, np.full(6, np.nan), False


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
    _delete(spec, [geom for geom in spec.geoms if geom.type == library.mjtGeom.mjGEOM_HFIELD], spec.hfields)
    _delete_tendon_actuators(spec)
    _delete(spec, [e for e in spec.equalities if e.type == library.mjtEq.mjEQ_TENDON])
    _delete(spec, spec.sensors, spec.pairs, spec.excludes, spec.skins, spec.tendons)
    shapes = {geom.meshname for geom in spec.geoms}
    for shape in [*spec.geoms, *spec.sites]:
        shape.material = ""
    _delete(spec, spec.materials, spec.textures, [mesh for mesh in spec.meshes if mesh.name not in shapes])


def _delete_tendon_actuators(spec: Any) -> None:
    """Delete them with their commands in key frames, which hold one of every actuator."""
    kept = np.array([a.trntype != mujoco_library().mjtTrn.mjTRN_TENDON for a in spec.actuators], dtype=bool)
    for key in spec.keys:
        commands = np.array(key.ctrl)
        key.ctrl = commands[kept] if len(commands) == len(kept) else commands
        if not kept.all():
            key.act = np.zeros(0)
    _delete(spec, [a for a, stays in zip(spec.actuators, kept, strict=True) if not stays])


def _delete(spec: Any, *groups: Iterable[Any]) -> None:
    for element in [element for group in groups for element in group]:
        spec.delete(element)


def settle(spec: Any, path: str | Path) -> Any:
    """Say a file's springs, damping, friction and gravity in plain numbers, and return the compiled model.

    What its flags switch off is zero, and the flags are cleared; time constants (`springdamper`) become the stiffness
    and damping that MuJoCo makes of them. So what is added later acts, and is added to what was there.

    Parameters
    ----------
    spec : mujoco.MjSpec, changed in place
    path : str or Path, of the file
    """
    model = compiled(spec, path)
    timed = [joint for joint in spec.joints if np.any(joint.springdamper)]
    if not timed and not spec.option.disableflags:
        return model
    for joint in timed:
        found = model.joint(joint.name)
        joint.stiffness[0], joint.damping[0] = found.stiffness[0], found.damping[0]
        joint.springdamper = np.zeros(2)
    _switch_off(spec)
    return compiled(spec, path)


def _switch_off(spec: Any) -> None:
    bits, off, resisting = mujoco_library().mjtDisableBit, spec.option.disableflags, [*spec.joints, *spec.tendons]
    if off & bits.mjDSBL_CONSTRAINT:  # which is these four
        off |= bits.mjDSBL_EQUALITY | bits.mjDSBL_FRICTIONLOSS | bits.mjDSBL_LIMIT | bits.mjDSBL_CONTACT
    if off & bits.mjDSBL_GRAVITY:
        spec.option.gravity = np.zeros(3)
    if off & bits.mjDSBL_FRICTIONLOSS:
        _zero("frictionloss", resisting)
    if off & bits.mjDSBL_SPRING:
        _zero("stiffness", resisting)
    if off & bits.mjDSBL_DAMPER:
        _zero("damping", [*resisting, *spec.actuators])
    said = bits.mjDSBL_CONSTRAINT | bits.mjDSBL_GRAVITY | bits.mjDSBL_FRICTIONLOSS
    spec.option.disableflags = int(off) & ~int(said | bits.mjDSBL_SPRING | bits.mjDSBL_DAMPER)


def _zero(number: str, elements: Iterable[Any]) -> None:
    for element in elements:
        setattr(element, number, np.zeros_like(getattr(element, number))[()])


def compiled(spec: Any, path: str | Path) -> Any:
    """Return MuJoCo's compiled model of a description.

    Parameters
    ----------
    spec : mujoco.MjSpec
    path : str or Path, of the file

    Raises
    ------
    DataError
        MuJoCo refuses it.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise _refused(path, error) from error


@dataclass(frozen=True)
class Coupling:
    """What acts on several joints through tendons, none of which is simulated.

    Parameters
    ----------
    what : str, the element, for a message
    joints : frozenset of str, names of those that it acts on
    rigid : bool, whether it is an equality constraint
    """

    what: str
    joints: frozenset[str]
    rigid: bool = False


def couplings(spec: Any) -> list[Coupling]:
    """Return what a description has at its tendons: constraints, actuators, and tendons that resist.

    Parameters
    ----------
    spec : mujoco.MjSpec, before it is stripped
    """
    library, joints = mujoco_library(), {tendon.name: frozenset(_moving(tendon)) for tendon in spec.tendons}
    found, bits = [], library.mjtDisableBit
    for e in spec.equalities:
        holds = e.active and not spec.option.disableflags & (bits.mjDSBL_EQUALITY | bits.mjDSBL_CONSTRAINT)
        if e.type == library.mjtEq.mjEQ_TENDON and holds:
            both = joints.get(e.name1, frozenset()) | joints.get(e.name2, frozenset())
            found.append(Coupling(f"the equality constraint of tendon {e.name1!r}", both, rigid=True))
    for a in spec.actuators:
        if a.trntype == library.mjtTrn.mjTRN_TENDON and not switched_off(spec.option, a.group):
            found.append(Coupling(f"actuator {a.name!r} at tendon {a.target!r}", joints.get(a.target, frozenset())))
    resisting = [tendon for tendon in spec.tendons if _resists(tendon, bool(spec.compiler.autolimits))]
    return found + [Coupling(f"tendon {tendon.name!r}", joints[tendon.name]) for tendon in resisting]


def check_couplings(found: Sequence[Coupling], arm: Sequence[str], file: str) -> list[str]:
    """Return what at tendons acts on an arm and is not simulated.

    Parameters
    ----------
    found : sequence of Coupling
    arm : sequence of str, names of the arm's joints
    file : str, what an error's message begins with

    Raises
    ------
    DataError
        A constraint ties joints of the arm, and no other.
    """
    acting = [coupling for coupling in found if not coupling.joints.isdisjoint(arm)]
    for coupling in acting:
        if coupling.rigid and coupling.joints.issubset(arm):
            raise DataError(
                f"{file}: {coupling.what} ties {', '.join(sorted(coupling.joints))} and closes a loop on the arm.",
                hint='Only serial arms are read: remove it, or set active="false" in a copy.',
            )
    return [f"{coupling.what} is not simulated" for coupling in acting]


def _resists(tendon: Any, autolimits: bool) -> bool:
    """Whether a tendon has a spring, damping, friction, inertia or limits."""
    held = mujoco_library().mjtLimited
    ranged = tendon.range[0] < tendon.range[1] and autolimits
    limited = tendon.limited == held.mjLIMITED_TRUE or (tendon.limited == held.mjLIMITED_AUTO and ranged)
    loads = (tendon.stiffness, tendon.damping, tendon.frictionloss, tendon.armature)
    return limited or any(np.any(load) for load in loads)


def _moving(tendon: Any) -> set[str]:
    """Names of the joints that change a tendon's length: its own, or those that move one of its points, but not all."""
    joint = mujoco_library().mjtWrap.mjWRAP_JOINT
    path = [(part.type, part.target) for part in tendon.path if part.target is not None]  # a pulley has none
    own = {str(target.name) for kind, target in path if kind == joint}
    carried = [_carrying(point) for kind, point in path if kind != joint]
    return {name for name in own.union(*carried) if name in own or not all(name in names for names in carried)}


def _carrying(point: Any) -> set[str]:
    """Names of the joints between what carries a site, shape or body and the world."""
    body, names = point.parent, set()
    while body is not None:
        names |= {joint.name for joint in body.joints}
        body = body.parent
    return names


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
    if "balanceinertia" in message:
        return DataError(
            f"{path}: {message}.",
            hint="No body has such an inertia: correct it, or let MuJoCo replace it by its mean, with "
            '<mujoco><compiler balanceinertia="true"/></mujoco> in the file.',
        )
    if "multiple parents" in message:
        return DataError(f"{path}: {message}: a closed loop.", hint="Only serial arms are read: cut the loop open.")
    return DataError(f"MuJoCo cannot read {path}: {message}.", hint="Correct the file; MuJoCo must load it.")
