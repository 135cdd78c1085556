"""The tool over time: constant velocity between frames, coasting through occlusions, an honest "lost" after that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["FilterSettings", "Filtered", "PoseFilter", "Status"]

Status = Literal["measured", "coasting", "lost"]
UNKNOWN = np.array([1.0] * 3 + [np.pi] * 3)  # m and rad: the standard deviation of a pose of which nothing is known
START_SPEED = np.array([0.5] * 3 + [5.0] * 3)  # m/s and rad/s: standard deviation of an unknown velocity
MOVING = 6  # numbers of the state that are a pose; the other six are its velocity


@dataclass(frozen=True)
class FilterSettings:
    """How the tool may move.

    Parameters
    ----------
    acceleration : float
        Standard deviation of unknown accelerations, m/s^2; large, so that measured poses are hardly smoothed.
    angular_acceleration : float
        The same of turns, rad/s^2.
    coast : float
        Seconds without measurement after which the tool is lost.
    gate : float
        Squared Mahalanobis distance beyond which a measurement is not believed, unless it is repeated.
    stubborn : int
        Frames in a row after which it is believed after all.
    """

    acceleration: float = 1.5
    angular_acceleration: float = 20.0
    coast: float = 0.5
    gate: float = 60.0
    stubborn: int = 3


@dataclass(frozen=True, eq=False)
class Filtered:
    """Where the tool is believed to be; every number is finite whatever the status.

    Parameters
    ----------
    status : str
        "measured", "coasting" (predicted from the last measurements), or "lost" (the pose is the last believed one, and
        means nothing).
    T_tracker_tool : (4, 4) array
        m.
    std : (6,) array
        Of position (m) and rotation vector (rad).
    """

    status: Status
    T_tracker_tool: FloatArray
    std: FloatArray


class PoseFilter:
    """A Kalman filter (filterpy) on position and rotation with their velocities, error state for the rotation.

    Parameters
    ----------
    settings : FilterSettings, optional
        How the tool may move.
    """

    def __init__(self, settings: FilterSettings | None = None) -> None:
        self.settings = settings or FilterSettings()
        self._kalman: KalmanFilter | None = None
        self._R = np.eye(3)
        self._last = np.eye(4)
        self._time = -np.inf
        self._seen = -np.inf
        self._refused = 0

    @property
    def is_lost(self) -> bool:
        """Whether nothing is known of the tool."""
        return self._kalman is None

    def predicted(self, time: float) -> FloatArray | None:
        """Pose `(4, 4)` expected at a later time, or None when lost; the filter stays as it is."""
        if self._kalman is None:
            return None
        dt = max(time - self._time, 0.0)
        x = np.ravel(self._kalman.x)
        moved = x[:MOVING] + dt * x[MOVING:]
        return se3.pose(se3.matrix_from_rotvec(moved[3:]) @ self._R, moved[:3])

    def step(
        self,
        time: float,
        T_tracker_tool: FloatArray | None = None,
        covariance: FloatArray | None = None,
        *,
        found_anew: bool = False,
    ) -> Filtered:
        """Move to `time`, take in a pose if there is one, and say where the tool is.

        Parameters
        ----------
        time : float
            Seconds, increasing.
        T_tracker_tool : (4, 4) array, optional
            The measured pose.
        covariance : (6, 6) array, optional
            Of position and rotation vector; a tenth of a millimetre and 3 mrad when absent.
        found_anew : bool
            The pose comes from a search without prediction: when it is far off, the past is forgotten.

        Raises
        ------
        DataError
            Time does not increase, or the measurement holds NaN.
        """
        if not time > self._time:
            raise DataError(f"frames must come in the order of time; {time} s follows {self._time} s.")
        if T_tracker_tool is not None and not np.isfinite(T_tracker_tool).all():
            raise DataError("a measured pose holds NaN; leave out what was not measured.")
        dt = time - self._time
        self._time = time
        noise = np.diag(np.array([1e-4] * 3 + [3e-3] * 3) ** 2) if covariance is None else covariance
        if self._kalman is None:
            return self._begun(time, T_tracker_tool, noise)
        self._predict(dt)
        if T_tracker_tool is not None and self._believed(T_tracker_tool, noise, found_anew):
            self._seen = time
            return self._state("measured")
        if time - self._seen > self.settings.coast:
            self._kalman = None
            return Filtered("lost", self._last, UNKNOWN)
        return self._state("coasting")

    def _begun(self, time: float, T: FloatArray | None, noise: FloatArray) -> Filtered:
        if T is None:
            return Filtered("lost", self._last, UNKNOWN)
        kalman = KalmanFilter(dim_x=2 * MOVING, dim_z=MOVING)
        kalman.x = np.concatenate([T[:3, 3], np.zeros(3 + MOVING)])[:, None]
        kalman.H = np.eye(MOVING, 2 * MOVING)
        kalman.P = np.zeros((2 * MOVING, 2 * MOVING))
        kalman.P[:MOVING, :MOVING] = noise
        kalman.P[MOVING:, MOVING:] = np.diag(START_SPEED**2)
        self._kalman, self._R, self._seen, self._refused = kalman, np.array(T[:3, :3]), time, 0
        return self._state("measured")

    def _predict(self, dt: float) -> None:
        assert self._kalman is not None
        F = np.eye(2 * MOVING)
        F[:MOVING, MOVING:] = dt * np.eye(MOVING)
        block = Q_discrete_white_noise(dim=2, dt=dt, var=1.0)
        variances = np.diag([self.settings.acceleration**2] * 3 + [self.settings.angular_acceleration**2] * 3)
        self._kalman.predict(F=F, Q=np.kron(block, variances))
        self._fold()

    def _believed(self, T: FloatArray, noise: FloatArray, found_anew: bool) -> bool:
        """Take a measurement in, unless it is too far off to be true; a refusal that repeats starts the filter anew."""
        assert self._kalman is not None
        turn = se3.rotvec_from_matrix(T[:3, :3] @ self._R.T)
        z = np.concatenate([T[:3, 3], turn])
        off = z - np.ravel(self._kalman.x)[:MOVING]
        distance = float(off @ np.linalg.solve(self._kalman.P[:MOVING, :MOVING] + noise, off))
        if distance > self.settings.gate:
            self._refused += 1
            if self._refused < self.settings.stubborn and not found_anew:
                return False
            self._begun(self._time, T, noise)
            return True
        self._refused = 0
        self._kalman.update(z[:, None], R=noise)
        self._kalman.P = 0.5 * (self._kalman.P + self._kalman.P.T)
        self._fold()
        return True

    def _fold(self) -> None:
        """Move the rotation part of the state into the reference, so that it stays small."""
        assert self._kalman is not None
        turn = np.ravel(self._kalman.x)[3:MOVING]
        self._R = se3.nearest_rotation(se3.matrix_from_rotvec(turn) @ self._R)
        self._kalman.x[3:MOVING] = 0.0

    def _state(self, status: Status) -> Filtered:
        assert self._kalman is not None
        self._last = se3.pose(self._R, np.ravel(self._kalman.x)[:3])
        std = np.sqrt(np.maximum(np.diag(self._kalman.P)[:MOVING], 0.0))
        return Filtered(status, self._last, np.minimum(std, UNKNOWN))
