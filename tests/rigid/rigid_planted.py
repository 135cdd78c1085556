"""Planted registrations: a tool moves, a tracker sees a marker on it, and the truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.rigid import RigidModel
from gpcorrect.types import FloatArray, PoseSignal


@dataclass(frozen=True)
class Planted:
    """Observed and commanded poses of n samples, and the model that maps the first onto the second."""

    observed: PoseSignal
    command: PoseSignal
    truth: RigidModel


def signal(position: FloatArray, rotation: Rotation) -> PoseSignal:
    """Pose signal of positions (n, 3) and n rotations."""
    return PoseSignal(position, rotation.as_quat(scalar_first=True))


def rotations(poses: PoseSignal) -> Rotation:
    """Rotations of a pose signal."""
    return Rotation.from_quat(poses.quaternion, scalar_first=True)


def random_model(kind: str, rng: np.random.Generator) -> RigidModel:
    """Random model of the kind, frames metres apart."""
    if kind == "identity":
        return RigidModel()
    R, R_left, R_right = Rotation.random(3, random_state=rng).as_matrix()
    t = rng.normal(size=3)
    if kind == "marker":
        return RigidModel("marker", R, t, rng.normal(size=3) * 0.1, R, R_right)
    if kind == "separate":
        return RigidModel("separate", R, t, R_left=R_left, R_right=R_right)
    return RigidModel(kind, R, t, R_left=R)


def motion(n: int, rng: np.random.Generator, swing_rad: float = 0.6, axes: int = 3) -> PoseSignal:
    """Independent poses in a workspace of centimetres; rotations about one, two or three axes."""
    position = rng.normal(size=3) + rng.normal(size=(n, 3)) * [0.03, 0.03, 0.01]
    rotvec = rng.normal(size=(n, 3)) * swing_rad * (np.arange(3) < axes)
    return signal(position, Rotation.from_rotvec(rotvec))


def planted(kind: str, n: int, rng: np.random.Generator, swing_rad: float = 0.6, axes: int = 3) -> Planted:
    """Exact pairs of a random model."""
    truth = random_model(kind, rng)
    observed = motion(n, rng, swing_rad, axes)
    return Planted(observed, truth.apply(observed), truth)


def noisy(poses: PoseSignal, rng: np.random.Generator, noise_m: float, noise_rad: float) -> PoseSignal:
    """Poses with white noise on position and orientation."""
    turn = Rotation.from_rotvec(rng.normal(size=(len(poses), 3)) * noise_rad)
    return signal(poses.position + rng.normal(size=(len(poses), 3)) * noise_m, turn * rotations(poses))


def with_outliers(poses: PoseSignal, rows: FloatArray, rng: np.random.Generator) -> PoseSignal:
    """Poses of which some rows are decimetres away and turned at random."""
    position, quaternion = np.array(poses.position), np.array(poses.quaternion)
    position[rows] += rng.normal(size=(len(rows), 3)) * 0.2
    quaternion[rows] = Rotation.random(len(rows), random_state=rng).as_quat(scalar_first=True)
    return PoseSignal(position, quaternion)


def moved(poses: PoseSignal, T: FloatArray) -> PoseSignal:
    """Return the same poses seen from another frame: `T X`."""
    return PoseSignal(*se3.to_parts(T @ se3.from_parts(poses.position, poses.quaternion)))


def differences(model: RigidModel, truth: RigidModel) -> dict[str, float]:
    """How far a model is from the truth: largest angle of its rotations (rad), t and offset (m)."""
    turns = [getattr(model, n) @ getattr(truth, n).T for n in ("R_position", "R_left", "R_right")]
    return {
        "angle": float(se3.angle(np.array(turns)).max()),
        "t": float(np.linalg.norm(model.t - truth.t)),
        "offset": float(np.linalg.norm(model.offset - truth.offset)),
    }
