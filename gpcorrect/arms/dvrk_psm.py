"""The patient-side manipulator (PSM) of the classic da Vinci Research Kit.

Lengths and table are those of the public calibration code BerkeleyAutomation/dvrkCalibration
(motion/dvrkKinematics.py); the limits are the classic arm's. The tip is that code's: 10.2 mm beyond the yaw
axis. No link masses are published there and the arm is counterbalanced, so only a payload weighs.
"""

from __future__ import annotations

import numpy as np

from gpcorrect.arms.arm import Arm
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.gravity import STANDARD_GRAVITY
from gpcorrect.types import FloatArray

__all__ = ["dvrk_psm"]

L_RCC = 0.4318  # m, remote centre to carriage
L_TOOL = 0.4162  # m, tool shaft
L_PITCH_YAW = 0.0091  # m
L_YAW_TIP = 0.0102  # m
HALF_TURN = np.pi / 2
GRAVITY_BASE = (0.0, 0.0, -STANDARD_GRAVITY)  # z of the base frame points up


def dvrk_psm() -> Arm:
    """Classic dVRK PSM: joints outer yaw, outer pitch, insertion, roll, wrist pitch, wrist yaw."""
    return Arm(
        name="dvrk_psm",
        chain=Chain(_joints(), "standard", base=_about_x(HALF_TURN), tool=_about_z(HALF_TURN) @ _about_x(-HALF_TURN)),
        wrist_link=3,
        home=np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]),
        gravity=np.array(GRAVITY_BASE),
    )


def _joints() -> tuple[Joint, ...]:
    swing, tilt, roll, wrist = np.deg2rad([90.0, 60.0, 260.0, 80.0])
    return (
        Joint("R", -HALF_TURN, 0.0, 0.0, HALF_TURN, -swing, swing),
        Joint("R", -HALF_TURN, 0.0, 0.0, HALF_TURN, -tilt, tilt),
        Joint("P", 0.0, 0.0, L_TOOL - L_RCC, 0.0, 0.0, 0.24),
        Joint("R", HALF_TURN, 0.0, 0.0, 0.0, -roll, roll),
        Joint("R", -HALF_TURN, L_PITCH_YAW, 0.0, HALF_TURN, -wrist, wrist),
        Joint("R", 0.0, L_YAW_TIP, 0.0, 0.0, -wrist, wrist),
    )


def _about_x(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]], dtype=np.float64)


def _about_z(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64)
