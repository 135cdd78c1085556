"""What the links ask of the joints along a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.sim.body import Body
from gpcorrect.sim.dynamics import posture_at
from gpcorrect.types import FloatArray

__all__ = ["JointPath", "LinkLoad", "link_load", "mean_inertia"]

INERTIA_STRIDE = 20  # samples; the mean only splits the load between two terms, so any will do


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint values with rate and acceleration, `(n, N, dof)` each."""

    q: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class LinkLoad:
    """Torques or forces at the joints that hold the links up and that accelerate them, `(n, N, dof)` each."""

    gravity: FloatArray
    inertial: FloatArray

    @property
    def total(self) -> FloatArray:
        """Both together."""
        return self.gravity + self.inertial


def link_load(body: Body, path: JointPath) -> LinkLoad:
    """Return the load of a body along a path; bare joints and weightless arms have none."""
    posture = posture_at(body, path.q)
    if posture is None:
        return LinkLoad(np.zeros(path.q.shape), np.zeros(path.q.shape))
    return LinkLoad(*posture.loads(path.velocity, path.acceleration))


def mean_inertia(body: Body, q: FloatArray) -> FloatArray:
    """Mean inertia `(dof,)` of the links at each joint: the servo loop moves it and is passed the rest of the load."""
    posture = posture_at(body, q[::INERTIA_STRIDE])
    if posture is None:
        return np.zeros(q.shape[-1])
    mean: FloatArray = posture.inertia_diagonal().mean(axis=(0, 1))
    return mean
