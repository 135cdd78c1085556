"""The rigid-body recursion, compiled: from one posture and its rates to what gravity and inertia ask of each joint.

Twists and wrenches are taken about the base origin, so that one recursion serves every Denavit-Hartenberg convention: a
joint is a screw, the twist of a link is the sum of the screws before it, and a joint's load is its screw times the
wrenches behind it (Featherstone 2008, Rigid Body Dynamics Algorithms, Sec. 5.3, in a fixed frame). Vectors are tuples:
no array is made for any of them.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

import numpy as np
from numba import njit

from gpcorrect.types import BoolArray, FloatArray, IntArray

Vector = tuple[float, float, float]
Moments = tuple[float, float, float, float, float, float]  # xx, yy, zz, xy, xz, yz
Frame = tuple[Vector, Vector, Vector, Vector]  # x, y and z axis, origin
Twist = tuple[Vector, Vector, Vector, Vector]  # omega, v, alpha, a of what rides on a link, at the base origin
GRAVITY, INERTIAL = 0, 1
POINT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # moments of a point mass


class Tables(NamedTuple):
    """An arm of `dof` joints, `k` of which move, as arrays.

    Parameters
    ----------
    dh : (dof, 5) array, cos(alpha), sin(alpha), a, d, theta
    placements : (dof, 4, 4) or (0, 4, 4) array, fixed motion before each row, or none at all
    prismatic : (dof,) bool array, whether the joint value adds to d, not theta
    modified : bool, Craig's convention
    column : (dof,) int array, column of each moving joint, -1 for held ones
    base, tool : (4, 4) arrays, as in the chain
    mass : (dof,) array, kg
    com : (dof, 3) array, m, link frames
    moments : (dof, 6) array, inertia about the centre of mass, link frames: xx, yy, zz, xy, xz, yz, kg m^2
    gravity : (3,) array, m/s^2
    """

    dh: FloatArray
    placements: FloatArray
    prismatic: BoolArray
    modified: bool
    column: IntArray
    base: FloatArray
    tool: FloatArray
    mass: FloatArray
    com: FloatArray
    moments: FloatArray
    gravity: FloatArray


@njit(cache=True, nogil=True)
def rigid_loads(
    first: int,
    last: int,
    tables: Tables,
    payload: FloatArray,
    q: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    out: FloatArray,
) -> None:
    """Write the loads of the postures `first` to `last` into `out`.

    Parameters
    ----------
    first, last : int, of the m postures
    tables : Tables, the arm
    payload : (m,) array, kg at the tip
    q : (m, dof) array, all joint values
    velocity, acceleration : (m, k) arrays, rates of the moving ones
    out : (2, m, k) array, loads that hold the arm up, and loads that accelerate it
    """
    screws, wrenches = np.empty((velocity.shape[1], 6)), np.empty((q.shape[1], 12))
    for r in range(first, last):
        _outward(tables, r, payload, q, velocity, acceleration, screws, wrenches)
        _inward(tables, r, screws, wrenches, out)


@njit(cache=True, nogil=True)
def rigid_inertias(first: int, last: int, tables: Tables, payload: FloatArray, q: FloatArray, out: FloatArray) -> None:
    """Write the diagonals of the mass matrices of the postures `first` to `last` into `out`.

    Parameters
    ----------
    first, last, tables, payload, q
        As of :func:`rigid_loads`.
    out : (m, k) array, result
    """
    screws = np.empty((out.shape[1], 6))
    for r in range(first, last):
        frame = _base(tables)
        for i in range(q.shape[1]):
            axis, frame = _link(tables, i, q[r, i], frame)
            if tables.column[i] >= 0:
                w, v = _screw(axis, tables.prismatic[i])
                _keep(screws, tables.column[i], w, v)
            if tables.mass[i] > 0.0:
                _move(tables, i, tables.mass[i], _moments(tables, i), _centre(tables, i, frame), frame, screws, out, r)
        if payload[r] != 0.0:
            _move(tables, q.shape[1] - 1, payload[r], POINT, _tip(tables, frame), frame, screws, out, r)


@njit(cache=True)
def _outward(
    tables: Tables,
    r: int,
    payload: FloatArray,
    q: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    screws: FloatArray,
    wrenches: FloatArray,
) -> None:
    """From the base to the tip: screws of the joints, and what weight and inertia of each link ask."""
    frame, rest = _base(tables), (0.0, 0.0, 0.0)
    twist = (rest, rest, rest, rest)
    for i in range(q.shape[1]):
        axis, frame = _link(tables, i, q[r, i], frame)
        j = tables.column[i]
        if j >= 0:
            w, v = _screw(axis, tables.prismatic[i])
            _keep(screws, j, w, v)
            twist = _ridden(twist, w, v, velocity[r, j], acceleration[r, j])
        for c in range(12):
            wrenches[i, c] = 0.0
        if tables.mass[i] > 0.0:
            _carry(tables, tables.mass[i], _moments(tables, i), _centre(tables, i, frame), frame, twist, wrenches, i)
    if payload[r] != 0.0:
        _carry(tables, payload[r], POINT, _tip(tables, frame), frame, twist, wrenches, q.shape[1] - 1)


@njit(cache=True)
def _inward(tables: Tables, r: int, screws: FloatArray, wrenches: FloatArray, out: FloatArray) -> None:
    """From the tip to the base: each joint takes its screw's share of all wrenches behind it."""
    for i in range(len(wrenches) - 1, -1, -1):
        j = tables.column[i]
        if j >= 0:
            weight, inertia = 0.0, 0.0
            for c in range(6):
                weight += screws[j, c] * wrenches[i, c]
                inertia += screws[j, c] * wrenches[i, 6 + c]
            out[GRAVITY, r, j], out[INERTIAL, r, j] = weight, inertia
        if i > 0:
            for c in range(12):
                wrenches[i - 1, c] += wrenches[i, c]


