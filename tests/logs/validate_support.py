"""A clean log of a left RAVEN-II with every signal, to plant one fault at a time into."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from sync_support import wandering

from gpcorrect import se3
from gpcorrect.arms import arm_named
from gpcorrect.logs.checks import Finding
from gpcorrect.logs.validate import ValidationReport, validate_log
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, PoseSignal

RATE = 50.0
SAMPLES = 400
TRAJECTORIES = 4
NOISE = np.array([3e-4, 3e-4, 5e-5, 3e-4, 3e-4, 3e-4])  # rad and m


@cache
def clean_log(seed: int = 0) -> CalibrationLog:
    """Return four trajectories of 8 s at 50 Hz, joints within limits, a tracker in its own frame."""
    rng = np.random.default_rng(seed)
    arm = arm_named("raven2_left")
    time = np.concatenate([10.0 * k + np.arange(SAMPLES) / RATE for k in range(TRAJECTORIES)])
    setpoint = _joint_path(rng, time, arm.limits)
    measured = setpoint + 1e-3 * np.sin(setpoint) + NOISE * rng.normal(size=setpoint.shape)
    external = 1.01 * setpoint - 0.002 + NOISE * rng.normal(size=setpoint.shape)
    T_tracker_base = se3.pose(se3.matrix_from_rotvec(np.array([0.3, 1.2, -0.7])), np.array([1.0, 0.4, 2.0]))
    seen = se3.compose(T_tracker_base, arm.forward(external))
    position, quaternion = se3.to_parts(seen)
    return CalibrationLog(
        time,
        np.repeat(np.arange(TRAJECTORIES), SAMPLES),
        np.zeros(len(time)),
        setpoint_cp=PoseSignal(*se3.to_parts(arm.forward(setpoint))),
        measured_cp=PoseSignal(*se3.to_parts(arm.forward(measured))),
        tracker_cp=PoseSignal(position + 1e-4 * rng.normal(size=position.shape), quaternion),
        setpoint_jp=setpoint,
        measured_jp=measured,
        external_jp=external,
        meta=LogMeta(robot="RAVEN-II", arm="left", joint_types="RRPRRR"),
        name="clean",
    )


def _joint_path(rng: np.random.Generator, time: FloatArray, limits: FloatArray) -> FloatArray:
    shape = np.hstack([wandering(rng)(time), wandering(rng)(time)])
    shape = shape / np.abs(shape).max(axis=0)
    middle, half = limits.mean(axis=1), np.ptp(limits, axis=1) / 2
    return middle + 0.4 * np.minimum(half, 1.0) * shape


def findings(log: CalibrationLog, code: str) -> list[Finding]:
    """Return the findings with this code."""
    return [f for f in validate_log(log).findings if f.code == code]


def codes(report: ValidationReport, *severities: str) -> set[str]:
    """Codes of the findings of these severities."""
    return {f.code for f in report.findings if f.severity in severities}


def pose(
    signal: PoseSignal,
    change_position: Callable[[FloatArray], FloatArray] = lambda p: p,
    change_quaternion: Callable[[FloatArray], FloatArray] = lambda q: q,
) -> PoseSignal:
    """Return a pose signal with copies of its parts put through functions."""
    assert signal.quaternion is not None
    return PoseSignal(change_position(signal.position.copy()), change_quaternion(signal.quaternion.copy()))


def scaled_joint(name: str, joint: int, factor: float) -> CalibrationLog:
    """Return the clean log with one joint of one signal multiplied."""
    table = getattr(clean_log(), name).copy()
    table[:, joint] *= factor
    return replace(clean_log(), **{name: table})
