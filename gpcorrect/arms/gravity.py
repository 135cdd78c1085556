"""What gravity does to an arm: potential energy and the joint torques it exerts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.arms.chain import Chain
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array

__all__ = ["STANDARD_GRAVITY", "Link", "gravity_torque", "potential_energy"]

STANDARD_GRAVITY = 9.80665  # m/s^2 (CGPM 1901)


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link: its mass and where that mass sits.

    Parameters
    ----------
    mass : float
        kg.
    com : (3,) array
        Centre of mass in the link's own frame, m.
    inertia : (3, 3) array
        About the centre of mass, along the link frame's axes, kg m^2; none where it is not known.

    Raises
    ------
    DataError
        The mass is negative, or the centre is not three finite numbers.
    """

    mass: float
    com: FloatArray
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "com", frozen_array(self.com))
        object.__setattr__(self, "inertia", frozen_array(self.inertia))
        if not self.mass >= 0 or self.com.shape != (3,) or not np.isfinite(self.com).all():
            raise DataError(f"a link is a mass >= 0 kg and a centre (3,) m, got {self.mass} and {self.com}.")


def gravity_torque(
    chain: Chain, links: Sequence[Link], q: ArrayLike, gravity: ArrayLike, payload: ArrayLike = 0.0
) -> FloatArray:
    """Gravity's generalised forces (..., dof) on the joints, N m or N: minus the potential energy's gradient.

    A controller that holds the arm still exerts the opposite.

    Parameters
    ----------
    chain : Chain
        The arm.
    links : sequence of Link
        Links 1, 2, ... in order; those left out weigh nothing.
    q : (..., dof) array
        Joint values, rad and m.
    gravity : (3,) array
        Acceleration of free fall in the base frame, m/s^2.
    payload : float or (...) array
        Point mass at the tip, kg.

    Returns
    -------
    (..., dof) array

    Raises
    ------
    DataError
        More links than joints, or gravity is not (3,).
    """
    g = _checked_gravity(chain, links, gravity)
    centres, masses = _point_masses(chain, links, q, payload)
    carriers = [*range(1, len(links) + 1), chain.dof]
    torque = np.zeros(chain.joint_values(q).shape)
    for k, carrier in enumerate(carriers):
        J = chain.point_jacobian(q, centres[..., k : k + 1, :], carrier)[..., :3, :]
        torque = torque + masses[..., k, None] * (g @ J)
    return torque


def potential_energy(
    chain: Chain, links: Sequence[Link], q: ArrayLike, gravity: ArrayLike, payload: ArrayLike = 0.0
) -> FloatArray:
    """Potential energy (...), J, of links and payload, zero when every mass is at the base origin.

    Parameters
    ----------
    chain, links, q, gravity, payload
        As of :func:`gravity_torque`.
    """
    g = _checked_gravity(chain, links, gravity)
    centres, masses = _point_masses(chain, links, q, payload)
    return np.asarray(-(masses * (centres @ g)).sum(axis=-1))


def _checked_gravity(chain: Chain, links: Sequence[Link], gravity: ArrayLike) -> FloatArray:
    g = np.asarray(gravity, dtype=np.float64)
    if g.shape != (3,):
        raise DataError(f"gravity must be (3,) m/s^2 in the base frame, got shape {g.shape}.")
    if len(links) > chain.dof:
        raise DataError(f"the chain has {chain.dof} links, masses were given for {len(links)}.")
    return g


def _point_masses(
    chain: Chain, links: Sequence[Link], q: ArrayLike, payload: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Mass centres (..., k + 1, 3) in the base frame and masses (..., k + 1) of k links and the payload."""
    frames = chain.frames(q)
    centres = [frames[..., i, :3, :3] @ link.com + frames[..., i, :3, 3] for i, link in enumerate(links)]
    centres.append(chain.forward(q)[..., :3, 3])
    lead = frames.shape[:-3]
    masses = [np.full(lead, link.mass) for link in links]
    masses.append(np.broadcast_to(np.asarray(payload, dtype=np.float64), lead))
    return np.stack(centres, axis=-2), np.stack(masses, axis=-1)
