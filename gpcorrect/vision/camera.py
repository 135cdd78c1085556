"""A calibrated camera: from points to pixels, and from pixels to rays."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array
from gpcorrect.vision.opencv import cv2

__all__ = ["Camera", "Intrinsics"]


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Pinhole with lens distortion, as OpenCV defines them; the centre of the first pixel is at (0, 0).

    Parameters
    ----------
    width, height : int
        Of the picture, px.
    matrix : (3, 3) array
        [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], px.
    distortion : (5,) array
        k1, k2, p1, p2, k3.
    """

    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen_array(self.matrix))
        distortion = np.zeros(5)
        given = np.ravel(self.distortion)
        if self.matrix.shape != (3, 3) or given.size not in (0, 4, 5):
            raise DataError(
                f"a camera has a 3 x 3 matrix and 4 or 5 distortion numbers; got {self.matrix.shape} and {given.size}."
            )
        distortion[: given.size] = given
        object.__setattr__(self, "distortion", frozen_array(distortion))

    @property
    def focal(self) -> float:
        """Mean focal length, px."""
        return float(0.5 * (self.matrix[0, 0] + self.matrix[1, 1]))

    def normalised(self, pixels: FloatArray) -> FloatArray:
        """Undistorted places `(n, 2)` of pixels `(n, 2)` on the plane one unit before the lens."""
        flat = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if not flat.size:
            return np.zeros((0, 2))
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-9)
        done: FloatArray = cv2.undistortPoints(flat, self.matrix, self.distortion, criteria=criteria)
        return done.reshape(-1, 2)

    def pixels(self, local: FloatArray) -> FloatArray:
        """Pixels `(n, 2)` of points `(n, 3)` in the camera frame (x right, y down, z forward), m."""
        points = np.asarray(local, dtype=np.float64).reshape(-1, 3)
        x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        K = self.matrix
        return np.stack([K[0, 0] * u + K[0, 1] * v + K[0, 2], K[1, 1] * v + K[1, 2]], axis=1)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that stands somewhere.

    Parameters
    ----------
    name : str
        For messages and columns.
    intrinsics : Intrinsics
        Its lens.
    T_camera_tracker : (4, 4) array
        Maps tracker coordinates into the camera frame (OpenCV's rvec and tvec), m.
    covariance : (6, 6) array or None
        Of the camera's pose in the tracker frame: position (m), then rotation vector (rad), tracker axes; None when
        not known.
    rms_px : float or None
        Reprojection error of the calibration.
    """

    name: str
    intrinsics: Intrinsics
    T_camera_tracker: FloatArray
    covariance: FloatArray | None = None
    rms_px: float | None = None

    def __post_init__(self) -> None:
        T = np.asarray(self.T_camera_tracker, dtype=np.float64)
        if T.shape != (4, 4) or not np.isfinite(T).all() or abs(np.linalg.det(T[:3, :3]) - 1.0) > 1e-3:
            raise DataError(f"camera {self.name}: T_camera_tracker is no rigid motion, or not 4 x 4.")
        object.__setattr__(self, "T_camera_tracker", frozen_array(T))
        if self.covariance is not None:
            object.__setattr__(self, "covariance", frozen_array(self.covariance))

    @property
    def position(self) -> FloatArray:
        """Optical centre `(3,)`, tracker frame, m."""
        centre: FloatArray = se3.invert(self.T_camera_tracker)[:3, 3]
        return centre

    def local(self, points: FloatArray) -> FloatArray:
        """Points `(n, 3)` of the tracker frame in the camera frame, m."""
        T = self.T_camera_tracker
        moved: FloatArray = np.asarray(points).reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
        return moved

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels `(n, 2)` of points `(n, 3)` of the tracker frame; NaN for what is behind the camera."""
        local = self.local(points)
        behind = local[:, 2] <= 1e-6
        safe = np.where(behind[:, None], np.array([0.0, 0.0, 1.0]), local)
        return np.where(behind[:, None], np.nan, self.intrinsics.pixels(safe))

    def directions(self, local: FloatArray) -> FloatArray:
        """Return unit directions `(n, 3)` in the tracker frame of directions `(n, 3)` in the camera frame."""
        d: FloatArray = np.asarray(local).reshape(-1, 3) @ self.T_camera_tracker[:3, :3]
        unit: FloatArray = d / np.linalg.norm(d, axis=1, keepdims=True)
        return unit

    def sees(self, pixel: FloatArray, margin: float = 0.0) -> bool:
        """Whether a pixel `(2,)` is inside the picture, by `margin` px."""
        size = (self.intrinsics.width, self.intrinsics.height)
        return bool(np.all(np.asarray(pixel) >= margin) and np.all(np.asarray(pixel) < np.array(size) - margin))