@njit(cache=True)
def _base(tables: Tables) -> Frame:
    return _column(tables.base, 0), _column(tables.base, 1), _column(tables.base, 2), _column(tables.base, 3)


@njit(cache=True)
def _centre(tables: Tables, i: int, frame: Frame) -> Vector:
    return _at(frame, tables.com[i, 0], tables.com[i, 1], tables.com[i, 2])


@njit(cache=True)
def _moments(tables: Tables, i: int) -> Moments:
    m = tables.moments
    return m[i, 0], m[i, 1], m[i, 2], m[i, 3], m[i, 4], m[i, 5]


@njit(cache=True)
def _tip(tables: Tables, frame: Frame) -> Vector:
    return _at(frame, tables.tool[0, 3], tables.tool[1, 3], tables.tool[2, 3])


@njit(cache=True)
def _keep(screws: FloatArray, j: int, w: Vector, v: Vector) -> None:
    screws[j, 0], screws[j, 1], screws[j, 2] = w
    screws[j, 3], screws[j, 4], screws[j, 5] = v


@njit(cache=True)
def _column(matrix: FloatArray, j: int) -> Vector:
    return matrix[0, j], matrix[1, j], matrix[2, j]


@njit(cache=True)
def _at(frame: Frame, x: float, y: float, z: float) -> Vector:
    """Point of a frame in base coordinates."""
    return _add(_add(frame[3], _scaled(x, frame[0])), _add(_scaled(y, frame[1]), _scaled(z, frame[2])))


@njit(cache=True)
def _link(tables: Tables, i: int, value: float, frame: Frame) -> tuple[Frame, Frame]:
    """Frame along whose z axis joint i moves, and frame of link i."""
    cosine, sine, a = tables.dh[i, 0], tables.dh[i, 1], tables.dh[i, 2]
    d, theta = tables.dh[i, 3], tables.dh[i, 4]
    if tables.prismatic[i]:
        d += value
    else:
        theta += value
    if len(tables.placements):
        frame = _placed(frame, tables.placements[i])
    if tables.modified:
        moved = _screw_z(_screw_x(frame, cosine, sine, a), theta, d)
        return moved, moved
    return frame, _screw_x(_screw_z(frame, theta, d), cosine, sine, a)


@njit(cache=True)
def _screw(axis: Frame, prismatic: bool) -> tuple[Vector, Vector]:
    if prismatic:
        return (0.0, 0.0, 0.0), axis[2]
    return axis[2], _cross(axis[3], axis[2])


