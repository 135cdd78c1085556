"""Velocities that poses are learned from: each stencil is as wide as the noise of what it differentiates demands."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.calibration.poses import NOISE_FRACTION, observed_twists, stencil_steps
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

N, RATE = 1000, 100.0
VELOCITY, SPIN = np.array([0.1, -0.05, 0.08]), np.array([0.3, -0.2, 0.4])
NOISE, TURN_NOISE = 1e-4, 1e-3  # m and rad: 7 and 18 % of these speeds in differences of neighbours


def straight_log(noise: float, turn_noise: float) -> CalibrationLog:
    """Return a screw motion of constant speed, which has no third differences of its own, seen with white noise."""
    rng, time = np.random.default_rng(5), np.arange(N) / RATE
    position = time[:, None] * VELOCITY
    rotation = se3.matrix_from_rotvec(time[:, None] * SPIN)
    command = PoseSignal(position, se3.quaternion_from_matrix(rotation))
    turned = se3.matrix_from_rotvec(turn_noise * rng.normal(size=(N, 3))) @ rotation
    seen = PoseSignal(position + noise * rng.normal(size=(N, 3)), se3.quaternion_from_matrix(turned))
    zeros = np.zeros(N, dtype=np.int64)
    return CalibrationLog(time, zeros, zeros, setpoint_cp=command, tracker_cp=seen)


def velocity_noise(log: CalibrationLog) -> FloatArray:
    """Return the deviations (2,) of linear and angular velocities over what the law allows them."""
    twist = observed_twists(log, log.tracker_cp, np.ones(N, dtype=bool), stencil_steps(log))[30:-30]
    off = (twist - np.concatenate([VELOCITY, SPIN])).reshape(-1, 2, 3).std(axis=0)
    speeds = np.array([np.linalg.norm(VELOCITY), np.linalg.norm(SPIN)])
    return np.asarray(np.sqrt((off**2).mean(axis=1)) / (NOISE_FRACTION * speeds))


@pytest.mark.parametrize(("noise", "turn_noise"), [(NOISE, 0.0), (0.0, TURN_NOISE), (NOISE, TURN_NOISE)])
def test_noise_widens_the_stencil_of_its_own_velocity_alone(noise: float, turn_noise: float) -> None:
    """Noisy orientations blur no linear velocity, and noisy positions no angular one."""
    steps = stencil_steps(straight_log(noise, turn_noise))
    assert [step > 0.0 for step in steps] == [noise > 0.0, turn_noise > 0.0]


def test_velocities_are_as_quiet_as_the_law_says() -> None:
    """What noise is left of positions and turns is below the fraction of the speed, and not far below it."""
    ratio = velocity_noise(straight_log(NOISE, TURN_NOISE))
    assert (ratio < 1.1).all()
    assert (ratio > 0.5).all()
