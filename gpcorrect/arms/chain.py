"""Serial chains described by Denavit-Hartenberg rows or fixed motions: forward map, Jacobian, numerical inverse."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.arms.compiled import descend, walk
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, frozen_array

Convention = Literal["standard", "modified"]

LENGTH = 0.1  # m that weigh as much as one radian: the reach of a surgical tool beyond its pivot
REACHED = 1e-9  # error (rad, or m / LENGTH) below which a pose counts as reached
LIMIT_ROUNDING = 1e-9  # rad or m beyond a limit that count as on it: far above rounding, far below a micrometre
STARTS = 16  # measured on random poses of the known arms: all of 900 are reached


@dataclass(frozen=True, eq=False)
class Joint:
    """One row of a Denavit-Hartenberg table, or a joint placed anywhere by a fixed motion before its row.

    Parameters
    ----------
    kind : "R" or "P", revolute (the joint value adds to `theta`) or prismatic (it adds to `d`)
    alpha, a, d, theta : float
        Table entries, rad and m; in the modified convention `alpha` and `a` are those of the link before.
    lower, upper : float, limits of the joint value, rad or m
    placement : (4, 4) array or None
        Fixed motion before the row, as robot files give it: its z axis is the joint's. None in plain tables.

    Raises
    ------
    DataError
        The kind is unknown, the limits are not finite and ordered, or the placement is no (4, 4).
    """

    kind: Literal["R", "P"]
    alpha: float
    a: float
    d: float
    theta: float
    lower: float
    upper: float
    placement: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("R", "P"):
            raise DataError(f"a joint is 'R' (revolute) or 'P' (prismatic), got {self.kind!r}.")
        if not -np.inf < self.lower < self.upper < np.inf:
            raise DataError(f"joint limits must be finite and ordered, got {self.lower} and {self.upper}.")
        if self.placement is not None:
            object.__setattr__(self, "placement", frozen_array(self.placement))
            if np.shape(self.placement) != (4, 4):
                raise DataError(f"a placement must be a pose (4, 4), got {np.shape(self.placement)}.")


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain: T_base_tip(q) = base A_1(q_1) ... A_n(q_n) tool.

    Parameters
    ----------
    joints : tuple of Joint, the table, base to tip
    convention : "standard" or "modified"
        Link transform Rz(theta) Tz(d) Tx(a) Rx(alpha), or Craig's Rx(alpha) Tx(a) Rz(theta) Tz(d).
    base : (4, 4) array, first table frame in the base frame
    tool : (4, 4) array, tip in the last link frame

    Raises
    ------
    DataError
        There is no joint, the convention is unknown, a transform is not (4, 4), or a placed joint is in a standard
        table.
    """

    joints: tuple[Joint, ...]
    convention: Convention
    base: FloatArray = field(default_factory=lambda: np.eye(4))
    tool: FloatArray = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        if not self.joints:
            raise DataError("a chain needs at least one joint.")
        if self.convention not in ("standard", "modified"):
            raise DataError(f"the convention is 'standard' or 'modified', got {self.convention!r}.")
        if self.convention == "standard" and any(joint.placement is not None for joint in self.joints):
            raise DataError("placed joints need the modified convention, in which a joint moves about its own z axis.")
        for name in ("base", "tool"):
            value = frozen_array(getattr(self, name))
            if value.shape != (4, 4):
                raise DataError(f"{name} must be a pose (4, 4), got {value.shape}.")
            object.__setattr__(self, name, value)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def joint_types(self) -> str:
        """Joint kinds in one word, as "RRPRRR"."""
        return "".join(joint.kind for joint in self.joints)

    @property
    def revolute(self) -> BoolArray:
        """(dof,) mask of revolute joints."""
        return np.array([joint.kind == "R" for joint in self.joints])

    @property
    def limits(self) -> FloatArray:
        """(dof, 2) lower and upper limits, rad or m."""
        return np.array([(joint.lower, joint.upper) for joint in self.joints])

    def within_limits(self, q: ArrayLike, margin: float = 0.0) -> BoolArray:
        """Return the mask (...) of postures whose joints all keep their limits.

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        margin : float, added to both limits, rad or m
        """
        values, limits = self.joint_values(q), self.limits
        inside = (values >= limits[:, 0] - margin) & (values <= limits[:, 1] + margin)
        return np.asarray(inside.all(axis=-1))

    def joint_values(self, q: ArrayLike) -> FloatArray:
        """Return `q` as a float array (..., dof).

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        values = np.asarray(q, dtype=np.float64)
        if values.ndim == 0 or values.shape[-1] != self.dof:
            raise DataError(f"joint values must have shape (..., {self.dof}), got {values.shape}.")
        return values

    def frames(self, q: ArrayLike) -> FloatArray:
        """Return the link frames (..., dof, 4, 4) in the base frame.

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        return self._walked(q, self.dof)

    def forward(self, q: ArrayLike) -> FloatArray:
        """Return the tip poses T_base_tip (..., 4, 4).

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        return se3.compose(self._walked(q, 1)[..., 0, :, :], self.tool)

    def _walked(self, q: ArrayLike, last: int) -> FloatArray:
        """Frames (..., last, 4, 4) of the last links."""
        values = self.joint_values(q)
        frames = np.empty((values.size // self.dof, last, 4, 4))
        modified = self.convention == "modified"
        rows = np.require(values.reshape(-1, self.dof), requirements=["C", "W"])  # of one kind: compiled once
        walk(self._table, self.placements, self.revolute, modified, self.base, rows, frames)
        return frames.reshape(*values.shape[:-1], last, 4, 4)

    @cached_property
    def placements(self) -> FloatArray:
        """Fixed motions `(dof, 4, 4)` before the rows; `(0, 4, 4)` where there are none."""
        if all(joint.placement is None for joint in self.joints):
            return np.empty((0, 4, 4))
        return np.array([np.eye(4) if j.placement is None else j.placement for j in self.joints])

    @cached_property
    def _table(self) -> FloatArray:
        """alpha, a, d, theta `(dof, 4)` of each joint."""
        return np.array([(j.alpha, j.a, j.d, j.theta) for j in self.joints])

    def axes(self, q: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the joint axes: unit directions and a point on each, both (..., dof, 3), in the base frame.

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        carriers = self.frames(q)
        if self.convention == "standard":  # joint i turns about the z axis of the frame before it
            first = np.broadcast_to(self.base, (*carriers.shape[:-3], 1, 4, 4))
            carriers = np.concatenate([first, carriers[..., :-1, :, :]], axis=-3)
        return carriers[..., :3, 2], carriers[..., :3, 3]

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """Return the geometric Jacobian (..., 6, dof): tip's linear velocity, then angular, both in base axes.

        Parameters
        ----------
        q : (..., dof) array, joint values, rad and m
        """
        tip = self.forward(q)[..., None, :3, 3]
        directions, origins = self.axes(q)
        turning = self.revolute[:, None]
        linear = np.where(turning, np.cross(directions, tip - origins), directions)
        angular = np.where(turning, directions, 0.0)
        return np.swapaxes(np.concatenate([linear, angular], axis=-1), -1, -2)

    def inverse(self, T: ArrayLike, seed: ArrayLike | None = None) -> FloatArray:
        """Joint values (dof,) within limits that reach the tip pose `T` (4, 4), by Newton's method from many starts.

        Parameters
        ----------
        T : (4, 4) array, tip pose in the base frame
        seed : (dof,) or (k, dof) array, optional
            Where to start; the answer is the nearest solution in practice. Starts spread evenly over the limits
            follow when none arrives.

        Raises
        ------
        DataError
            `T` is not a pose, a seed has another shape, or no start reaches the pose; the message says how near the
            best came.
        """
        pose, limits = np.asarray(T, dtype=np.float64), self.limits
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise DataError(f"the pose to reach must be a finite (4, 4) array, got shape {pose.shape}.")
        best, nearest = np.inf, np.zeros(6)
        for start in self._starts(seed):
            q, _ = self.nearest(np.repeat(pose[None], len(start), axis=0), start, LENGTH)
            beyond = self.revolute & ~((q >= limits[:, 0] - LIMIT_ROUNDING) & (q <= limits[:, 1] + LIMIT_ROUNDING))
            q = np.where(beyond, q + 2 * np.pi * np.round((limits.mean(axis=1) - q) / (2 * np.pi)), q)
            q = np.clip(np.where(np.isnan(q), start, q), limits[:, 0], limits[:, 1])
            tips = self.forward(q)
            turned = se3.rotvec_from_matrix(tips[:, :3, :3] @ pose[:3, :3].T)
            error = np.hstack([(tips[:, :3, 3] - pose[:3, 3]) / LENGTH, turned])
            size = np.linalg.norm(error, axis=1)
            if size.min() < REACHED:
                return np.asarray(q[np.argmax(size < REACHED)])
            if size.min() < best:
                best, nearest = float(size.min()), error[np.argmin(size)]
        raise DataError(
            f"no joint values within the limits reach the pose; the nearest misses it by "
            f"{np.linalg.norm(nearest[:3]) * LENGTH:.3g} m and {np.linalg.norm(nearest[3:]):.3g} rad.",
            hint="Check units and frame of the pose, or widen the joint limits.",
        )

    def _starts(self, seed: ArrayLike | None) -> Iterator[FloatArray]:
        """Yield the caller's seeds, then points that cover the limits evenly (a Halton sequence, not random)."""
        limits = self.limits
        if seed is not None:
            seeds = np.atleast_2d(np.asarray(seed, dtype=np.float64))
            if seeds.shape[-1] != self.dof or seeds.ndim != 2:
                raise DataError(f"a seed must have shape ({self.dof},) or (k, {self.dof}), got {np.shape(seed)}.")
            yield np.clip(seeds, limits[:, 0], limits[:, 1])
        from scipy.stats import qmc  # takes longer to import than a model to load, and few arms come here

        spread = qmc.Halton(self.dof, scramble=False).random(STARTS + 1)[1:]  # the first point is a corner
        yield limits[:, 0] + np.ptp(limits, axis=1) * spread

    def nearest(self, T: ArrayLike, start: ArrayLike, length: float) -> tuple[FloatArray, FloatArray]:
        """Return the joint values `(n, dof)` that come nearest to tip poses, by Newton's method from a start each.

        Limits of the joints are not looked at: a start on the right branch keeps to it.

        Parameters
        ----------
        T : (n, 4, 4) array, tip poses in the base frame
        start : (n, dof) array, joint values, rad and m
        length : float, m that weigh as much as one radian

        Returns
        -------
        q : (n, dof) array
            rad and m; NaN where the iteration did not come to rest.
        left : (n,) array
            Error that is left, rad (and m over `length`).
        """
        poses, q = (np.array(given, dtype=np.float64, order="C") for given in (T, start))
        left = np.empty(len(q))
        modified = self.convention == "modified"
        walked = (self._table, self.placements, self.revolute, modified, np.array(self.base), np.array(self.tool))
        descend(*walked, poses, q, float(length), left)
        return q, left
