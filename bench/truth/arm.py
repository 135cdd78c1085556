"""The left RAVEN-II as published: table, masses and mounting, written down again so that an error elsewhere shows here.

Numbers: uw-biorobotics/raven2 (r2_kinematics, grav_comp). Craig's convention, Rx(alpha) Tx(a) Rz(theta) Tz(d).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

THETA_OFFSET_DEG = (205.0, 180.0, 90.0, 0.0, -90.0, 0.0)
WRIST = (0.0, 0.0, 0.0)
RIGHT_ANGLE = np.pi / 2
# alpha, a, d, theta of each row at joint value zero; the third joint's value adds to d
ROWS = np.array(
    [
        [0.0, 0.0, 0.0, np.deg2rad(THETA_OFFSET_DEG[0])],
        [np.deg2rad(75.0), 0.0, 0.0, np.deg2rad(THETA_OFFSET_DEG[1])],
        [np.pi - np.deg2rad(52.0), 0.0, 0.0, RIGHT_ANGLE],
        [0.0, 0.0, -0.47, 0.0],
        [RIGHT_ANGLE, 0.0, 0.0, -RIGHT_ANGLE],
        [RIGHT_ANGLE, 0.013, 0.0, 0.0],
    ]
)
MASSES = np.array([0.494, 0.750, 0.231])  # kg
CENTRES = np.array([[0.0065, 0.09775, -0.13771], [-0.002, -0.18274, -0.23053], [0.0, 0.0, 0.0]])  # m, link frames
INERTIAS = np.array([[2.1e-3, 1.6e-3, 1.1e-3], [3.4e-3, 2.9e-3, 1.3e-3], [6e-4, 6e-4, 1e-4]])  # kg m^2, of slim links
GRAVITY = np.array([-9.80665, 0.0, 0.0])  # m/s^2; the arm hangs with -x of frame 0 down
MOTOR_INERTIA = np.array([0.263, 0.208, 66.1])  # kg m^2, kg m^2, kg: RE 40 rotors through the gears
RANGES = np.array([[0.35, 1.05], [0.96, 1.92], [0.33, 0.42]])  # rad, rad, m; where the paper's zig-zags went


def link_transform(row: Array, turn: Array, shift: Array) -> Array:
    """Return transforms `(n, 4, 4)` of one row at added angles and lengths `(n,)`."""
    alpha, a, d, theta = row
    c, s = np.cos(theta + turn), np.sin(theta + turn)
    ca, sa = np.cos(alpha), np.sin(alpha)
    T = np.zeros((len(turn), 4, 4))
    T[:, 0, 0], T[:, 0, 1], T[:, 0, 3] = c, -s, a
    T[:, 1, 0], T[:, 1, 1], T[:, 1, 2], T[:, 1, 3] = s * ca, c * ca, -sa, -sa * (d + shift)
    T[:, 2, 0], T[:, 2, 1], T[:, 2, 2], T[:, 2, 3] = s * sa, c * sa, ca, ca * (d + shift)
    T[:, 3, 3] = 1.0
    return T


def forward(q: Array, rows: Array = ROWS) -> Array:
    """Tip poses `(n, 4, 4)` of joints 1 to 3 `(n, 3)`, wrist held."""
    zero = np.zeros(len(q))
    values = np.column_stack([q, np.broadcast_to(WRIST, (len(q), 3))])
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for i, row in enumerate(rows):
        turn, shift = (zero, values[:, i]) if i == 2 else (values[:, i], zero)
        T = T @ link_transform(row, turn, shift)
    return T


def tip_in_shaft() -> Array:
    """Tip `(3,)` in the frame of link 3, wrist held, m."""
    T = np.eye(4)[None]
    for row, value in zip(ROWS[3:], WRIST, strict=True):
        T = T @ link_transform(row, np.array([value]), np.zeros(1))
    return T[0, :3, 3]
