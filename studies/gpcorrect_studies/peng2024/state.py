"""Everything that a RAVEN-II says of itself at each moment, made of the few numbers that a simulation records.

The state message repeats what the joints and efforts say in other words: motor positions, encoder counts, amplifier
counts, reported poses, speeds, of the desired and the reported motion, and all of it once more for the arm that rests.
Counters and clocks are left out: they tell the time, which no calibration may learn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpcorrect.arms import Arm, arm_named
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["whole_state"]

COUNTS_PER_RAD = 4000.0 / (2.0 * np.pi)
AMPLIFIER_COUNTS = 1000.0  # a N m at the motor
MICROMETRE = 1e-6
RESTING_JITTER = 1e-5  # of a resting arm's readings: an encoder's last digit now and then
ARM = "raven2_left"


def whole_state(log: CalibrationLog, seed: int = 0) -> CalibrationLog:
    """Return the log with the other columns of the state message among its extra columns.

    Parameters
    ----------
    log : CalibrationLog
        With `measured_jp`, `setpoint_jp` and `measured_jf` of the first three joints.
    seed : int
        Of the resting arm's jitter.
    """
    assert log.measured_jp is not None
    assert log.setpoint_jp is not None
    assert log.measured_jf is not None
    arm = arm_named(ARM)
    q, desired, effort = (_six(signal) for signal in (log.measured_jp, log.setpoint_jp, log.measured_jf))
    moving = np.hstack(
        [_reported(arm, q), _reported(arm, desired), _motors(arm, q, desired, effort), _speeds(log, arm)]
    )
    jitter = np.random.default_rng(seed).standard_normal(moving.shape)
    columns = np.hstack([moving, RESTING_JITTER * jitter])
    named = {f"state_{i}": column for i, column in enumerate(columns.T)}
    return replace(log, extra={**log.extra, **named})


def _six(signal: FloatArray) -> FloatArray:
    """Joints or efforts of all six, the tool at rest."""
    return np.hstack([signal, np.zeros((len(signal), 3))])


def _reported(arm: Arm, q: FloatArray) -> FloatArray:
    """Pose of the tip as the message gives it: whole micrometres, and the rotation matrix."""
    T = arm.forward(q)
    return np.hstack([np.round(T[:, :3, 3] / MICROMETRE), T[:, :3, :3].reshape(len(q), 9)])


def _motors(arm: Arm, q: FloatArray, desired: FloatArray, effort: FloatArray) -> FloatArray:
    assert arm.transmission is not None
    motors, wanted = (arm.transmission.motor_from_joint(joints) for joints in (q, desired))
    amplifier = np.round(arm.transmission.motor_torque(effort) * AMPLIFIER_COUNTS)
    return np.hstack([motors, wanted, np.round(motors * COUNTS_PER_RAD), amplifier])


def _speeds(log: CalibrationLog, arm: Arm) -> FloatArray:
    """Speeds of the motors, and the tip's twist by the Jacobian."""
    assert log.measured_jp is not None
    assert arm.transmission is not None
    step = np.gradient(log.time)
    velocity = _six(np.gradient(log.measured_jp, axis=0) / step[:, None])
    twist = np.einsum("nij,nj->ni", arm.jacobian(_six(log.measured_jp)), velocity)
    return np.hstack([arm.transmission.motor_from_joint(velocity), twist])
