"""What motion and weight ask of the joints: inverse dynamics of a body whose other joints are held.

Compiled loops are divided among threads: they let go of the interpreter's lock, and each thread has its own part.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np

from gpcorrect.sim.body import Body
from gpcorrect.sim.rigid_body import Tables, rigid_inertias, rigid_loads
from gpcorrect.types import FloatArray

WORTH_A_THREAD = 200_000  # inner steps; chosen by hand: below, starting a thread takes longer than it saves
STEPS = 20  # steps, as threads count them, that one posture takes; a rough count, which moves no result

INERTIA_STRIDE = 20  # samples; the mean only splits the load between two terms, so any will do


def thread_count() -> int:
    """Threads that may be used: what numba may use, and no more than `OMP_NUM_THREADS` says where it is set."""
    allowed = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # set when numba is loaded
    stated = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(allowed, int(stated)) if stated.isdigit() else allowed)


def in_parts(length: int, steps: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, last)` for parts that together make `range(length)`, side by side where that pays.

    Parameters
    ----------
    length : int, of the range; its items must not depend on each other
    steps : int, inner steps of the whole work
    work : callable, compiled without the interpreter's lock; writes its results in place
    """
    parts = min(thread_count(), length, max(1, steps // WORTH_A_THREAD))
    if parts <= 1:
        work(0, length)
        return
    ends = [length * k // parts for k in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(work, ends[:-1], ends[1:]))


@dataclass(frozen=True, eq=False)
class Posture:
    """A body at joint values.

    Parameters
    ----------
    tables : Tables
    payload : (m,) array, kg, for each posture
    values : (m, dof) array
    shape : tuple of int, of the moving joints' array `(..., k)`, whose leading axes are m postures
    springs : (m, k) array or None
        Torques or forces that hold the joints against their springs, which count as gravity's do.
    """

    tables: Tables
    payload: FloatArray
    values: FloatArray
    shape: tuple[int, ...]
    springs: FloatArray | None = None

    def loads(self, velocity: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the torques or forces `(..., k)` that hold the arm up, and those that make it follow joint rates.

        Parameters
        ----------
        velocity, acceleration : (..., k) arrays, rates of the moving joints
        """
        rates = [
            np.ascontiguousarray(a, dtype=np.float64).reshape(-1, self.shape[-1]) for a in (velocity, acceleration)
        ]
        out = np.empty((2, len(self.values), self.shape[-1]))

        def part(first: int, last: int) -> None:
            rigid_loads(first, last, self.tables, self.payload, self.values, rates[0], rates[1], out)

        in_parts(len(self.values), len(self.values) * STEPS, part)
        if self.springs is not None:
            out[0] += self.springs
        return out[0].reshape(self.shape), out[1].reshape(self.shape)

    def gravity_load(self) -> FloatArray:
        """Torques or forces `(..., k)` that hold the arm up against gravity."""
        still = np.zeros(self.shape)
        return self.loads(still, still)[0]

    def inertia_diagonal(self) -> FloatArray:
        """Diagonal `(..., k)` of the joint-space mass matrix."""
        out = np.zeros((len(self.values), self.shape[-1]))
        rigid_inertias(0, len(out), self.tables, self.payload, self.values, out)
        return out.reshape(self.shape)


def posture_at(body: Body, q: FloatArray) -> Posture | None:
    """Return a body at joint values; None when nothing weighs anything and no joint has a spring.

    Parameters
    ----------
    body : Body
    q : (..., N, k) array, values of the moving joints in N runs, rad or m
    """
    links = body.links
    if body.chain is None or not (links.mass.any() or links.payload.any() or body.springs is not None):
        return None
    # Copies: machine code is made again for arrays that may not be written to.
    payload = np.array(np.broadcast_to(links.payload, q.shape[:-1]).reshape(-1))
    values = body.all_joints(q).reshape(-1, body.chain.dof)
    moving = q.reshape(-1, q.shape[-1])
    springs = None if body.springs is None else body.springs[0] * (moving - body.springs[1])
    return Posture(_tables(body), payload, values, q.shape, springs)


@lru_cache(maxsize=8)
def _tables(body: Body) -> Tables:
    """Return the arm as arrays; an arm that runs live asks for the same body's again and again."""
    assert body.chain is not None
    chain, links = body.chain, body.links
    dof, k = chain.dof, len(links.mass)
    mass, com, moments = np.zeros(dof), np.zeros((dof, 3)), np.zeros((dof, 6))
    mass[:k], com[:k], moments[:k, :3] = links.mass, links.com, links.inertia_diagonal
    if links.inertia_products is not None:
        moments[:k, 3:] = links.inertia_products
    column = np.full(dof, -1, dtype=np.int64)
    column[body.columns] = np.arange(len(body.joints))
    return Tables(
        dh=np.array([(np.cos(j.alpha), np.sin(j.alpha), j.a, j.d, j.theta) for j in chain.joints]),
        placements=chain.placements,
        prismatic=~chain.revolute,
        modified=chain.convention == "modified",
        column=column,
        base=np.array(chain.base),
        tool=np.array(chain.tool),
        mass=mass,
        com=com,
        moments=moments,
        gravity=np.array(body.gravity, dtype=np.float64),
    )


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
    """Return the load of a body along a path; bare joints and weightless arms have none.

    Parameters
    ----------
    body : Body
    path : JointPath
    """
    posture = posture_at(body, path.q)
    if posture is None:
        return LinkLoad(np.zeros(path.q.shape), np.zeros(path.q.shape))
    return LinkLoad(*posture.loads(path.velocity, path.acceleration))


def mean_inertia(body: Body, q: FloatArray) -> FloatArray:
    """Return the mean inertia `(k,)` of the links at each joint, which the servo loop moves; the rest is load.

    Parameters
    ----------
    body : Body
    q : (n, N, k) array, path, rad or m
    """
    posture = posture_at(body, q[::INERTIA_STRIDE])
    if posture is None:
        return np.zeros(q.shape[-1])
    mean: FloatArray = posture.inertia_diagonal().mean(axis=(0, 1))
    return mean
