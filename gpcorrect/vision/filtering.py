"""The tool over time: constant velocity between frames, prediction through short occlusions, lost after that."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, MissingExtraError
from gpcorrect.types import FloatArray
from gpcorrect.vision.pose import POSE, Motion
from gpcorrect.vision.settings import DEFAULT, MotionSettings

try:
    from filterpy.common import Q_discrete_white_noise
    from filterpy.kalman import KalmanFilter
except ImportError as error:
    raise MissingExtraError("filterpy", extra="vision", purpose="Following a tool by cameras") from error

UNKNOWN = np.array([1.0] * 3 + [np.pi] * 3)  # m and rad: the standard deviation of a pose of which nothing is known
USUAL_STD = np.array([1e-4] * 3 + [3e-3] * 3)  # m and rad: of a pose without covariance, as a good frame has it


class Status(StrEnum):
    """What a frame's pose is worth."""

    MEASURED = "measured"
    COASTING = "coasting"
    LOST = "lost"


STATUSES = tuple(Status)  # the codes of `tracking_status` are indices into it


@dataclass(frozen=True, eq=False)
class Filtered:
    """The estimated pose; every number is finite whatever the status."""

    # "measured", "coasting" (predicted from the last measurements), or "lost" (the pose is the last known one, and
    # means nothing)
    status: Status
    T_tracker_tool: FloatArray  # (4, 4) m
    std: FloatArray  # (6,) of position (m) and rotation vector (rad)


class PoseFilter:
    """A Kalman filter (filterpy) on position and rotation with their velocities, error state for the rotation.

    Parameters
    ----------
    settings : MotionSettings, how the tool may move
    """

    def __init__(self, settings: MotionSettings = DEFAULT.motion) -> None:
        self.settings = settings
        self._kalman: KalmanFilter | None = None
        self._R = np.eye(3)
        self._last = np.eye(4)
        self._time = -np.inf
        self._seen = -np.inf
        self._refused = 0
        self._taken = 0  # measurements since the filter began

    def predicted(self, time: float) -> FloatArray | None:
        """Return the pose `(4, 4)` expected at another time, None when lost; the filter stays as it is.

        Parameters
        ----------
        time : float, s
        """
        if self._kalman is None:
            return None
        x = np.ravel(self._kalman.x)
        moved = x[:POSE] + (time - self._time) * x[POSE:]
        return se3.pose(se3.matrix_from_rotvec(moved[3:]) @ self._R, moved[:3])

    def motion(self, time: float) -> Motion | None:
        """Return the velocity expected at a later time; None until a few frames have shown it.

        Parameters
        ----------
        time : float, s
        """
        settings = self.settings
        if self._kalman is None or self._taken < settings.shows_speed:
            return None
        change = np.array([settings.usual_acceleration] * 3 + [settings.usual_angular_acceleration] * 3)
        grown = np.diag((max(time - self._seen, 0.0) * change) ** 2)
        return Motion(np.ravel(self._kalman.x)[POSE:].copy(), grown)

    def step(
        self,
        time: float,
        T_tracker_tool: FloatArray | None = None,
        covariance: FloatArray | None = None,
        *,
        sure: bool = False,
    ) -> Filtered:
        """Move to `time`, take in a pose if there is one, and return the estimate.

        Parameters
        ----------
        time : float, seconds, increasing
        T_tracker_tool : (4, 4) array, optional, the measured pose
        covariance : (6, 6) array, optional
            Of position and rotation vector; a tenth of a millimetre and 3 mrad when absent.
        sure : bool, whether the pose is one whatever was expected: when it is far off, the past is forgotten

        Raises
        ------
        DataError
            Time does not increase, or the measurement holds NaN.
        """
        if not time > self._time:
            raise DataError(f"frames must come in the order of time; {time} s follows {self._time} s.")
        if T_tracker_tool is not None and not np.isfinite(T_tracker_tool).all():
            raise DataError("a measured pose holds NaN; leave out what was not measured.")
        dt, self._time = time - self._time, time
        noise = np.diag(USUAL_STD**2) if covariance is None else covariance
        if self._kalman is not None:
            F = np.eye(2 * POSE)
            F[:POSE, POSE:] = dt * np.eye(POSE)
            variances = np.diag([self.settings.acceleration**2] * 3 + [self.settings.angular_acceleration**2] * 3)
            self._kalman.predict(F=F, Q=np.kron(Q_discrete_white_noise(dim=2, dt=dt, var=1.0), variances))
            self._fold(self._kalman)
        if T_tracker_tool is not None and self._believed(T_tracker_tool, noise, sure):
            self._seen = time
            return self._estimate(Status.MEASURED)
        if T_tracker_tool is None:
            self._refused = 0
        if time - self._seen > self.settings.coast:
            self._kalman = None
        return self._estimate(Status.COASTING)

    def _believed(self, T: FloatArray, noise: FloatArray, sure: bool) -> bool:
        """Take a measurement in, unless it is too far off to be true; a refusal that repeats starts the filter anew.

        So does a measurement that a steady motion hardly explains: the way to it would be taken for a speed, which
        then puts the next frames elsewhere.
        """
        if self._kalman is None:
            self._start(T, noise)
            return True
        z = np.concatenate([T[:3, 3], se3.rotvec_from_matrix(T[:3, :3] @ self._R.T)])
        off = z - np.ravel(self._kalman.x)[:POSE]
        distance = float(off @ np.linalg.solve(self._kalman.P[:POSE, :POSE] + noise, off))
        if distance > self.settings.surprise:
            if distance > self.settings.gate and not sure:
                self._refused += 1
                if self._refused < self.settings.stubborn:
                    return False
            self._start(T, noise)
            return True
        self._refused = 0
        self._taken += 1
        self._kalman.update(z[:, None], R=noise)
        self._kalman.P = 0.5 * (self._kalman.P + self._kalman.P.T)
        self._fold(self._kalman)
        return True

    def _start(self, T: FloatArray, noise: FloatArray) -> None:
        """Begin at a measured pose, with a velocity about which nothing is known."""
        kalman = KalmanFilter(dim_x=2 * POSE, dim_z=POSE)
        kalman.x = np.concatenate([T[:3, 3], np.zeros(3 + POSE)])[:, None]
        kalman.H = np.eye(POSE, 2 * POSE)
        kalman.P = np.zeros((2 * POSE, 2 * POSE))
        kalman.P[:POSE, :POSE] = noise
        kalman.P[POSE:, POSE:] = np.diag([self.settings.start_speed**2] * 3 + [self.settings.start_turn**2] * 3)
        self._kalman, self._R, self._refused, self._taken = kalman, np.array(T[:3, :3]), 0, 1

    def _fold(self, kalman: KalmanFilter) -> None:
        """Move the rotation part of the state into the reference, so that it stays small."""
        turn = np.ravel(kalman.x)[3:POSE]
        self._R = se3.nearest_rotation(se3.matrix_from_rotvec(turn) @ self._R)
        kalman.x[3:POSE] = 0.0

    def _estimate(self, status: Status) -> Filtered:
        if self._kalman is None:
            return Filtered(Status.LOST, self._last, UNKNOWN)
        self._last = se3.pose(self._R, np.ravel(self._kalman.x)[:3])
        std = np.sqrt(np.maximum(np.diag(self._kalman.P)[:POSE], 0.0))
        return Filtered(status, self._last, np.minimum(std, UNKNOWN))
