"""What MuJoCo's compiled model of a robot file says: which joints make one serial arm, its frames, its friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, MissingExtraError
from gpcorrect.types import FloatArray

HOME = "home"  # key frame of the rest position, as MuJoCo's own models call it
WORLD = 0  # MuJoCo's number of the world's body
FREE, BALL = 0, 1  # MuJoCo's numbers of joint types that are no axis
CONNECT, WELD, COUPLED = 0, 1, 2  # MuJoCo's numbers of equality constraints: two bodies, two bodies, two joints
SITE = 6  # MuJoCo's number of the object type
# Sine of the angle below which axes are meant to be parallel: calibrated files have them askew by milliradians, and
# designs by none or by tens of degrees. The common normal of such two lies anywhere, and what moves one of them across
# it by 1 mm is two rows' offsets of ten times as much, in opposite directions (Hayati 1983).
PARALLEL = 0.1
ON_ONE_LINE = 1e-6  # m, below which axes count as one


@dataclass(frozen=True, eq=False)
class ArmPath:
    """The joints between a base and a tool."""

    base: int  # body
    joint_ids: tuple[int, ...]  # joints from the base on, MuJoCo's numbers
    names: tuple[str, ...]  # their names
    tool: str  # body or site of the tip
    # (4, 4) its pose with the arm's joints at their reference and all others where the key frame `home` has them
    T_world_tool: FloatArray
    # for every body the number of the arm's link that it rides on, from 1; 0 for what does not move with the arm
    link_of: tuple[int, ...]
    remarks: tuple[str, ...]  # what the file says of this arm that is not simulated


def arm_path(
    model: Any, file: str, joints: Sequence[str] | None = None, tool: str | None = None, base: str | None = None
) -> ArmPath:
    """Find the serial arm of a model, and hold all joints beside it where the key frame `home` has them.

    Parameters
    ----------
    model : mujoco.MjModel, whose poses of bodies beside the arm are changed
    file : str, what an error's message begins with
    joints : sequence of str, optional
    tool, base : str, optional, where it ends (body or site) and begins (body)
    """
    start = WORLD if base is None else _body(model, file, base, "base")
    known = [_name(model, j) for j in range(model.njnt)]
    names = list(joints or ())
    unknown = [name for name in names if name not in known]
    if unknown:
        hint = f"Its joints: {', '.join(known) or 'none'}."
        raise DataError(f"{file} has no joint {', '.join(map(repr, unknown))}.", hint=hint)
    body, T_body_tool, tool = _end(model, file, start, names, tool)
    line = [*_ancestors(model, body)[::-1], body]
    if start not in line:
        raise DataError(
            f"{file}: the base {model.body(start).name!r} does not carry the tool {model.body(body).name!r}.",
            hint="Name a base nearer to the world, or leave it out.",
        )
    ids = tuple(j for b in line[line.index(start) + 1 :] for j in _joints_of(model, b))
    _check_joints(model, file, ids)
    absent = [name for name in names if name not in {_name(model, j) for j in ids}]
    if absent:
        raise DataError(
            f"{file}: joint {', '.join(absent)} is not between {base or 'the world'} and {tool}: "
            f"{', '.join(_name(model, j) for j in ids)}.",
            hint="Name joints of one arm, and a tool behind all of them.",
        )
    last = {int(model.jnt_bodyid[j]): number for number, j in enumerate(ids, start=1)}
    link_of = [0] * model.nbody
    for b in range(1, model.nbody):  # a body comes behind its parent
        link_of[b] = last.get(b, link_of[model.body_parentid[b]])
    _check_loops(model, file, ids, link_of)
    _hold_others(model, ids)
    all_names, T_tool = tuple(_name(model, j) for j in ids), pose_of(model, body) @ T_body_tool
    return ArmPath(start, ids, all_names, tool, T_tool, tuple(link_of), _remarks(model, ids, link_of))


def _hold_others(model: Any, ids: Sequence[int]) -> None:
    """Let bodies whose joints are not the arm's be fixed where the key frame `home` has them; without one, nothing."""
    keys = [model.key(k).name for k in range(model.nkey)]
    if HOME not in keys:
        return
    mujoco, home = mujoco_library(), model.key_qpos[keys.index(HOME)]
    data = mujoco.MjData(model)
    data.qpos[:] = home
    mujoco.mj_kinematics(model, data)
    for j in set(range(model.njnt)) - set(ids):
        body, carrier = int(model.jnt_bodyid[j]), int(model.body_parentid[model.jnt_bodyid[j]])
        poses = [se3.from_parts(data.xpos[b], data.xquat[b]) for b in (carrier, body)]
        model.body_pos[body], model.body_quat[body] = se3.to_parts(se3.invert(poses[0]) @ poses[1])


