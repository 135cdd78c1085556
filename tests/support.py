"""What several tests share: where the real recordings are, and a small recording with a known miss."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.types import CalibrationLog, PoseSignal

ROOT = Path(__file__).resolve().parent.parent


def data_folder() -> Path:
    """Return the folder of real recordings: $GPCORRECT_DATA, or `shared/data` beside the checkout."""
    return Path(os.environ.get("GPCORRECT_DATA", ROOT.parent / "shared" / "data"))


def real_data(name: str) -> Path:
    """Return the path of a real recording, or skip the test where the recordings are not at hand."""
    path = data_folder() / name
    if not path.exists():
        pytest.skip(f"real recording {name} is not at hand: set GPCORRECT_DATA to the folder that holds it")
    return path


def small_log(seed: int = 0, trajectories: int = 16, samples: int = 60, *, noise: float = 1e-4) -> CalibrationLog:
    """Return a small recording with a known miss: shifted, turned, bent smoothly, and dragged by velocity."""
    rng = np.random.default_rng(seed)
    time, number, position, rotvec = [], [], [], []
    for k in range(trajectories):
        t = np.arange(samples) * 0.02
        phase, rate = rng.uniform(0, 2 * np.pi, (6, 1)), np.array([[2.0], [1.5], [2.5], [1.0], [2.2], [1.8]])
        swing = np.sin(rate * t + phase).T
        time.append(t + 10.0 * k)
        number.append(np.full(samples, k))
        position.append(0.03 * swing[:, :3] + np.array([0.1, 0.0, -0.1]))
        rotvec.append(0.4 * swing[:, 3:])
    p, r = np.concatenate(position), np.concatenate(rotvec)
    velocity = np.concatenate([np.gradient(p[k == np.concatenate(number)], 0.02, axis=0) for k in range(trajectories)])
    seen = p + 0.004 * np.sin(20 * p[:, [1, 2, 0]]) - 0.01 * velocity + np.array([0.01, -0.005, 0.002])
    R = se3.matrix_from_rotvec(0.05 * np.sin(10 * p)) @ se3.matrix_from_rotvec(r)
    return CalibrationLog(
        time=np.concatenate(time),
        trajectory=np.concatenate(number),
        session=np.zeros(len(p)),
        setpoint_cp=PoseSignal(p, se3.quaternion_from_matrix(se3.matrix_from_rotvec(r))),
        tracker_cp=PoseSignal(seen + noise * rng.standard_normal(p.shape), se3.quaternion_from_matrix(R)),
        name="small",
    )