@njit(cache=True)
def _ridden(twist: Twist, w: Vector, v: Vector, rate: float, change: float) -> Twist:
    """Twist behind a joint: its screw moves with the links before it."""
    omega, velocity, alpha, a = twist
    alpha = _add(alpha, _add(_scaled(change, w), _scaled(rate, _cross(omega, w))))
    drag = _add(_cross(omega, v), _cross(velocity, w))
    a = _add(a, _add(_scaled(change, v), _scaled(rate, drag)))
    return _add(omega, _scaled(rate, w)), _add(velocity, _scaled(rate, v)), alpha, a


@njit(cache=True)
def _carry(
    tables: Tables,
    mass: float,
    moments: Moments,
    centre: Vector,
    frame: Frame,
    twist: Twist,
    wrenches: FloatArray,
    i: int,
) -> None:
    """Add the wrenches that a body's weight and its motion ask for."""
    omega, v, alpha, a = twist
    weight = (-mass * tables.gravity[0], -mass * tables.gravity[1], -mass * tables.gravity[2])
    v_centre = _add(v, _cross(omega, centre))
    force = _scaled(mass, _add(_add(a, _cross(alpha, centre)), _cross(omega, v_centre)))
    spin = _add(_times(frame, moments, alpha), _cross(omega, _times(frame, moments, omega)))
    moment, lever = _add(_cross(centre, force), spin), _cross(centre, weight)
    for c in range(3):
        wrenches[i, c] += lever[c]
        wrenches[i, 3 + c] += weight[c]
        wrenches[i, 6 + c] += moment[c]
        wrenches[i, 9 + c] += force[c]


@njit(cache=True)
def _move(
    tables: Tables,
    link: int,
    mass: float,
    moments: Moments,
    centre: Vector,
    frame: Frame,
    screws: FloatArray,
    out: FloatArray,
    r: int,
) -> None:
    """Add a body's inertia at each joint before it."""
    for i in range(link + 1):
        j = tables.column[i]
        if j < 0:
            continue
        w, v = (screws[j, 0], screws[j, 1], screws[j, 2]), (screws[j, 3], screws[j, 4], screws[j, 5])
        unit = _add(v, _cross(w, centre))
        out[r, j] += mass * _dot(unit, unit) + _dot(w, _times(frame, moments, w))


@njit(cache=True)
def _times(frame: Frame, moments: Moments, vector: Vector) -> Vector:
    """Inertia in a frame's axes, times a vector in base axes."""
    x, y, z, _ = frame
    a, b, c = _dot(x, vector), _dot(y, vector), _dot(z, vector)
    xx, yy, zz, xy, xz, yz = moments
    along = _scaled(xx * a + xy * b + xz * c, x)
    return _add(along, _add(_scaled(xy * a + yy * b + yz * c, y), _scaled(xz * a + yz * b + zz * c, z)))


@njit(cache=True)
def _add(a: Vector, b: Vector) -> Vector:
    """Sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def _scaled(s: float, a: Vector) -> Vector:
    """Multiple."""
    return s * a[0], s * a[1], s * a[2]


@njit(cache=True)
def _dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _placed(frame: Frame, by: FloatArray) -> Frame:
    """Frame moved by a rigid motion in its own axes."""
    x, y, z = _turned(frame, by, 0), _turned(frame, by, 1), _turned(frame, by, 2)
    return x, y, z, _add(frame[3], _turned(frame, by, 3))


@njit(cache=True)
def _turned(frame: Frame, by: FloatArray, k: int) -> Vector:
    """Column of a matrix, given in a frame's axes, in base axes."""
    return _add(_scaled(by[0, k], frame[0]), _add(_scaled(by[1, k], frame[1]), _scaled(by[2, k], frame[2])))


@njit(cache=True)
def _screw_z(frame: Frame, angle: float, shift: float) -> Frame:
    """Frame turned about and moved along its own z axis."""
    x, y, z, origin = frame
    c, s = cos(angle), sin(angle)
    return _add(_scaled(c, x), _scaled(s, y)), _add(_scaled(c, y), _scaled(-s, x)), z, _add(origin, _scaled(shift, z))


@njit(cache=True)
def _screw_x(frame: Frame, cosine: float, sine: float, shift: float) -> Frame:
    """Frame turned about its own x axis by an angle of this cosine and sine, and moved along it."""
    x, y, z, origin = frame
    turned = _add(_scaled(cosine, y), _scaled(sine, z)), _add(_scaled(cosine, z), _scaled(-sine, y))
    return x, turned[0], turned[1], _add(origin, _scaled(shift, x))
