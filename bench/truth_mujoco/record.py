"""From what was true to what was written down."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from truth.history import Readings
from truth.loop import CONTROL_HZ, TICK_HZ
from truth.noise import noise_of
from truth.record import tracked

from gpcorrect.types import CalibrationLog, LogMeta

if TYPE_CHECKING:
    from truth_mujoco.case import Setting

Array = NDArray[np.float64]


def recorded(setting: Setting, readings: Readings, rng: np.random.Generator) -> CalibrationLog:
    """Sample what was true at the log's rate, with the noise of joint sensors and tracker, encoder steps and holes.

    Where only a tracker looks on, the motors are written down beside it.
    """
    machine, reference = setting.machine, setting.reference
    arm, rows = machine.arm, reference.logged
    trajectory = reference.trajectory[rows]
    pace = np.abs(reference.speed[:: CONTROL_HZ // TICK_HZ][rows])
    pace = (pace / np.maximum(pace.max(axis=0), 1e-12)).max(axis=1)
    reported = np.round(readings.reported[rows] / arm.encoder_step) * arm.encoder_step
    signals: dict[str, Any] = {
        "setpoint_jp": reference.position[:: CONTROL_HZ // TICK_HZ][rows],
        "measured_jp": reported,
        "measured_jf": None if arm.bare else readings.effort[rows],
    }
    if setting.spec.signals != "tracker":
        noise = noise_of(setting.joint_noise, rng, trajectory, pace, readings.extra_noise[rows])
        signals["external_jp"] = readings.outside[rows] + noise
    if machine.tracked:
        noise = noise_of(setting.tracker_noise, rng, trajectory, pace, np.zeros((len(rows), 3)))
        signals["tracker_cp"] = tracked(machine.T_tracker_base, readings.tip[rows], noise, rng)
    return CalibrationLog(
        time=reference.time[rows],
        trajectory=trajectory,
        session=reference.session[rows],
        payload=reference.payload[rows] if reference.payload.any() else None,
        name="recording",
        meta=LogMeta(
            robot="test arm",
            arm=arm.declared,
            joint_types=arm.types,
            tracker="camera" if machine.tracked else "",
        ),
        **signals,
    )
