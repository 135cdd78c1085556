"""Where a camera stands: roughly from one chessboard, then from points at known places, then together with its lens.

Peng et al. 2020, Eqs. 1-3: the pose that brings the projections of the known points nearest to where they are seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import BoolArray, FloatArray
from gpcorrect.vision.boards import Chessboard, LensCalibration
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.opencv import cv2
from gpcorrect.vision.settings import DEFAULT, CalibrationSettings

LENS, POSE = 9, 6  # numbers of a lens (fx, fy, cx, cy, k1, k2, p1, p2, k3) and of a pose (rotation vector, translation)


@dataclass(frozen=True, eq=False)
class Placement:
    """A camera's pose from known points."""

    T_camera_tracker: FloatArray  # (4, 4) maps tracker coordinates into the camera frame, m
    covariance: FloatArray  # (6, 6) of the camera's position (m) and rotation vector (rad), tracker axes
    residuals: FloatArray  # (n, 2) seen minus projected, px
    used: BoolArray  # (n,) points that were not outliers

    @property
    def rms_px(self) -> float:
        """Reprojection error of the points that were used."""
        return float(np.sqrt(np.mean(np.sum(self.residuals[self.used] ** 2, axis=1))))


def poses_from_board(
    corners: FloatArray, board: Chessboard, T_tracker_board: FloatArray, lens: Intrinsics
) -> list[FloatArray]:
    """Return the poses that a camera may have which sees one board at a roughly known place.

    A board looks the same turned by half, and its place may be given with z towards the camera or away from it.

    Parameters
    ----------
    corners : (n, 2) array, of the board, px
    board : Chessboard
    T_tracker_board : (4, 4) array, its place, m
    lens : Intrinsics

    Returns
    -------
    list of (4, 4) arrays
        Up to four `T_camera_tracker`; first the usual one (x to the right, y down, z away from who looks at it).
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    orders = (grid, grid[::-1, ::-1], grid[:, ::-1], grid[::-1])
    T_board_tracker = se3.invert(T_tracker_board)
    seen = [_solve_pnp(board.points, order.reshape(-1, 2), lens, cv2.SOLVEPNP_IPPE) for order in orders]
    return [se3.compose(T_camera_board, T_board_tracker) for poses in seen for T_camera_board in poses]


def poses_from_points(points: FloatArray, pixels: FloatArray, lens: Intrinsics) -> list[FloatArray]:
    """Return the one pose of a camera from points at known places alone, or none: a start where no board is at hand.

    Parameters
    ----------
    points : (n, 3) array, known places, tracker frame, m
    pixels : (n, 2) array, where each is seen
    lens : Intrinsics
    """
    return _solve_pnp(points, pixels, lens, cv2.SOLVEPNP_SQPNP)


def _solve_pnp(points: FloatArray, pixels: FloatArray, lens: Intrinsics, method: int) -> list[FloatArray]:
    points, pixels = np.ascontiguousarray(points), np.ascontiguousarray(pixels)
    try:
        found, rotvec, shift = cv2.solvePnP(points, pixels, lens.matrix, lens.distortion, flags=method)
    except cv2.error:  # too few points, or all on a line
        return []
    return [_pose(np.concatenate([np.ravel(rotvec), np.ravel(shift)]))] if found else []


def _pose(x: FloatArray) -> FloatArray:
    """Pose `(4, 4)` of a rotation vector and a translation."""
    return se3.pose(se3.matrix_from_rotvec(x[:3]), x[3:])


def _project(points: FloatArray, x: FloatArray, lens: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """Pixels `(n, 2)` of points, and their Jacobian `(2n, 15)` in the pose and the lens."""
    seen, J = cv2.projectPoints(points, x[:3], x[3:], lens.matrix, lens.distortion)
    return np.asarray(seen, dtype=np.float64).reshape(-1, 2), np.asarray(J)


def refine_pose(
    points: FloatArray,
    pixels: FloatArray,
    lens: Intrinsics,
    starts: Sequence[FloatArray],
    settings: CalibrationSettings = DEFAULT.calibration,
) -> Placement:
    """Find the pose that explains where the known points are seen, outliers left out (Levenberg-Marquardt).

    Parameters
    ----------
    points : (n, 3) array, known places, tracker frame, m; at least six, not all on a line
    pixels : (n, 2) array, where each is seen
    lens : Intrinsics
    starts : sequence of (4, 4) arrays, rough poses; the one that ends best counts
    settings : CalibrationSettings

    Raises
    ------
    DataError
        A pixel is missing (NaN).
    DegenerateError
        The points do not determine the pose: they are fewer than six or on a line, or there is no start.
    """
    fewest = settings.fewest_points
    if len(points) < fewest:
        raise DegenerateError(f"a camera's place needs at least {fewest} known points; got {len(points)}.")
    if not len(starts):
        raise DegenerateError("these known points determine no place of the camera: do they lie on a line?")
    if not np.isfinite(pixels).all():
        raise DataError("a pixel of a known point is missing (NaN); leave out what was not seen.")
    vectors = [np.concatenate([se3.rotvec_from_matrix(T[:3, :3]), T[:3, 3]]) for T in starts]
    fits = [_fit(points, pixels, lens, x, method="trf", loss="soft_l1") for x in vectors]
    best = min(fits, key=lambda fit: float(fit.cost))
    length = np.linalg.norm(best.fun.reshape(-1, 2), axis=1)
    scale = min(settings.outlier * MAD_TO_STD * float(np.median(length)), settings.outlier_width * lens.width)
    used = length <= max(settings.outlier_px, scale)
    if used.sum() < max(fewest, len(points) / 2):
        cause = f"only {used.sum()} of {len(points)} known points agree with one place of the camera."
        raise DegenerateError(cause, hint="Check that each is named right, and that their places are in metres.")
    last = _fit(points[used], pixels[used], lens, best.x, method="lm")
    spread = float(last.fun @ last.fun) / max(len(last.fun) - POSE, 1)
    covariance = _pose_covariance(spread * np.linalg.inv(last.jac.T @ last.jac), last.x)
    return Placement(_pose(last.x), covariance, pixels - _project(points, last.x, lens)[0], used)


def _fit(points: FloatArray, pixels: FloatArray, lens: Intrinsics, start: FloatArray, **options: str) -> Any:
    if not np.isfinite(_project(points, start, lens)[0]).all():
        raise DegenerateError("a known point lies in the plane of the lens; the rough place cannot be right.")
    return least_squares(
        lambda x: (_project(points, x, lens)[0] - pixels).ravel(),
        start,
        lambda x: _project(points, x, lens)[1][:, :POSE],
        x_scale="jac",
        **options,
    )


def _pose_covariance(covariance: FloatArray, x: FloatArray) -> FloatArray:
    """Covariance `(6, 6)` of the camera's position and rotation vector, tracker axes, from that of `x`: rvec, tvec."""
    J_left = np.linalg.inv(se3.left_jacobian_inverse(x[:3]))
    R_tracker_camera = se3.matrix_from_rotvec(x[:3]).T
    # T' = exp(xi) T: the turn is J dr, the shift dt - turn x t; in tracker axes the camera moves by the opposite.
    change = np.block([[np.cross(x[3:, None], J_left, axis=0), np.eye(3)], [J_left, np.zeros((3, 3))]])
    A = -np.kron(np.eye(2), R_tracker_camera) @ change
    return np.asarray(A @ covariance @ A.T)