def pose_of(model: Any, body: int) -> FloatArray:
    """Return the pose `(4, 4)` of a body in the world, all joints at their reference, or where they are held.

    Parameters
    ----------
    model : mujoco.MjModel
    body : int
    """
    T = np.eye(4)
    while body != WORLD:
        T = se3.from_parts(model.body_pos[body], model.body_quat[body]) @ T
        body = model.body_parentid[body]
    return T


def joint_frame(anchor: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the frame `(4, 4)` of a joint in its body's frame: the least turn that brings z onto the axis.

    Parameters
    ----------
    anchor, axis : (3,) arrays, point on the axis and its direction, in the body's frame
    """
    x, y, z = axis / np.linalg.norm(axis)
    sine = np.hypot(x, y)
    half_turn = np.array([np.pi * (z < 0.0), 0.0, 0.0])  # about x, where the axis is -z
    turn = np.array([-y, x, 0.0]) / sine * np.arctan2(sine, z) if sine > 0.0 else half_turn
    return se3.pose(se3.matrix_from_rotvec(turn), np.array(anchor))


def about_z(angle: float) -> FloatArray:
    """Return a turn `(4, 4)` about z.

    Parameters
    ----------
    angle : float, rad
    """
    return se3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.0, angle]))


def to_common_normal(placement: FloatArray) -> float:
    """Return the angle about a joint's axis from its frame's x to the common normal of the axis before and its own.

    Axes that are meant to be parallel have it along what lies between them.

    Parameters
    ----------
    placement : (4, 4) array, the joint's frame in that of the joint before; z of both are the axes
    """
    axis, apart = placement[:3, 2], placement[:3, 3]
    normal = np.cross([0.0, 0.0, 1.0], axis)
    if np.linalg.norm(normal) < PARALLEL:
        normal = apart - axis * (axis @ apart)
    x, y = normal @ placement[:3, 0], normal @ placement[:3, 1]
    return float(np.arctan2(y, x)) if np.hypot(x, y) > ON_ONE_LINE else 0.0


def _end(model: Any, file: str, start: int, names: list[str], tool: str | None) -> tuple[int, FloatArray, str]:
    """Body at which the arm ends, pose of the tip in its frame, and its name."""
    sites = [model.site(s).name for s in range(model.nsite)]
    if tool is None:
        # With names: the body of the named joint that is farthest from the world.
        bodies = [int(model.joint(name).bodyid[0]) for name in names]
        last = max(bodies, key=lambda b: len(_ancestors(model, b))) if names else _only_end(model, file, start)
        tool = _only_tip(model, last)
    if tool in sites:
        site = sites.index(tool)
        body = int(model.site_bodyid[site])
        return body, se3.from_parts(model.site_pos[site], model.site_quat[site]), str(tool)
    body = _body(model, file, tool, "tool")
    return body, np.eye(4), tool


def _only_tip(model: Any, body: int) -> str:
    """Name of the one site on the last link, or of the end of its one chain of fixed bodies; else of its own body.

    The body itself has its origin on its joint, where a payload would not load it.
    """
    fixed = [b for b in range(model.nbody) if model.body_weldid[b] == body]
    sites = [model.site(s).name for s in range(model.nsite) if model.site_bodyid[s] in fixed and model.site(s).name]
    ends = [b for b in fixed if b not in model.body_parentid[fixed]]
    tips = sites if len(sites) == 1 else [model.body(b).name for b in ends]
    return str(tips[0] if len(tips) == 1 else model.body(body).name)


def _only_end(model: Any, file: str, start: int) -> int:
    """Last moving body, where the file has only one end."""
    moving = [b for b in range(model.nbody) if _held(model, b) and (start == WORLD or start in _ancestors(model, b))]
    ends = [b for b in moving if not any(b in _ancestors(model, other) for other in moving)]
    if not ends:
        raise DataError(f"{file} has no joint that turns or slides.", hint="Give a robot file with an arm in it.")
    if len(ends) > 1:
        branches = [[_name(model, j) for a in (*_ancestors(model, b)[::-1], b) for j in _held(model, a)] for b in ends]
        lines = "; ".join(f"({i}) {', '.join(branch)}" for i, branch in enumerate(branches, start=1))
        hint = "Choose one in a model file: robot, and joints = [names] or tool = a body or site."
        raise DataError(f"{file} has {len(ends)} branches, expected one serial arm: {lines}.", hint=hint)
    return ends[0]


def _check_joints(model: Any, file: str, ids: Sequence[int]) -> None:
    free = [_name(model, j) for j in ids if model.jnt_type[j] in (FREE, BALL)]
    if free:
        raise DataError(
            f"{file}: {', '.join(free)} is a free or ball joint; an arm has joints that turn or slide.",
            hint="Name a base behind it or a tool before it (base, tool = a body), or fix it in the file.",
        )
    if not ids:
        hint = "Name a base before it and a tool behind."
        raise DataError(f"{file}: no joint lies between base and tool.", hint=hint)


def _check_loops(model: Any, file: str, ids: Sequence[int], link_of: Sequence[int]) -> None:
    """Refuse constraints that tie one link of the arm to another or to the world."""
    if model.opt.disableflags & mujoco_library().mjtDisableBit.mjDSBL_EQUALITY:
        return
    for e in range(model.neq):
        first, second = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if not model.eq_active0[e]:
            continue
        if model.eq_type[e] in (CONNECT, WELD):
            if model.eq_objtype[e] == SITE:
                first, second = int(model.site_bodyid[first]), int(model.site_bodyid[second])
            closed = link_of[first] != link_of[second]
        else:
            closed = model.eq_type[e] == COUPLED and first in ids and (second < 0 or second in ids)
        if closed:
            joints = [_name(model, j) for j in (first, second) if j >= 0] if model.eq_type[e] == COUPLED else []
            tied = f" that ties joints {' and '.join(joints)}" if joints else ""
            raise DataError(
                f"{file}: the equality constraint {model.equality(e).name or e}{tied} closes a loop on the arm.",
                hint='Only serial arms are read: remove it (a URDF\'s <mimic>), or set active="false" in a copy.',
            )


def _remarks(model: Any, ids: Sequence[int], link_of: Sequence[int]) -> tuple[str, ...]:
    lifted = [model.body(b).name for b in range(model.nbody) if link_of[b] and model.body_gravcomp[b]]
    found = [f"gravity compensation of {', '.join(lifted)} is not simulated"] if lifted else []
    if model.opt.density or model.opt.viscosity:
        found.append("drag of air or water (density, viscosity) is not simulated")
    dofs = model.jnt_dofadr[list(ids)]
    if model.jnt_stiffnesspoly[list(ids)].any() or model.dof_dampingpoly[dofs].any():
        found.append("of springs and damping only the linear part is simulated")
    return tuple(found)


def _body(model: Any, file: str, name: str, role: str) -> int:
    known = [model.body(b).name for b in range(model.nbody)]
    if name not in known:
        sites = [model.site(s).name for s in range(model.nsite)] if role == "tool" else []
        hint = f"Its bodies{' and sites' if sites else ''}: {', '.join(known + sites)}."
        raise DataError(f"{file} has no {role} {name!r}.", hint=hint)
    return known.index(name)


def _ancestors(model: Any, body: int) -> list[int]:
    """Bodies that carry a body, the nearest first, the world last."""
    found = []
    while body != WORLD:
        body = int(model.body_parentid[body])
        found.append(body)
    return found


def _joints_of(model: Any, body: int) -> list[int]:
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    return list(range(first, first + count)) if count else []


def _held(model: Any, body: int) -> list[int]:
    """Joints of a body that tie it to its parent: a ball joint ends up refused, a loose thing is no arm."""
    return [j for j in _joints_of(model, body) if model.jnt_type[j] != FREE]


def _name(model: Any, j: int) -> str:
    return str(model.joint(j).name)


def mujoco_library() -> Any:
    """Return the module."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError("mujoco", extra="mujoco", purpose="Reading a robot file (MJCF or URDF)") from error
    return mujoco


def friction_onsets(model: Any) -> FloatArray:
    """Return `onset` and `onset_time` `(2, nv)` of each degree of freedom's friction: 0 where there is none.

    MuJoCo's friction f leaves an acceleration v' by which `v' + R f = -b v`, as long as f is below the friction loss
    (its documentation, Computation, constraint model). R and b are taken where the arm is at its zero.

    Parameters
    ----------
    model : mujoco.MjModel
    """
    mujoco = mujoco_library()
    onsets, data = np.zeros((2, model.nv)), mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    b = np.maximum(data.efc_KBIP.reshape(-1, 4)[rows, 1], mujoco.mjMINVAL)
    onsets[:, data.efc_id[rows]] = data.efc_frictionloss[rows] * data.efc_R[rows] / b, 1.0 / b
    return onsets
