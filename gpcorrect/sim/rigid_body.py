"""The rigid-body recursion, compiled: from one posture and its rates to what gravity and inertia ask of each joint.

Twists and wrenches are taken about the base origin, so that one recursion serves every Denavit-Hartenberg convention: a
joint is a screw, the twist of a link is the sum of the screws before it, and a joint's load is its screw times the
wrenches behind it (Featherstone 2008, Rigid Body Dynamics Algorithms, Sec. 5.3, in a fixed frame).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.sim.vectors import Frame, Vector, add, cross, dot, scaled, screw_x, screw_z
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Tables", "rigid_loads"]

Twist = tuple[Vector, Vector, Vector, Vector]  # omega, v, alpha, a of what rides on a link, at the base origin
GRAVITY, INERTIAL, DIAGONAL = 0, 1, 2


class Tables(NamedTuple):
    """An arm of `dof` joints, `k` of which move, as arrays.

    Parameters
    ----------
    dh : (dof, 4) array
        alpha, a, d, theta.
    prismatic : (dof,) bool array
        Whether the joint value adds to d, not theta.
    modified : bool
        Craig's convention.
    column : (dof,) int array
        Column of each moving joint, -1 for held ones.
    base, tool : (4, 4) arrays
        As in the chain.
    mass : (dof,) array
        kg.
    com, moments : (dof, 3) arrays
        m and kg m^2, link frames.
    gravity : (3,) array
        m/s^2.
    """

    dh: FloatArray
    prismatic: BoolArray
    modified: bool
    column: IntArray
    base: FloatArray
    tool: FloatArray
    mass: FloatArray
    com: FloatArray
    moments: FloatArray
    gravity: FloatArray


@njit(cache=True)
def rigid_loads(
    tables: Tables, payload: FloatArray, q: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Return loads and inertias of many postures.

    Parameters
    ----------
    tables : Tables
        The arm.
    payload : (m,) array
        kg at the tip.
    q : (m, dof) array
        All joint values.
    velocity, acceleration : (m, k) arrays
        Rates of the moving ones.

    Returns
    -------
    (3, m, k) array
        Loads that hold the arm up, loads that accelerate it, and the diagonal of the mass matrix.
    """
    out = np.zeros((3, *velocity.shape))
    screws = np.empty((velocity.shape[1], 6))
    for r in range(len(q)):
        _posture(tables, payload[r], q[r], velocity[r], acceleration[r], screws, out[:, r])
    return out


@njit(cache=True)
def _posture(
    tables: Tables,
    payload: float,
    q: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    screws: FloatArray,
    out: FloatArray,
) -> None:
    frame = (_column(tables.base, 0), _column(tables.base, 1), _column(tables.base, 2), _column(tables.base, 3))
    rest = (0.0, 0.0, 0.0)
    twist = (rest, rest, rest, rest)
    for i in range(len(q)):
        axis, frame = _link(tables, i, q[i], frame)
        j = tables.column[i]
        if j >= 0:
            w, v = _screw(axis, tables.prismatic[i])
            screws[j, 0], screws[j, 1], screws[j, 2] = w
            screws[j, 3], screws[j, 4], screws[j, 5] = v
            twist = _ridden(twist, w, v, velocity[j], acceleration[j])
        if tables.mass[i] > 0.0:
            centre = _at(frame, tables.com[i, 0], tables.com[i, 1], tables.com[i, 2])
            _carry(tables, i, tables.mass[i], tables.moments[i], centre, frame, twist, screws, out)
    if payload > 0.0:
        tip = _at(frame, tables.tool[0, 3], tables.tool[1, 3], tables.tool[2, 3])
        _carry(tables, len(q) - 1, payload, np.zeros(3), tip, frame, twist, screws, out)


@njit(cache=True)
def _column(matrix: FloatArray, j: int) -> Vector:
    return matrix[0, j], matrix[1, j], matrix[2, j]


@njit(cache=True)
def _at(frame: Frame, x: float, y: float, z: float) -> Vector:
    """Point of a frame in base coordinates."""
    return add(add(frame[3], scaled(x, frame[0])), add(scaled(y, frame[1]), scaled(z, frame[2])))


@njit(cache=True)
def _link(tables: Tables, i: int, value: float, frame: Frame) -> tuple[Frame, Frame]:
    """Frame along whose z axis joint i moves, and frame of link i."""
    alpha, a, d, theta = tables.dh[i, 0], tables.dh[i, 1], tables.dh[i, 2], tables.dh[i, 3]
    if tables.prismatic[i]:
        d += value
    else:
        theta += value
    if tables.modified:
        moved = screw_z(screw_x(frame, alpha, a), theta, d)
        return moved, moved
    return frame, screw_x(screw_z(frame, theta, d), alpha, a)


@njit(cache=True)
def _screw(axis: Frame, prismatic: bool) -> tuple[Vector, Vector]:
    if prismatic:
        return (0.0, 0.0, 0.0), axis[2]
    return axis[2], cross(axis[3], axis[2])


@njit(cache=True)
def _ridden(twist: Twist, w: Vector, v: Vector, rate: float, change: float) -> Twist:
    """Twist behind a joint: its screw moves with the links before it."""
    omega, velocity, alpha, a = twist
    alpha = add(alpha, add(scaled(change, w), scaled(rate, cross(omega, w))))
    drag = add(cross(omega, v), cross(velocity, w))
    a = add(a, add(scaled(change, v), scaled(rate, drag)))
    return add(omega, scaled(rate, w)), add(velocity, scaled(rate, v)), alpha, a


@njit(cache=True)
def _carry(
    tables: Tables,
    link: int,
    mass: float,
    moments: FloatArray,
    centre: Vector,
    frame: Frame,
    twist: Twist,
    screws: FloatArray,
    out: FloatArray,
) -> None:
    """Add one body's share to the loads of every joint before it."""
    omega, v, alpha, a = twist
    weight = (-mass * tables.gravity[0], -mass * tables.gravity[1], -mass * tables.gravity[2])
    v_centre = add(v, cross(omega, centre))
    force = scaled(mass, add(add(a, cross(alpha, centre)), cross(omega, v_centre)))
    spin = add(_times(frame, moments, alpha), cross(omega, _times(frame, moments, omega)))
    moment = add(cross(centre, force), spin)
    lever = cross(centre, weight)
    for i in range(link + 1):
        j = tables.column[i]
        if j < 0:
            continue
        w_j, v_j = (screws[j, 0], screws[j, 1], screws[j, 2]), (screws[j, 3], screws[j, 4], screws[j, 5])
        out[GRAVITY, j] += dot(w_j, lever) + dot(v_j, weight)
        out[INERTIAL, j] += dot(w_j, moment) + dot(v_j, force)
        unit = add(v_j, cross(w_j, centre))
        out[DIAGONAL, j] += mass * dot(unit, unit) + dot(w_j, _times(frame, moments, w_j))


@njit(cache=True)
def _times(frame: Frame, moments: FloatArray, vector: Vector) -> Vector:
    """Inertia, principal along the frame's axes, times a vector in base axes."""
    x, y, z, _ = frame
    along = scaled(moments[0] * dot(x, vector), x)
    return add(along, add(scaled(moments[1] * dot(y, vector), y), scaled(moments[2] * dot(z, vector), z)))
