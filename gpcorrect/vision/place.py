"""Where a camera stands: roughly from one chessboard, then by Levenberg-Marquardt on points at known places.

Peng et al. 2020, Eqs. 1-3: the pose that brings the projections of the known points nearest to where they are seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import BoolArray, FloatArray
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.chessboard import Chessboard
from gpcorrect.vision.opencv import cv2

__all__ = ["Placement", "pose_covariance", "poses_from_board", "poses_from_points", "refine_pose"]

Loss = Literal["linear", "soft_l1"]
FEWEST_POINTS = 6
OUTLIER = 4.0  # standard deviations, by the median
WORST = 0.015  # of the picture's width: what is farther off is one whatever the others are
LEAST_OUTLIER = 1.0  # px: nothing nearer is ever called an outlier


@dataclass(frozen=True, eq=False)
class Placement:
    """A camera's place as known points tell it.

    Parameters
    ----------
    T_camera_tracker : (4, 4) array
        Maps tracker coordinates into the camera frame, m.
    covariance : (6, 6) array
        Of the camera's position (m) and rotation vector (rad), tracker axes, the lens taken as exact.
    residuals : (n, 2) array
        Seen minus projected, px.
    used : (n,) mask
        Points that were not outliers.
    """

    T_camera_tracker: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    used: BoolArray

    @property
    def rms_px(self) -> float:
        """Reprojection error of the points that were used."""
        return float(np.sqrt(np.mean(np.sum(self.residuals[self.used] ** 2, axis=1))))


def poses_from_board(
    corners: FloatArray, board: Chessboard, T_tracker_board: FloatArray, lens: Intrinsics
) -> list[FloatArray]:
    """First phase: poses `T_camera_tracker` of a camera that sees one board of which the place is roughly known.

    Four of them: a board looks the same turned by half, and its place may be told with z towards the camera or away
    from it. The first is the usual one (x to the right, y down, z away from who looks at it); known points tell.
    """
    poses = []
    grid = corners.reshape(board.rows, board.columns, 2)
    for seen in (grid, grid[::-1, ::-1], grid[:, ::-1], grid[::-1]):
        found, rotvec, shift = cv2.solvePnP(
            board.points,
            np.ascontiguousarray(seen.reshape(-1, 2)),
            lens.matrix,
            lens.distortion,
            flags=cv2.SOLVEPNP_IPPE,
        )
        if found:
            T_camera_board = se3.pose(se3.matrix_from_rotvec(np.ravel(rotvec)), np.ravel(shift))
            poses.append(se3.compose(T_camera_board, se3.invert(T_tracker_board)))
    return poses


def poses_from_points(points: FloatArray, pixels: FloatArray, lens: Intrinsics) -> list[FloatArray]:
    """Poses of a camera from points at known places alone: a start where no board is at hand."""
    found, rotvec, shift = cv2.solvePnP(
        np.ascontiguousarray(points),
        np.ascontiguousarray(pixels),
        lens.matrix,
        lens.distortion,
        flags=cv2.SOLVEPNP_SQPNP,
    )
    return [se3.pose(se3.matrix_from_rotvec(np.ravel(rotvec)), np.ravel(shift))] if found else []


def refine_pose(points: FloatArray, pixels: FloatArray, lens: Intrinsics, starts: Sequence[FloatArray]) -> Placement:
    """Second phase: the pose that explains where the known points are seen, outliers left out.

    Parameters
    ----------
    points : (n, 3) array
        Known places, tracker frame, m; at least six, not all on a line.
    pixels : (n, 2) array
        Where each is seen.
    lens : Intrinsics
        The lens.
    starts : sequence of (4, 4) arrays
        Rough poses; the one that ends best is kept.

    Raises
    ------
    DataError
        Fewer than six points, or no start.
    DegenerateError
        The points do not determine the pose.
    """
    if len(points) < FEWEST_POINTS or not len(starts):
        raise DataError(f"a camera's place needs at least {FEWEST_POINTS} known points and a start; got {len(points)}.")
    fits = [_fit(points, pixels, lens, start, loss="soft_l1") for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost))
    residuals = best.fun.reshape(-1, 2)
    length = np.linalg.norm(residuals, axis=1)
    scale = min(OUTLIER * 1.4826 * float(np.median(length)), WORST * lens.width)
    used = length <= max(LEAST_OUTLIER, scale)
    if used.sum() < max(FEWEST_POINTS, len(points) / 2):
        raise DegenerateError(
            f"only {used.sum()} of {len(points)} known points agree with one place of the camera.",
            hint="Check that each is named right, and that their places are in metres.",
        )
    last = _fit(points[used], pixels[used], lens, _matrix(best.x), loss="linear")
    left = pixels - _project(points, last.x, lens)
    return Placement(_matrix(last.x), _covariance(last), left, used)


def _fit(points: FloatArray, pixels: FloatArray, lens: Intrinsics, start: FloatArray, loss: Loss) -> Any:
    """Levenberg-Marquardt, damped further against outliers when `loss` is not "linear"."""

    def residuals(x: FloatArray) -> FloatArray:
        return (_project(points, x, lens) - pixels).ravel()

    def jacobian(x: FloatArray) -> FloatArray:
        _, J = cv2.projectPoints(points, x[:3], x[3:], lens.matrix, lens.distortion)
        return np.asarray(J[:, :6])

    x0 = np.concatenate([se3.rotvec_from_matrix(start[:3, :3]), start[:3, 3]])
    if not np.isfinite(residuals(x0)).all():
        raise DegenerateError("a known point lies in the plane of the lens; the rough place cannot be right.")
    if loss == "linear":
        return least_squares(residuals, x0, jacobian, method="lm", x_scale="jac")
    return least_squares(residuals, x0, jacobian, method="trf", loss="soft_l1", x_scale="jac")


def _project(points: FloatArray, x: FloatArray, lens: Intrinsics) -> FloatArray:
    seen, _ = cv2.projectPoints(points, x[:3], x[3:], lens.matrix, lens.distortion)
    return np.asarray(seen, dtype=np.float64).reshape(-1, 2)


def _matrix(x: FloatArray) -> FloatArray:
    return se3.pose(se3.matrix_from_rotvec(x[:3]), x[3:])


def _covariance(fit: Any) -> FloatArray:
    J, r = fit.jac, fit.fun
    spread = float(r @ r) / max(len(r) - 6, 1)
    return pose_covariance(spread * np.linalg.inv(J.T @ J), fit.x)


def pose_covariance(covariance: FloatArray, x: FloatArray) -> FloatArray:
    """Covariance `(6, 6)` of the camera's position and rotation vector, tracker axes, from that of rvec and tvec.

    Parameters
    ----------
    covariance : (6, 6) array
        Of x.
    x : (6,) array
        Rotation vector and translation of T_camera_tracker, as OpenCV has them.
    """
    J_left = np.linalg.inv(se3.left_jacobian_inverse(x[:3]))
    t = x[3:]
    hat = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    R_tracker_camera = se3.matrix_from_rotvec(x[:3]).T
    # T' = exp(xi) T: the turn is J dr, the shift dt - turn x t; in tracker axes the camera moves by the opposite.
    change = np.block([[hat @ J_left, np.eye(3)], [J_left, np.zeros((3, 3))]])
    A = -np.kron(np.eye(2), R_tracker_camera) @ change
    done: FloatArray = A @ covariance @ A.T
    return done
