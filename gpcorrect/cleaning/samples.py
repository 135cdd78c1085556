"""What the rules look at: complete samples, mapped into the base frame, with their error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gpcorrect import se3
from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal

__all__ = [
    "Register",
    "RigidMap",
    "Samples",
    "fresh_samples",
    "part_norms",
    "pose_error",
    "rotation_angles",
    "small_sample_factor",
]

RIGID_FREEDOMS = 6


class RigidMap(Protocol):
    """A rigid registration that has been learned: maps observed poses into the command's frame."""

    def apply(self, observed: PoseSignal, /) -> PoseSignal:
        """Return the observed poses in the command's frame."""
        ...


class Register(Protocol):
    """Learns a rigid registration; raises DegenerateError for samples that do not determine it."""

    def __call__(self, observed: PoseSignal, command: PoseSignal, /) -> RigidMap:
        """Return the registration of observed to commanded poses."""
        ...


@dataclass(frozen=True, eq=False)
class Samples:
    """n complete samples of a recording in recorded order.

    Parameters
    ----------
    time : (n,) array
        Seconds.
    trajectory : (n,) int array
        Which motion.
    run : (n,) int array
        Which unbroken stretch of the recording, across trajectories where nothing lies between them.
    mapped, command : PoseSignal
        Observed poses through the rigid map, and commanded poses: base frame.
    error : (n, 3) or (n, 6) array
        Command minus mapped observation: m, then the rotation vector of `R_cmd R_map^T` in rad.
    """

    time: FloatArray
    trajectory: IntArray
    run: IntArray
    mapped: PoseSignal
    command: PoseSignal
    error: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: IntArray | BoolArray) -> Samples:
        return Samples(
            self.time[rows],
            self.trajectory[rows],
            self.run[rows],
            self.mapped[rows],
            self.command[rows],
            self.error[rows],
        )


def pose_error(mapped: PoseSignal, command: PoseSignal) -> FloatArray:
    """Command minus mapped pose, (n, 3) m, and where both have orientations (n, 6) with rotation vectors in rad."""
    position = command.position - mapped.position
    if mapped.quaternion is None or command.quaternion is None:
        return position
    R_map, R_cmd = (se3.matrix_from_quaternion(q) for q in (mapped.quaternion, command.quaternion))
    return np.hstack([position, se3.rotvec_from_matrix(R_cmd @ np.swapaxes(R_map, -1, -2))])


def part_norms(error: FloatArray) -> FloatArray:
    """Lengths (n, parts) of the position part and, where there is one, of the rotation part of (n, 3 parts)."""
    lengths: FloatArray = np.linalg.norm(error.reshape(len(error), error.shape[1] // 3, 3), axis=2)
    return lengths


def rotation_angles(first: FloatArray, second: FloatArray) -> FloatArray:
    """Angles (n,) in rad, 0 to pi, between the orientations of quaternions (n, 4) and (n, 4), accurate near zero."""
    q, r = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (first, second))
    aligned = np.where(np.einsum("nk,nk->n", q, r) < 0, -1.0, 1.0)[:, None] * r
    angles: FloatArray = 4 * np.arcsin(np.minimum(np.linalg.norm(aligned - q, axis=1) / 2, 1.0))
    return angles


def fresh_samples(samples: Samples) -> float:
    """How many of n samples say something new: neighbours in time repeat each other.

    A recording says something new each time the command has travelled the spread of its positions, or turned by the
    spread of its orientations.
    """
    if len(samples) == 0:
        return 0.0
    count = _traverses(samples.command.position, samples.run)
    if samples.command.quaternion is not None:
        entries = se3.matrix_from_quaternion(samples.command.quaternion).reshape(-1, 9)
        count += _traverses(entries, samples.run)
    return min(float(len(samples)), count)


def small_sample_factor(samples: Samples) -> float:
    """Factor `1 + 5/(n - p)` on robust scales (Rousseeuw & Leroy 1987): n fresh samples, p of a rigid motion."""
    return 1.0 + 5.0 / max(1.0, fresh_samples(samples) - RIGID_FREEDOMS)


def _traverses(coordinates: FloatArray, run: IntArray) -> float:
    """Length of a path (n, d), not counted across runs, over its spread; one more for each run."""
    spread = float(np.median(np.linalg.norm(coordinates - np.median(coordinates, axis=0), axis=1)))
    steps = np.linalg.norm(np.diff(coordinates, axis=0), axis=1)[run[1:] == run[:-1]]
    return len(np.unique(run)) + (float(steps.sum()) / spread if spread > 0 else 0.0)
