"""Equations of motion of two turning joints and a sliding one, by Kane's method: forces on partial velocities.

Kane and Levinson 1985, Dynamics: Theory and Applications. Compiled, with vectors as tuples of three numbers: nothing is
allocated in the hot path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Body(NamedTuple):
    """Geometry and masses.

    `rows` (6, 4) is the Denavit-Hartenberg table, `mass` (4,) kg of links 1 to 3 and the tip's load, `centre` (4, 3) m
    in link frames (the tip's load in that of link 3), `moment` (4, 3) kg m^2 along the frames' axes, `gravity` (3,).
    """

    rows: Array
    mass: Array
    centre: Array
    moment: Array
    gravity: Array


@njit(cache=True)
def cross(u, v):
    """Vector product."""
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@njit(cache=True)
def dot(u, v):
    """Scalar product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(cache=True)
def plus(u, s, v):
    """Return u + s v."""
    return (u[0] + s * v[0], u[1] + s * v[1], u[2] + s * v[2])


@njit(cache=True)
def turned(u, v, angle):
    """Two axes turned from the first to the second."""
    c, s = np.cos(angle), np.sin(angle)
    return (
        (c * u[0] + s * v[0], c * u[1] + s * v[1], c * u[2] + s * v[2]),
        (c * v[0] - s * u[0], c * v[1] - s * u[1], c * v[2] - s * u[2]),
    )


@njit(cache=True)
def swung(omega, alpha, r):
    """Acceleration of a point at r of a turning body: alpha x r + omega x (omega x r)."""
    return plus(cross(alpha, r), 1.0, cross(omega, cross(omega, r)))


@njit(cache=True)
def _place(x, y, z, body, k):
    along = body.centre[k, 0]
    return plus(plus((along * x[0], along * x[1], along * x[2]), body.centre[k, 1], y), body.centre[k, 2], z)


@njit(cache=True)
def _add_mass(link, k, body, frame, motion, joints, M, bias, weight):
    """Add the terms of mass k, which rides on a link (0 to 2)."""
    m = body.mass[k]
    if m == 0.0:
        return
    gravity = (body.gravity[0], body.gravity[1], body.gravity[2])
    moment = (body.moment[k, 0], body.moment[k, 1], body.moment[k, 2])
    x, y, z, origin = frame
    omega, alpha, a = motion
    (w0, o0), (w1, o1), w2 = joints
    arm = _place(x, y, z, body, k)
    p = plus(origin, 1.0, arm)
    a_c = plus(a, 1.0, swung(omega, alpha, arm))
    spin, change = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for axis, i in ((x, moment[0]), (y, moment[1]), (z, moment[2])):
        spin = plus(spin, i * dot(axis, omega), axis)
        change = plus(change, i * dot(axis, alpha), axis)
    torque = plus(change, 1.0, cross(omega, spin))
    v0 = cross(w0, plus(p, -1.0, o0))
    M[0, 0] += m * dot(v0, v0)
    bias[0] += m * dot(v0, a_c) + dot(w0, torque)
    weight[0] -= m * dot(v0, gravity)
    for axis, i in ((x, moment[0]), (y, moment[1]), (z, moment[2])):
        M[0, 0] += i * dot(axis, w0) ** 2
    if link == 0:
        return
    v1 = cross(w1, plus(p, -1.0, o1))
    M[0, 1] += m * dot(v0, v1)
    M[1, 1] += m * dot(v1, v1)
    bias[1] += m * dot(v1, a_c) + dot(w1, torque)
    weight[1] -= m * dot(v1, gravity)
    for axis, i in ((x, moment[0]), (y, moment[1]), (z, moment[2])):
        M[0, 1] += i * dot(axis, w0) * dot(axis, w1)
        M[1, 1] += i * dot(axis, w1) ** 2
    if link == 1:
        return
    M[0, 2] += m * dot(v0, w2)
    M[1, 2] += m * dot(v1, w2)
    M[2, 2] += m
    bias[2] += m * dot(w2, a_c)
    weight[2] -= m * dot(w2, gravity)


@njit(cache=True)
def equations(body, q, v, M, bias, weight):
    """Fill M, bias, weight of `M(q) q'' + bias(q, q') + weight(q) = torque`."""
    for i in range(3):
        bias[i], weight[i] = 0.0, 0.0
        for j in range(3):
            M[i, j] = 0.0
    rows = body.rows
    x, y, z, o = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    # shoulder
    o = plus(o, rows[0, 1], x)
    y, z = turned(y, z, rows[0, 0])
    o = plus(o, rows[0, 2], z)
    w0, o0 = z, o
    omega, alpha, a = (v[0] * z[0], v[0] * z[1], v[0] * z[2]), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    x, y = turned(x, y, rows[0, 3] + q[0])
    joints = ((w0, o0), (w0, o0), w0)
    _add_mass(0, 0, body, (x, y, z, o), (omega, alpha, a), joints, M, bias, weight)
    # elbow
    r = (rows[1, 1] * x[0], rows[1, 1] * x[1], rows[1, 1] * x[2])
    y, z = turned(y, z, rows[1, 0])
    r = plus(r, rows[1, 2], z)
    a = plus(a, 1.0, swung(omega, alpha, r))
    o = plus(o, 1.0, r)
    w1, o1 = z, o
    alpha = plus(alpha, v[1], cross(omega, z))
    omega = plus(omega, v[1], z)
    x, y = turned(x, y, rows[1, 3] + q[1])
    joints = ((w0, o0), (w1, o1), w1)
    _add_mass(1, 1, body, (x, y, z, o), (omega, alpha, a), joints, M, bias, weight)
    # insertion
    r = (rows[2, 1] * x[0], rows[2, 1] * x[1], rows[2, 1] * x[2])
    y, z = turned(y, z, rows[2, 0])
    r = plus(r, rows[2, 2] + q[2], z)
    a = plus(plus(a, 1.0, swung(omega, alpha, r)), 2.0 * v[2], cross(omega, z))
    o = plus(o, 1.0, r)
    x, y = turned(x, y, rows[2, 3])
    joints = ((w0, o0), (w1, o1), z)
    for k in range(2, 4):
        _add_mass(2, k, body, (x, y, z, o), (omega, alpha, a), joints, M, bias, weight)
    M[1, 0], M[2, 0], M[2, 1] = M[0, 1], M[0, 2], M[1, 2]
