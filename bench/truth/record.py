"""From what was true to what was written down."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gpcorrect.types import CalibrationLog, LogMeta, PoseSignal
from truth.arm import forward
from truth.history import Readings
from truth.loop import CONTROL_HZ, TICK_HZ
from truth.machine import ENCODER_STEP
from truth.noise import noise_of
from truth.reference import LOG_HZ
from truth.setting import Setting

Array = NDArray[np.float64]

TRACKER_TURN = 8e-4  # rad, white on each axis
COARSE = 3.0  # of the noise's RMS: step of an outside sensor that rounds
JITTER = 0.25  # of a sample


def recorded(setting: Setting, readings: Readings, rng: np.random.Generator) -> CalibrationLog:
    reference, spec = setting.reference, setting.spec
    rows = reference.logged
    time, trajectory = reference.time[rows], reference.trajectory[rows]
    late = JITTER / LOG_HZ * rng.uniform(-1, 1, len(rows)) if spec.awkward == "jitter" else np.zeros(len(rows))

    def sampled(values: Array) -> Array:
        flat = values.reshape(len(values), -1)
        seen = flat[rows] if spec.awkward != "jitter" else _at_moments(flat, reference.time, time + late)
        return seen.reshape(len(rows), *values.shape[1:])

    wanted = sampled(reference.position[:: CONTROL_HZ // TICK_HZ])
    speed = np.abs(reference.speed[:: CONTROL_HZ // TICK_HZ][rows])
    speed = (speed / speed.max(axis=0)).max(axis=1)
    extra = readings.extra_noise[rows]
    common: dict[str, Any] = {
        "time": time + late,
        "trajectory": trajectory,
        "session": reference.session[rows],
        "payload": reference.payload[rows] if reference.payload.any() else None,
        "name": "recording",
    }
    if spec.signals == "tracker":
        noise = noise_of(setting.tracker_noise, rng, trajectory, speed, np.zeros((len(rows), 3)))
        tracker = tracked(setting.machine.T_tracker_base, sampled(readings.tip), noise, rng)
        return CalibrationLog(
            **common, setpoint_cp=_poses(forward(wanted)), tracker_cp=tracker,
            meta=LogMeta(robot="test arm", arm="raven2_left", tracker="camera"),
        )  # fmt: skip
    noise = noise_of(setting.joint_noise, rng, trajectory, speed, extra)
    outside = sampled(readings.outside) + noise
    if spec.awkward == "coarse":
        step = COARSE * setting.joint_noise.rms
        outside = np.round(outside / step) * step
    reported = np.round(sampled(readings.reported) / ENCODER_STEP) * ENCODER_STEP
    effort = None if spec.signals == "bare" else sampled(readings.effort)
    return CalibrationLog(
        **common, setpoint_jp=wanted, measured_jp=reported, measured_jf=effort, external_jp=outside,
        meta=LogMeta(robot="test arm", arm="joints" if spec.signals == "bare" else "raven2_left", joint_types="RRP"),
    )  # fmt: skip


def _at_moments(values: Array, time: Array, moments: Array) -> Array:
    """Values `(n, k)` at other moments, linear between the ticks."""
    return np.column_stack([np.interp(moments, time, v) for v in values.T])


def tracked(T_tracker_base: Array, T: Array, noise: Array, rng: np.random.Generator) -> PoseSignal:
    """Return what a tracker reads of tool poses `(n, 4, 4)`, noise `(n, 3)` on places, NaN where hidden."""
    seen = T_tracker_base @ T
    turn = Rotation.from_rotvec(TRACKER_TURN * rng.standard_normal((len(T), 3)))
    quaternion = (Rotation.from_matrix(seen[:, :3, :3]) * turn).as_quat()[:, [3, 0, 1, 2]]
    quaternion[np.isnan(noise[:, 0])] = np.nan
    return PoseSignal(seen[:, :3, 3] + noise, quaternion)


def _poses(T: Array) -> PoseSignal:
    return PoseSignal(T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]])
