"""Vectors and frames of three dimensions as tuples, for compiled loops: no array is made for any of them."""

from __future__ import annotations

from math import cos, sin

from numba import njit

__all__ = ["Frame", "Vector", "add", "cross", "dot", "scaled", "screw_x", "screw_z"]

Vector = tuple[float, float, float]
Frame = tuple[Vector, Vector, Vector, Vector]  # x, y and z axis, origin


@njit(cache=True)
def add(a: Vector, b: Vector) -> Vector:
    """Sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def scaled(s: float, a: Vector) -> Vector:
    """Multiple."""
    return s * a[0], s * a[1], s * a[2]


@njit(cache=True)
def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def screw_z(frame: Frame, angle: float, shift: float) -> Frame:
    """Frame turned about and moved along its own z axis."""
    x, y, z, origin = frame
    c, s = cos(angle), sin(angle)
    return add(scaled(c, x), scaled(s, y)), add(scaled(c, y), scaled(-s, x)), z, add(origin, scaled(shift, z))


@njit(cache=True)
def screw_x(frame: Frame, cosine: float, sine: float, shift: float) -> Frame:
    """Frame turned about its own x axis by an angle of this cosine and sine, and moved along it."""
    x, y, z, origin = frame
    turned = add(scaled(cosine, y), scaled(sine, z)), add(scaled(cosine, z), scaled(-sine, y))
    return x, turned[0], turned[1], add(origin, scaled(shift, x))
