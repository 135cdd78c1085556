"""Simulated residuals of a cable-driven arm: smooth fields of pose, friction that flips with velocity, and noise.

The benchmarks share it, so that every model meets the same data. Lengths in m, angles in rad, residuals as position (m)
then rotation vector (rad).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.types import FloatArray, IntArray

WORKSPACE = np.array([0.08, 0.08, 0.02])  # m: Mahler et al. 2014, Sec. V
LENGTH_SCALES = np.array([0.03, 0.10])  # range over position, m; over orientation 10 rad/m times as large
NOISE = 2e-4  # standard deviation of what is measured, m; of rotations 10 rad/m times as large
WAVES = 400  # of a random field


@dataclass(frozen=True)
class Reaches:
    """Poses, twists and residuals of many reaches, a row a sample."""

    positions: FloatArray
    rotations: FloatArray
    twists: FloatArray
    residuals: FloatArray
    trajectory: IntArray


def simulate_reaches(
    n_reaches: int,
    n_samples: int,
    rng: np.random.Generator,
    *,
    noise_correlation: float = 0.0,
) -> Reaches:
    """Return straight reaches in an 8 x 8 x 2 cm box with a planted residual field.

    Parameters
    ----------
    n_reaches, n_samples : int, number of reaches and samples in each
    rng : numpy.random.Generator, source of the paths, the field and the noise
    noise_correlation : float, correlation of the noise of neighbouring samples, 0 (white) to 1
    """
    positions, rotvecs, twists = _paths(n_reaches, n_samples, rng)
    field = _planted_field(positions, rotvecs, twists, rng)
    trajectory = np.repeat(np.arange(n_reaches), n_samples)
    errors = _correlated_noise(n_reaches, n_samples, noise_correlation, rng) * NOISE * np.repeat([1.0, 10.0], 3)
    rotations = se3.matrix_from_rotvec(rotvecs)
    return Reaches(positions, rotations, twists, field + errors, trajectory)


def _paths(n_reaches: int, n_samples: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Minimum-jerk reaches with about 5 cm/s mean speed; orientations turn by up to 20 degrees about each axis."""
    phase = np.linspace(0.02, 0.98, n_samples)
    progress = (10 * phase**3 - 15 * phase**4 + 6 * phase**5)[None, :, None]
    rate = (30 * phase**2 - 60 * phase**3 + 30 * phase**4)[None, :, None]
    start = np.concatenate(
        [rng.uniform(-0.5, 0.5, (n_reaches, 1, 3)) * WORKSPACE, rng.uniform(-0.35, 0.35, (n_reaches, 1, 3))], 2
    )
    stop = np.concatenate(
        [rng.uniform(-0.5, 0.5, (n_reaches, 1, 3)) * WORKSPACE, rng.uniform(-0.35, 0.35, (n_reaches, 1, 3))], 2
    )
    duration = (
        np.linalg.norm((stop - start)[..., :3], axis=2, keepdims=True) / 0.05 * rng.uniform(0.7, 1.4, (n_reaches, 1, 1))
    )
    path = (start + progress * (stop - start)).reshape(-1, 6)
    speed = (rate * (stop - start) / np.maximum(duration, 0.2)).reshape(-1, 6)
    return path[:, :3], path[:, 3:], speed


def _planted_field(
    positions: FloatArray, rotvecs: FloatArray, twists: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Pose field + friction tanh(v / v0) of locally varying strength + a mild field over pose and velocity together."""
    pose = np.hstack([positions, rotvecs / 10.0])  # rad to the metres that matter as much
    pose_field = _random_field(pose, LENGTH_SCALES, rng) * 1.5e-3
    strength = 1.0 + 0.5 * _random_field(pose, LENGTH_SCALES, rng)
    direction = np.tanh(twists / np.repeat([0.02, 0.2], 3))
    friction = 7e-4 * strength * (direction @ (np.eye(6) + 0.3 * rng.standard_normal((6, 6))))
    joint = np.hstack([pose, twists * np.repeat([1.0, 0.1], 3)])
    mixed = 4e-4 * _random_field(joint, 2 * LENGTH_SCALES, rng)
    return (pose_field + friction + mixed) * np.repeat([1.0, 10.0], 3)


def _random_field(inputs: FloatArray, length_scales: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Six unit-variance random fields with an RBF spectrum, each of its own length scales (random Fourier features)."""
    outputs = []
    for _ in range(6):
        scales = np.exp(rng.uniform(*np.log(length_scales), inputs.shape[1]))
        waves = rng.standard_normal((inputs.shape[1], WAVES)) / scales[:, None]
        phases = rng.uniform(0, 2 * np.pi, WAVES)
        outputs.append(np.cos(inputs @ waves + phases) @ rng.standard_normal(WAVES) * np.sqrt(2.0 / WAVES))
    return np.stack(outputs, axis=1)


def _correlated_noise(n_reaches: int, n_samples: int, correlation: float, rng: np.random.Generator) -> FloatArray:
    """AR(1) noise of unit variance, independent between reaches."""
    white = rng.standard_normal((n_reaches, n_samples, 6))
    noise = white.copy()
    for i in range(1, n_samples):
        noise[:, i] = correlation * noise[:, i - 1] + np.sqrt(1 - correlation**2) * white[:, i]
    return noise.reshape(-1, 6)
