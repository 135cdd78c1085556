"""Three arms by their published numbers, written down once more: RAVEN-II, dVRK's PSM, and an industrial six-axis arm.

RAVEN-II: uw-biorobotics/raven2. PSM: BerkeleyAutomation/dvrkCalibration; its masses are chosen by hand, nearly
balanced about the remote centre as the real arm is. Industrial: the UR5's table, masses and inertias as in
ros-industrial/universal_robot (ur_description).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

QUARTER = np.pi / 2


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm of which the first joints move and the others are held at zero.

    Parameters
    ----------
    name : str, of the arm
    declared : str, `arm` of the nominal model; "joints" says nothing of kinematics, masses and controller
    types : str, "R" or "P" for each moving joint
    rows : (m, 4) array, Denavit-Hartenberg table, alpha, a, d, theta at joint value zero, held joints too
    modified : bool, Craig's convention Rx(alpha) Tx(a) Rz(theta) Tz(d), else Rz(theta) Tz(d) Tx(a) Rx(alpha)
    theta_offset_deg : tuple of float or None, as the nominal model gives them, degrees
    mass, centre, moment : (k,), (k, 3), (k, 3) arrays, kg, m and kg m^2 of the moving links, in link frames
    gravity : (3,) array, m/s^2, base frame
    motor_inertia, ranges, zigzag_speed, encoder_step : (k,), (k, 2), (k,), (k,) arrays, joint units
    payloads : tuple of float, kg, in turn
    base_turn, tool_turns : floats, base Rx before the table, tool Rz and Rx after it, rad
    """

    name: str
    declared: str
    types: str
    rows: Array
    modified: bool
    theta_offset_deg: tuple[float, ...] | None
    mass: Array
    centre: Array
    moment: Array
    gravity: Array
    motor_inertia: Array
    ranges: Array
    zigzag_speed: Array
    encoder_step: Array
    payloads: tuple[float, ...] = (0.0, 0.18, 0.0, 0.33)
    base_turn: float = 0.0
    tool_turns: tuple[float, float] = (0.0, 0.0)

    @property
    def dof(self) -> int:
        """Number of moving joints."""
        return len(self.types)

    @property
    def bare(self) -> bool:
        """Whether the nominal model knows joints only."""
        return self.declared == "joints"

    def unit(self, j: int, revolute: float, prismatic: float) -> float:
        """Return a number for a turning or a sliding joint."""
        return revolute if self.types[j] == "R" else prismatic


RAVEN_OFFSETS = (205.0, 180.0, 90.0, 0.0, -90.0, 0.0)

RAVEN = Arm(
    name="raven2_left",
    declared="raven2_left",
    types="RRP",
    rows=np.array(
        [
            [0.0, 0.0, 0.0, np.deg2rad(205.0)],
            [np.deg2rad(75.0), 0.0, 0.0, np.pi],
            [np.deg2rad(128.0), 0.0, 0.0, QUARTER],
            [0.0, 0.0, -0.47, 0.0],
            [QUARTER, 0.0, 0.0, -QUARTER],
            [QUARTER, 0.013, 0.0, 0.0],
        ]
    ),
    modified=True,
    theta_offset_deg=RAVEN_OFFSETS,
    mass=np.array([0.494, 0.750, 0.231]),
    centre=np.array([[0.0065, 0.09775, -0.13771], [-0.002, -0.18274, -0.23053], [0.0, 0.0, 0.0]]),
    moment=np.array([[2.1e-3, 1.6e-3, 1.1e-3], [3.4e-3, 2.9e-3, 1.3e-3], [6e-4, 6e-4, 1e-4]]),
    gravity=np.array([-9.80665, 0.0, 0.0]),
    motor_inertia=np.array([0.263, 0.208, 66.1]),
    ranges=np.array([[0.35, 1.05], [0.96, 1.92], [0.33, 0.42]]),
    zigzag_speed=np.array([0.12, 0.16, 0.014]),
    encoder_step=np.array([1.15e-5, 1.3e-5, 7.3e-7]),
)

PSM = Arm(
    name="dvrk_psm",
    declared="dvrk_psm",
    types="RRP",
    rows=np.array(
        [
            [-QUARTER, 0.0, 0.0, QUARTER],
            [-QUARTER, 0.0, 0.0, QUARTER],
            [0.0, 0.0, -0.0156, 0.0],
            [QUARTER, 0.0, 0.0, 0.0],
            [-QUARTER, 0.0091, 0.0, QUARTER],
            [0.0, 0.0102, 0.0, 0.0],
        ]
    ),
    modified=False,
    theta_offset_deg=None,
    mass=np.array([1.9, 1.3, 0.34]),
    centre=np.array([[0.03, 0.01, 0.05], [0.04, -0.02, 0.05], [0.0, 0.02, -0.06]]),
    moment=np.array([[9e-3, 8e-3, 5e-3], [7e-3, 6e-3, 4e-3], [8e-4, 7e-4, 2e-4]]),
    gravity=np.array([0.0, 0.0, -9.80665]),
    motor_inertia=np.array([0.06, 0.055, 6.0]),
    ranges=np.array([[-0.6, 0.5], [-0.4, 0.45], [0.09, 0.19]]),
    zigzag_speed=np.array([0.15, 0.13, 0.016]),
    encoder_step=np.array([8e-6, 8e-6, 5e-7]),
    base_turn=QUARTER,
    tool_turns=(QUARTER, -QUARTER),
)

INDUSTRIAL = Arm(
    name="ur5",
    declared="joints",
    types="RRRRRR",
    rows=np.array(
        [
            [QUARTER, 0.0, 0.089159, 0.0],
            [0.0, -0.425, 0.0, 0.0],
            [0.0, -0.39225, 0.0, 0.0],
            [QUARTER, 0.0, 0.10915, 0.0],
            [-QUARTER, 0.0, 0.09465, 0.0],
            [0.0, 0.0, 0.0823, 0.0],
        ]
    ),
    modified=False,
    theta_offset_deg=None,
    mass=np.array([3.7, 8.393, 2.275, 1.219, 1.219, 0.1879]),
    centre=np.array(
        [
            [0.0, -0.02561, 0.00193],
            [0.2125, 0.0, 0.11336],
            [0.11993, 0.0, 0.0265],
            [0.0, -0.0018, 0.01634],
            [0.0, 0.0018, 0.01634],
            [0.0, 0.0, -0.001159],
        ]
    ),
    moment=np.array(
        [
            [0.0103, 0.0103, 0.0067],
            [0.0151, 0.2269, 0.2269],
            [0.0041, 0.0494, 0.0494],
            [0.0023, 0.0022, 0.0022],
            [0.0023, 0.0022, 0.0022],
            [1e-4, 1e-4, 1.3e-4],
        ]
    ),
    gravity=np.array([0.0, 0.0, -9.80665]),
    motor_inertia=np.array([4.0, 4.0, 2.5, 0.4, 0.4, 0.3]),
    ranges=np.array([[-0.7, 0.7], [-1.9, -1.2], [0.8, 1.6], [-1.6, -0.8], [-1.9, -1.2], [-0.6, 0.6]]),
    zigzag_speed=np.array([0.22, 0.12, 0.13, 0.13, 0.12, 0.19]),
    encoder_step=np.array([6e-6, 6e-6, 6e-6, 9e-6, 9e-6, 9e-6]),
    payloads=(0.0, 1.0, 0.0, 2.0),
)

ARMS = {arm.name: arm for arm in (RAVEN, PSM, INDUSTRIAL)}
