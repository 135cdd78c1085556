"""What motion and weight ask of the joints: inverse dynamics in base coordinates.

Twists and wrenches are taken about the base origin, so that one recursion serves every Denavit-Hartenberg convention:
a joint is a screw, the twist of a link is the sum of the screws before it, and a joint's load is its screw times the
wrenches behind it (Featherstone 2008, Rigid Body Dynamics Algorithms, Sec. 5.3, in a fixed frame).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.arms import Chain
from gpcorrect.sim.body import Body
from gpcorrect.types import FloatArray

__all__ = ["Posture", "posture_at"]

Twist = tuple[FloatArray, FloatArray, FloatArray, FloatArray]  # omega, v, alpha, a


@dataclass(frozen=True, eq=False)
class Posture:
    """Screws and masses of an arm at joint values of leading shape `(...)`.

    Parameters
    ----------
    angular, linear : tuple of (..., 3) arrays
        Twist of each moving joint at unit rate: angular velocity, and velocity of the point at the base origin.
    carriers : tuple of int
        For each mass, how many moving joints carry it.
    masses : tuple of arrays that broadcast to (...)
        kg.
    centres : tuple of (..., 3) arrays
        Centres of mass, base frame, m.
    inertias : tuple of (..., 3, 3) arrays or None
        Moments about the centres, base axes, kg m^2; None for point masses.
    gravity : (3,) array
        m/s^2.
    """

    angular: tuple[FloatArray, ...]
    linear: tuple[FloatArray, ...]
    carriers: tuple[int, ...]
    masses: tuple[FloatArray, ...]
    centres: tuple[FloatArray, ...]
    inertias: tuple[FloatArray | None, ...]
    gravity: FloatArray

    def gravity_load(self) -> FloatArray:
        """Torques or forces `(..., k)` that hold the arm up against gravity."""
        wrenches = []
        for mass, centre in zip(self.masses, self.centres, strict=True):
            force = np.broadcast_to(-mass[..., None] * self.gravity, centre.shape)
            wrenches.append((np.cross(centre, force), force))
        return self._project(wrenches)

    def inertial_load(self, velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Torques or forces `(..., k)` that make the links follow joint rates and accelerations `(..., k)`."""
        twists = self._twists(velocity, acceleration)
        wrenches = []
        for i, carrier in enumerate(self.carriers):
            omega, v, alpha, a = twists[carrier]
            centre = self.centres[i]
            v_centre = v + np.cross(omega, centre)
            force = self.masses[i][..., None] * (a + np.cross(alpha, centre) + np.cross(omega, v_centre))
            moment = np.cross(centre, force)
            inertia = self.inertias[i]
            if inertia is not None:
                moment = moment + _times(inertia, alpha) + np.cross(omega, _times(inertia, omega))
            wrenches.append((moment, force))
        return self._project(wrenches)

    def inertia_diagonal(self) -> FloatArray:
        """Diagonal `(..., k)` of the joint-space mass matrix."""
        diagonal = np.zeros((*self._lead, len(self.angular)))
        for i, carrier in enumerate(self.carriers):
            inertia = self.inertias[i]
            for j in range(carrier):
                v = self.linear[j] + np.cross(self.angular[j], self.centres[i])
                diagonal[..., j] += self.masses[i] * (v * v).sum(axis=-1)
                if inertia is not None:
                    diagonal[..., j] += (self.angular[j] * _times(inertia, self.angular[j])).sum(axis=-1)
        return diagonal

    @property
    def _lead(self) -> tuple[int, ...]:
        return self.angular[0].shape[:-1]

    def _twists(self, velocity: FloatArray, acceleration: FloatArray) -> list[Twist]:
        """Angular and linear velocity and acceleration behind 0, 1, ... joints; screws move with the links before."""
        rest = np.zeros((*self._lead, 3))
        omega, v, alpha, a = rest, rest, rest, rest
        twists: list[Twist] = [(omega, v, alpha, a)]
        for j, (w_j, v_j) in enumerate(zip(self.angular, self.linear, strict=True)):
            rate, change = velocity[..., j, None], acceleration[..., j, None]
            alpha = alpha + w_j * change + np.cross(omega, w_j) * rate
            a = a + v_j * change + (np.cross(omega, v_j) + np.cross(v, w_j)) * rate
            omega, v = omega + w_j * rate, v + v_j * rate
            twists.append((omega, v, alpha, a))
        return twists

    def _project(self, wrenches: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
        """Power of the masses' wrenches on each joint's unit twist."""
        load = np.zeros((*self._lead, len(self.angular)))
        for j, (w_j, v_j) in enumerate(zip(self.angular, self.linear, strict=True)):
            for carrier, (moment, force) in zip(self.carriers, wrenches, strict=True):
                if carrier > j:
                    load[..., j] += (w_j * moment).sum(axis=-1) + (v_j * force).sum(axis=-1)
        return load


def posture_at(body: Body, q: FloatArray) -> Posture | None:
    """Screws and masses at moving joint values `(..., N, k)`; None when nothing weighs anything."""
    links = body.links
    if body.chain is None or not (links.mass.any() or links.payload.any()):
        return None
    values = body.all_joints(q)
    frames = body.chain.frames(values)
    axes = _axis_frames(body.chain, frames)
    screws = [_screw(axes[..., i, :, :], t) for i, t in zip(body.columns, body.types, strict=True)]
    parts = _link_parts(body, frames) + _payload_part(body, frames)
    carriers, masses, centres, inertias = zip(*parts, strict=True)
    return Posture(
        tuple(s[0] for s in screws), tuple(s[1] for s in screws), carriers, masses, centres, inertias, body.gravity
    )


Part = tuple[int, FloatArray, FloatArray, FloatArray | None]


def _axis_frames(chain: Chain, frames: FloatArray) -> FloatArray:
    """Frames whose z axes the joints turn about: the standard convention's are those of the link before."""
    if chain.convention == "modified":
        return frames
    base = np.broadcast_to(chain.base, (*frames.shape[:-3], 1, 4, 4))
    return np.concatenate([base, frames[..., :-1, :, :]], axis=-3)


def _screw(T_base_axis: FloatArray, joint_type: str) -> tuple[FloatArray, FloatArray]:
    direction, point = T_base_axis[..., :3, 2], T_base_axis[..., :3, 3]
    if joint_type == "P":
        return np.zeros(direction.shape), direction
    return direction, np.cross(point, direction)


def _link_parts(body: Body, frames: FloatArray) -> list[Part]:
    parts: list[Part] = []
    for i, (mass, com, moments) in enumerate(
        zip(body.links.mass, body.links.com, body.links.inertia_diagonal, strict=True)
    ):
        rotation = frames[..., i, :3, :3]
        centre = rotation @ com + frames[..., i, :3, 3]
        inertia = (rotation * moments) @ np.swapaxes(rotation, -1, -2) if moments.any() else None
        parts.append((sum(c <= i for c in body.columns), np.asarray(mass), centre, inertia))
    return parts


def _payload_part(body: Body, frames: FloatArray) -> list[Part]:
    assert body.chain is not None
    if not body.links.payload.any():
        return []
    tip = (frames[..., -1, :, :] @ body.chain.tool)[..., :3, 3]
    return [(len(body.columns), body.links.payload, tip, None)]


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    product: FloatArray = (matrix @ vector[..., None])[..., 0]
    return product
