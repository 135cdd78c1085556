"""The arms that are known by name: RAVEN-II, left and right, and the classic dVRK PSM.

RAVEN-II: numbers are those of the public control software uw-biorobotics/raven2 (the file is named beside each) and of
the RAVEN-II calibration paper. The tip is frame 6 of the table, on the jaws' common axis: the pose that the robot
itself reports (`pos` and `ori` of its state message). The table ends there; a jaw's length comes in as the tool
transform.

dVRK: lengths and table are those of the public calibration code BerkeleyAutomation/dvrkCalibration
(motion/dvrkKinematics.py); the limits are the classic arm's. The tip is that code's: 10.2 mm beyond the yaw axis. No
link masses are published there and the arm is counterbalanced, so only a payload weighs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.arms.arm import STANDARD_GRAVITY, Link, Transmission
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.remote_centre import RemoteCentreArm
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

Side = Literal["left", "right"]

# Geometry (r2_kinematics.h, r2_kinematics.cpp)
ALPHA_12 = np.deg2rad(75.0)
ALPHA_23 = np.deg2rad(52.0)
SHAFT_OFFSET = -0.47  # m; at this insertion the wrist is in the remote centre
THETA_OFFSET_DEG = {"left": (205.0, 180.0, 90.0, 0.0, -90.0, 0.0), "right": (25.0, 0.0, -90.0, 0.0, -90.0, 0.0)}

# Soft limits and home (defines.h; tool joints: its 2023 settings), degrees and, for insertion, metres
LIMITS_DEG = ((0.0, 90.0), (45.0, 135.0), (0.23, 0.56), (-182.0, 182.0), (-75.0, 75.0), (-89.0, 89.0))
HOME_DEG = (30.0, 90.0, 0.4, 0.0, 0.0, 0.0)  # both jaws at 45 deg: their mean direction is 0
VELOCITY_LIMITS_DEG = (5.0, 5.0, 0.02, 15.0, 15.0, 15.0)  # public Python controller, a second

# Transmission (defines.h, utils.h); radii in mm
GEAR_BIG, GEAR_SMALL = 49 / 4, 26 / 7
CABLE_BIG, CABLE_SMALL = 1.19 / 2, 0.61 / 2
CAPSTAN_BIG, CAPSTAN_SMALL, CAPSTAN_TOOL = 11.35 / 2, 4.7 + CABLE_SMALL, 10.6 + CABLE_SMALL
PULLEY_LINK_1, PULLEY_LINK_2 = 62.5 + CABLE_BIG, 40.85 + CABLE_BIG
STEP_LARGE, STEP_SMALL = 7.82 + CABLE_BIG, 5.60 + CABLE_BIG  # stepped capstan of link 2
TR_SHOULDER = PULLEY_LINK_1 / CAPSTAN_BIG * GEAR_BIG  # about 136
TR_ELBOW = PULLEY_LINK_2 / STEP_SMALL * STEP_LARGE / CAPSTAN_BIG * GEAR_BIG  # about 121
TR_INSERTION = 1000.0 / CAPSTAN_BIG * GEAR_BIG  # rad/m, about 2159
TR_TOOL = CAPSTAN_TOOL / CAPSTAN_SMALL * GEAR_SMALL  # before each tool joint's own pulleys
TR_ROLL, TR_PITCH, TR_YAW = TR_TOOL * 120 / 180, TR_TOOL * 200 / 180, TR_TOOL * 100 / 90
COUPLING_12 = 0.14545  # elbow rad for each shoulder rad
COUPLING_13 = 0.0077973826  # insertion m for each shoulder rad
COUPLING_23 = 0.008077387  # insertion m for each elbow rad
INSERTION_PER_TOOL_MOTOR = GEAR_BIG / GEAR_SMALL * CAPSTAN_SMALL / CAPSTAN_BIG  # turns

# Gravity model (grav_comp.cpp): kg, and m in link frames; free fall is along -x of frame 0
MASSES = (0.494, 0.750, 0.231)
CENTRES = {
    "left": ((0.0065, 0.09775, -0.13771), (-0.002, -0.18274, -0.23053), (0.0, 0.0, 0.0)),
    "right": ((-0.0065, -0.09775, 0.13771), (-0.002, -0.18274, 0.23053), (0.0, 0.0, 0.0)),
}
L_RCC = 0.4318  # m, remote centre to carriage
L_TOOL = 0.4162  # m, tool shaft
L_PITCH_YAW = 0.0091  # m
L_YAW_TIP = 0.0102  # m
QUARTER_TURN = np.pi / 2  # rad


@dataclass(frozen=True)
class Raven2Tool:
    """What changes with the instrument (tools.cpp, fwd_cable_coupling.cpp).

    Parameters
    ----------
    wrist_length : float, pitch axis to yaw axis, m
    jaw_coupling : float, yaw rad added by each pitch rad
    insertion_sign : int, sense in which insertion drags the tool cables of the left arm; the right arm's is opposite
    opposed_jaws : bool
        Whether the first jaw's cable runs the other way, so that insertion drags both jaws' mean direction.
    """

    wrist_length: float
    jaw_coupling: float
    insertion_sign: int
    opposed_jaws: bool


RAVEN_TOOL = Raven2Tool(wrist_length=0.013, jaw_coupling=0.0, insertion_sign=1, opposed_jaws=True)
DA_VINCI_TOOL = Raven2Tool(wrist_length=0.009, jaw_coupling=0.5, insertion_sign=-1, opposed_jaws=False)


def raven2(side: Side, instrument: Raven2Tool = RAVEN_TOOL, tool: ArrayLike | None = None) -> RemoteCentreArm:
    """RAVEN-II arm: joints shoulder, elbow, insertion, roll, wrist pitch, wrist yaw (mean of the jaws).

    Parameters
    ----------
    side : "left" or "right", the gold or the green arm
    instrument : Raven2Tool, tool on the arm
    tool : (4, 4) array, optional, tip in frame 6; frame 6 itself by default

    Raises
    ------
    DataError
        The side is neither.
    """
    if side not in ("left", "right"):
        raise DataError(f"a RAVEN-II arm is 'left' or 'right', got {side!r}.")
    return RemoteCentreArm(
        name=f"raven2_{side}",
        chain=_chain(side, instrument, np.eye(4) if tool is None else np.asarray(tool, dtype=np.float64)),
        wrist_link=4,
        home=_radians(HOME_DEG),
        gravity=np.array([-STANDARD_GRAVITY, 0.0, 0.0]),
        links=tuple(Link(m, np.array(c)) for m, c in zip(MASSES, CENTRES[side], strict=True)),
        velocity_limits=_radians(VELOCITY_LIMITS_DEG),
        transmission=Transmission(_transmission_matrix(side, instrument)),
    )


def _chain(side: Side, instrument: Raven2Tool, tool: FloatArray) -> Chain:
    left = side == "left"
    alphas = (0.0 if left else np.pi, ALPHA_12, np.pi - ALPHA_23 if left else ALPHA_23, 0.0, np.pi / 2, np.pi / 2)
    lengths = (0.0, 0.0, 0.0, 0.0, 0.0, instrument.wrist_length)
    shifts = (0.0, 0.0, 0.0, SHAFT_OFFSET, 0.0, 0.0)
    thetas = np.deg2rad(THETA_OFFSET_DEG[side])
    lower, upper = (_radians(bounds) for bounds in zip(*LIMITS_DEG, strict=True))
    rows = zip("RRPRRR", alphas, lengths, shifts, thetas, lower, upper, strict=True)
    joints = tuple(Joint("P" if kind == "P" else "R", *numbers) for kind, *numbers in rows)
    return Chain(joints, "modified", tool=tool)


def _transmission_matrix(side: Side, instrument: Raven2Tool) -> FloatArray:
    """Motor rad for each joint rad or m; the yaw motor is half the difference of the two jaw motors.

    Jaws obey j1 = (m1 - s1 i)/tr - k pitch and j2 = (m2 - s2 i)/tr + k pitch, i being the insertion motor's
    drag, and yaw is (j2 - j1)/2, so the pair moves as one motor (m2 - m1)/2 dragged by (s2 - s1)/2.
    """
    drag = instrument.insertion_sign * (1 if side == "left" else -1) / INSERTION_PER_TOOL_MOTOR
    joint_rows = np.eye(6)
    joint_rows[1, 0] = COUPLING_12
    joint_rows[2, :2] = COUPLING_13, COUPLING_23
    joint_rows[5, 4] = -instrument.jaw_coupling
    ratios = np.array([TR_SHOULDER, TR_ELBOW, TR_INSERTION, TR_ROLL, TR_PITCH, TR_YAW])
    dragged = np.eye(6)
    dragged[3:, 2] = drag, drag, drag if instrument.opposed_jaws else 0.0
    return dragged @ (ratios[:, None] * joint_rows)


def _radians(values: ArrayLike) -> FloatArray:
    """Degrees to radians, except the third joint's metres."""
    numbers = np.asarray(values, dtype=np.float64)
    return np.where(np.arange(6) == 2, numbers, np.deg2rad(numbers))


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
        gravity=np.array([0.0, 0.0, -STANDARD_GRAVITY]),  # z of the base frame points up
    )
