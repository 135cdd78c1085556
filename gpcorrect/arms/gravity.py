"""What gravity does to an arm: the joint torques it exerts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.arms.chain import Chain
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array

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
    g = np.asarray(gravity, dtype=np.float64)
    if g.shape != (3,):
        raise DataError(f"gravity must be (3,) m/s^2 in the base frame, got shape {g.shape}.")
    if len(links) > chain.dof:
        raise DataError(f"the chain has {chain.dof} links, masses were given for {len(links)}.")
    frames, tip = chain.frames(q), chain.forward(q)[..., :3, 3]
    loads = [(link.mass, frames[..., i, :3, :3] @ link.com + frames[..., i, :3, 3]) for i, link in enumerate(links)]
    torque = np.zeros((*frames.shape[:-3], chain.dof))
    for carrier, (mass, centre) in enumerate(loads, start=1):
        torque = torque + mass * _force(chain, q, g, centre, carrier)
    return torque + np.asarray(payload, dtype=np.float64)[..., None] * _force(chain, q, g, tip, chain.dof)


def _force(chain: Chain, q: ArrayLike, g: FloatArray, point: FloatArray, carrier: int) -> FloatArray:
    """Generalised forces (..., dof) of a unit mass at a point (..., 3) that a link carries."""
    force: FloatArray = g @ chain.point_jacobian(q, point[..., None, :], carrier)[..., :3, :]
    return force
