"""A recording of joints with a known miss: offset, coupling, and the slack of cables that pull on each other."""

from __future__ import annotations

import numpy as np

from gpcorrect.calibration import random_sinusoids
from gpcorrect.calibration.coupled_play import CoupledPlay
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta

LIMITS = np.array([[0.3, 1.1], [0.9, 1.9], [0.30, 0.42]])
HALF = np.ptp(LIMITS, axis=1) / 2
PLAY = CoupledPlay(np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.1, 0.06, 0.03]))


def joint_log(
    seed: int = 0, trajectories: int = 10, seconds: float = 30.0, *, shift: float = 0.0, first: float = 1.0
) -> CalibrationLog:
    """Return a log whose truth is known up to a little noise.

    `shift` is added to joint 2's zero, rad; joint 1 moves over a share `first` of its range, around the middle.
    """
    rng = np.random.default_rng(seed)
    speed = np.array([0.3 * first, 0.3, 0.05])
    middle, share = LIMITS.mean(axis=1, keepdims=True), np.array([[first], [1.0], [1.0]])
    path = random_sinusoids(middle + share * (LIMITS - middle), speed, trajectories * seconds, 10.0, rng)
    q, n = path.q, len(path.time)
    truth, lag = reached(q), lag_of(q)
    truth[:, 1] += shift
    noise = rng.standard_normal(q.shape) * np.array([2e-4, 2e-4, 2e-5])
    return CalibrationLog(
        time=path.time,
        trajectory=np.minimum(np.arange(n) * trajectories // n, trajectories - 1),
        session=np.zeros(n),
        measured_jp=q,
        measured_jf=lag / HALF + 0.05 * rng.standard_normal(q.shape),
        external_jp=truth + noise,
        meta=LogMeta(joint_types="RRP"),
        name="joints",
    )


def lag_of(q: FloatArray) -> FloatArray:
    """Return by how much joints `(n, 3)` are behind a path of motors."""
    return PLAY.lags((q - LIMITS.mean(axis=1)) / HALF, np.arange(len(q)) == 0) * HALF


def reached(q: FloatArray) -> FloatArray:
    """Return where a path of motors `(n, 3)` takes the joints, without noise."""
    where: FloatArray = q - lag_of(q) + np.array([0.03, -0.14, 0.0117])
    where[:, :2] += 0.02 * q[:, [1, 0]]
    return where
