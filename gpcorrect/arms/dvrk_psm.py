"""The patient-side manipulator (PSM) of the classic da Vinci Research Kit.

Lengths and table are those of the public calibration code BerkeleyAutomation/dvrkCalibration
(motion/dvrkKinematics.py); the limits are the classic arm's. The tip is that code's: 10.2 mm beyond the yaw
axis. No link masses are published there and the arm is counterbalanced, so only a payload weighs.
"""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.arms.arm import STANDARD_GRAVITY
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.remote_centre import RemoteCentreArm

L_RCC = 0.4318  # m, remote centre to carriage
L_TOOL = 0.4162  # m, tool shaft
L_PITCH_YAW = 0.0091  # m
L_YAW_TIP = 0.0102  # m
QUARTER_TURN = np.pi / 2  # rad
GRAVITY_BASE = (0.0, 0.0, -STANDARD_GRAVITY)  # z of the base frame points up


def dvrk_psm() -> RemoteCentreArm:
    """Classic dVRK PSM: joints outer yaw, outer pitch, insertion, roll, wrist pitch, wrist yaw."""
    swing, tilt, roll, wrist = np.deg2rad([90.0, 60.0, 260.0, 80.0])
    joints = (
        Joint("R", -QUARTER_TURN, 0.0, 0.0, QUARTER_TURN, -swing, swing),
        Joint("R", -QUARTER_TURN, 0.0, 0.0, QUARTER_TURN, -tilt, tilt),
        Joint("P", 0.0, 0.0, L_TOOL - L_RCC, 0.0, 0.0, 0.24),
        Joint("R", QUARTER_TURN, 0.0, 0.0, 0.0, -roll, roll),
        Joint("R", -QUARTER_TURN, L_PITCH_YAW, 0.0, QUARTER_TURN, -wrist, wrist),
        Joint("R", 0.0, L_YAW_TIP, 0.0, 0.0, -wrist, wrist),
    )
    about_x, about_z = (
        se3.pose(se3.matrix_from_rotvec(QUARTER_TURN * axis), np.zeros(3)) for axis in np.eye(3)[[0, 2]]
    )
    return RemoteCentreArm(
        name="dvrk_psm",
        chain=Chain(joints, "standard", base=about_x, tool=about_z @ se3.invert(about_x)),
        wrist_link=3,
        home=np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]),
        gravity=np.array(GRAVITY_BASE),
    )