@dataclass(frozen=True, eq=False)
class Bundle:
    """A camera after lens and pose were solved together."""

    intrinsics: Intrinsics
    placement: Placement  # the pose; its covariance now holds what the lens leaves open
    corner_rms_px: float  # reprojection error of the boards


def adjust(
    calibration: LensCalibration,
    board: Chessboard,
    points: FloatArray,
    pixels: FloatArray,
    placement: Placement,
    settings: CalibrationSettings = DEFAULT.calibration,
) -> Bundle:
    """Solve for lens, board poses and camera pose together (bundle adjustment).

    An error of the focal length of a thousandth moves a camera by half a millimetre; known points, which have depth,
    determine the focal length better than flat boards do.

    Parameters
    ----------
    calibration : LensCalibration, the lens from the boards alone, and their corners
    board : Chessboard
    points, pixels : (n, 3) and (n, 2) arrays, known points (m) and where they are seen
    placement : Placement, the pose with the lens held; its outliers stay out
    settings : CalibrationSettings
    """
    lens, T, used = calibration.intrinsics, placement.T_camera_tracker, placement.used
    noise = [max(rms / np.sqrt(2.0), settings.least_noise_px) for rms in (placement.rms_px, calibration.rms_px)]
    sets = [(points[used], pixels[used], noise[0])]
    sets += [(board.points, corners, noise[1]) for corners in calibration.corners]
    K = lens.matrix
    own = [[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], lens.distortion, se3.rotvec_from_matrix(T[:3, :3]), T[:3, 3]]
    start = np.concatenate([*own, *(pose.ravel() for pose in calibration.poses)])
    free = np.ones(len(start), dtype=bool)
    free[LENS - 1] = lens.distortion[4] != 0.0  # k3 stays out where the boards did not ask for it
    problem = _Problem(lens, tuple(sets), free)
    fit: Any = least_squares(problem.residuals, start, problem.jacobian, method="lm", x_scale="jac")
    spread = max(float(fit.fun @ fit.fun) / max(fit.fun.size - free.sum(), 1), 1e-6)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = spread * np.linalg.pinv(fit.jac[:, free].T @ fit.jac[:, free], hermitian=True)
    own_pose = slice(LENS, LENS + POSE)
    adjusted, x = problem.lens_of(fit.x), fit.x[own_pose]
    residuals = pixels - _project(points, x, adjusted)[0]
    placed = Placement(_pose(x), _pose_covariance(covariance[own_pose, own_pose], x), residuals, used)
    corners = fit.fun[2 * int(used.sum()) :] * noise[1]
    return Bundle(adjusted, placed, float(np.sqrt(2.0 * np.mean(corners**2))))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least squares over the lens, the camera's pose, then each board's pose."""

    start: Intrinsics
    sets: tuple[tuple[FloatArray, FloatArray, float], ...]  # points, pixels and noise (px), the known points first
    free: BoolArray

    def lens_of(self, x: FloatArray) -> Intrinsics:
        K = np.array([[x[0], 0.0, x[2]], [0.0, x[1], x[3]], [0.0, 0.0, 1.0]])
        distortion = np.where(self.free[4:LENS], x[4:LENS], self.start.distortion)
        return Intrinsics(self.start.width, self.start.height, K, distortion)

    def residuals(self, x: FloatArray) -> FloatArray:
        lens, poses = self.lens_of(x), x[LENS:].reshape(-1, POSE)
        parts = zip(self.sets, poses, strict=True)
        return np.concatenate([(_project(p, pose, lens)[0] - seen).ravel() / s for (p, seen, s), pose in parts])

    def jacobian(self, x: FloatArray) -> FloatArray:
        lens, poses = self.lens_of(x), x[LENS:].reshape(-1, POSE)
        whole, row = np.zeros((sum(seen.size for _, seen, _ in self.sets), len(x))), 0
        for k, ((points, seen, noise), pose) in enumerate(zip(self.sets, poses, strict=True)):
            J = _project(points, pose, lens)[1] / noise
            rows, at = slice(row, row + seen.size), LENS + POSE * k
            whole[rows, :LENS] = J[:, POSE : POSE + LENS] * self.free[:LENS]
            whole[rows, at : at + POSE] = J[:, :POSE]
            row += seen.size
        return whole
