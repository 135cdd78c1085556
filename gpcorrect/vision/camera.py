"""A calibrated camera: from points to pixels, and from pixels to rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array
from gpcorrect.vision.opencv import Image, cv2

IN_FRONT = 1e-6  # m: a point nearer to the plane of the lens has no pixel


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Pinhole with lens distortion, as OpenCV defines them; the centre of the first pixel is at (0, 0).

    Parameters
    ----------
    width, height : int, of the picture, px
    matrix : (3, 3) array, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], px
    distortion : (5,) array, k1, k2, p1, p2, k3; four are enough, and none means zeros
    """

    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen_array(self.matrix))
        given = np.ravel(self.distortion)
        if self.matrix.shape != (3, 3) or given.size not in (0, 4, 5):
            raise DataError(
                f"a camera has a 3 x 3 matrix and 4 or 5 distortion numbers; got {self.matrix.shape} and {given.size}."
            )
        object.__setattr__(self, "distortion", frozen_array(np.pad(given, (0, 5 - given.size))))
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        finite = np.isfinite(self.matrix).all() and np.isfinite(given).all()
        if not finite or min(fx, fy) <= 0 or not np.allclose(self.matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]):
            raise DataError(
                f"a camera's matrix is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above zero, all numbers "
                f"finite; got {self.matrix.tolist()} and distortion {given.tolist()}."
            )

    def require_size(self, image: Image, name: str) -> None:
        """Check that a picture is one in colour of the size that the lens is known for: else pixels mean other rays.

        Parameters
        ----------
        image : (height, width, 3) uint8 array
        name : str, of the camera, for the message

        Raises
        ------
        DataError
            It has another size, or is no such array.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise DataError(
                f"a picture of camera {name} is a (height, width, 3) array of uint8; got {image.dtype} of "
                f"{image.shape}."
            )
        if image.shape[:2] != (self.height, self.width):
            raise DataError(
                f"camera {name} was calibrated at {self.width} x {self.height}, its picture has {image.shape[1]} x "
                f"{image.shape[0]}.",
                hint="Record at the size of the calibration, or calibrate at the size of the recording.",
            )

    @property
    def focal(self) -> float:
        """Mean focal length, px."""
        return float(0.5 * (self.matrix[0, 0] + self.matrix[1, 1]))

    def normalised(self, pixels: FloatArray) -> FloatArray:
        """Undistort pixels onto the plane one unit before the lens `(n, 2)`.

        Parameters
        ----------
        pixels : (n, 2) array, px
        """
        flat = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if not flat.size:
            return np.zeros((0, 2))
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-9)
        done: FloatArray = cv2.undistortPoints(flat, self.matrix, self.distortion, criteria=criteria)
        return done.reshape(-1, 2)

    def pixels(self, local: FloatArray) -> FloatArray:
        """Project points of the camera frame to pixels `(n, 2)`.

        Parameters
        ----------
        local : (n, 3) array, x right, y down, z forward, m
        """
        points = np.ascontiguousarray(local, dtype=np.float64).reshape(-1, 1, 3)
        if not points.size:
            return np.zeros((0, 2))
        seen: FloatArray = cv2.projectPoints(points, np.zeros(3), np.zeros(3), self.matrix, self.distortion)[0]
        return seen.reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that stands somewhere.

    Parameters
    ----------
    name : str, for messages and columns
    intrinsics : Intrinsics, its lens
    T_camera_tracker : (4, 4) array, maps tracker coordinates into the camera frame (OpenCV's rvec and tvec), m
    covariance : (6, 6) array or None
        Of the camera's pose in the tracker frame: position (m), then rotation vector (rad), tracker axes; None when
        not known.
    rms_px : float or None, reprojection error of the calibration
    delay : float or None
        By how much later than the first camera's its pictures are taken, s; None when not known: the tracker learns it.
    readout : float
        From the first row of a picture to the last, s: of a rolling shutter; 0 when all rows are taken at once.
    """

    name: str
    intrinsics: Intrinsics
    T_camera_tracker: FloatArray
    covariance: FloatArray | None = None
    rms_px: float | None = None
    delay: float | None = None
    readout: float = 0.0

    def __post_init__(self) -> None:
        T = np.asarray(self.T_camera_tracker, dtype=np.float64)
        if T.shape != (4, 4) or not _is_rigid(T):
            raise DataError(f"camera {self.name}: T_camera_tracker is no rigid motion, or not 4 x 4.")
        object.__setattr__(self, "T_camera_tracker", frozen_array(T))
        if self.covariance is not None:
            object.__setattr__(self, "covariance", frozen_array(self.covariance))

    @property
    def position(self) -> FloatArray:
        """Optical centre `(3,)`, tracker frame, m."""
        return se3.invert(self.T_camera_tracker)[:3, 3]

    def local(self, points: FloatArray) -> FloatArray:
        """Transform points of the tracker frame into the camera frame `(n, 3)`, m.

        Parameters
        ----------
        points : (n, 3) array, m
        """
        T = self.T_camera_tracker
        return np.asarray(points).reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]

    def project(self, points: FloatArray) -> FloatArray:
        """Project points of the tracker frame to pixels `(n, 2)`; NaN for what is behind the camera.

        Parameters
        ----------
        points : (n, 3) array, m
        """
        local = self.local(points)
        return np.where(local[:, 2:] > IN_FRONT, self.intrinsics.pixels(local), np.nan)

    def directions(self, local: FloatArray) -> FloatArray:
        """Rotate directions of the camera frame into the tracker frame `(n, 3)`, of unit length.

        Parameters
        ----------
        local : (n, 3) array, of any length
        """
        d: FloatArray = np.asarray(local).reshape(-1, 3) @ self.T_camera_tracker[:3, :3]
        return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


def _is_rigid(T: FloatArray) -> bool:
    """Whether a matrix turns and moves, to the three decimals that people write: no scale, no shear, no mirror."""
    R = T[:3, :3]
    square = np.allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-3) and np.linalg.det(R) > 0
    return bool(np.isfinite(T).all() and square and np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], rtol=0.0))


def require_two(cameras: Sequence[Camera]) -> None:
    """Check that there are cameras enough for places in space.

    Parameters
    ----------
    cameras : sequence of Camera

    Raises
    ------
    DataError
        There are fewer than two.
    """
    if len(cameras) < 2:
        raise DataError(f"tracking in space needs two cameras or more, got {len(cameras)}.")
