"""Lens and place at once: every corner of every board, and the known points, agree on one camera.

An error of the focal length of a thousandth moves a camera by half a millimetre; the known points, which have depth,
know the focal length better than flat boards do. So both are solved together, and the covariance of the place holds
what the lens leaves open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from gpcorrect import se3
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.chessboard import Chessboard
from gpcorrect.vision.lens import LensCalibration
from gpcorrect.vision.opencv import cv2
from gpcorrect.vision.place import Placement, pose_covariance

__all__ = ["Bundle", "adjust"]

LEAST_NOISE = 0.01  # px: no corner is taken for better than this
STEP = 6  # numbers of a pose: rotation vector, translation


@dataclass(frozen=True, eq=False)
class Bundle:
    """A camera after both were solved together; see :class:`Placement`, its covariance now with the lens' share."""

    intrinsics: Intrinsics
    placement: Placement
    corner_rms_px: float


def adjust(
    calibration: LensCalibration, board: Chessboard, points: FloatArray, pixels: FloatArray, placement: Placement
) -> Bundle:
    """Solve for lens, board poses and camera place together.

    Parameters
    ----------
    calibration : LensCalibration
        The lens from the boards alone, and their corners.
    board : Chessboard
        The board.
    points, pixels : (n, 3) and (n, 2) arrays
        Known points (m) and where they are seen.
    placement : Placement
        The place with the lens held; its outliers stay out.
    """
    problem = _Problem.of(calibration, board, points[placement.used], pixels[placement.used], placement)
    fit: Any = least_squares(problem.residuals, problem.start, problem.jacobian, method="lm", x_scale="jac")
    lens, place = problem.lens(fit.x), fit.x[9 : 9 + STEP]
    spread = max(float(fit.fun @ fit.fun) / max(fit.fun.size - problem.free.sum(), 1), 1e-6)
    free = problem.free
    covariance = np.zeros((len(free), len(free)))
    J = fit.jac[:, free]
    covariance[np.ix_(free, free)] = spread * np.linalg.pinv(J.T @ J, hermitian=True)
    seen, _ = cv2.projectPoints(points, place[:3], place[3:], lens.matrix, lens.distortion)
    placed = Placement(
        se3.pose(se3.matrix_from_rotvec(place[:3]), place[3:]),
        pose_covariance(covariance[9 : 9 + STEP, 9 : 9 + STEP], place),
        pixels - seen.reshape(-1, 2),
        placement.used,
    )
    corners = fit.fun[2 * int(placement.used.sum()) :] * problem.corner_noise
    return Bundle(lens, placed, float(np.sqrt(2.0 * np.mean(corners**2))))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Parameters: fx, fy, cx, cy, five of distortion, the camera's pose, then each board's."""

    size: tuple[int, int]
    sets: Sequence[tuple[FloatArray, FloatArray, float]]  # points, pixels and noise (px), the known points first
    start: FloatArray
    free: Any
    corner_noise: float

    @classmethod
    def of(
        cls, calibration: LensCalibration, board: Chessboard, points: FloatArray, pixels: FloatArray, place: Placement
    ) -> _Problem:
        lens = calibration.intrinsics
        K, T = lens.matrix, place.T_camera_tracker
        corner_noise = max(calibration.rms_px / np.sqrt(2.0), LEAST_NOISE)
        point_noise = max(place.rms_px / np.sqrt(2.0), LEAST_NOISE)
        sets = [(points, pixels, point_noise)]
        sets += [(board.points, corners, corner_noise) for corners in calibration.corners]
        start = np.concatenate(
            [
                [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
                lens.distortion,
                se3.rotvec_from_matrix(T[:3, :3]),
                T[:3, 3],
                *(pose.ravel() for pose in calibration.poses),
            ]
        )
        free = np.ones(len(start), dtype=bool)
        free[8] = lens.distortion[4] != 0.0  # k3 stays out where the boards did not ask for it
        return cls((lens.width, lens.height), tuple(sets), start, free, corner_noise)

    def lens(self, x: FloatArray) -> Intrinsics:
        K = np.array([[x[0], 0.0, x[2]], [0.0, x[1], x[3]], [0.0, 0.0, 1.0]])
        return Intrinsics(self.size[0], self.size[1], K, np.where(self.free[4:9], x[4:9], self.start[4:9]))

    def residuals(self, x: FloatArray) -> FloatArray:
        lens = self.lens(x)
        parts = []
        for k, (points, pixels, noise) in enumerate(self.sets):
            pose = x[9 + STEP * k : 9 + STEP * (k + 1)]
            seen, _ = cv2.projectPoints(points, pose[:3], pose[3:], lens.matrix, lens.distortion)
            parts.append((seen.reshape(-1, 2) - pixels).ravel() / noise)
        return np.concatenate(parts)

    def jacobian(self, x: FloatArray) -> FloatArray:
        lens = self.lens(x)
        blocks = np.zeros((sum(2 * len(points) for points, _, _ in self.sets), len(x)))
        row = 0
        for k, (points, _, noise) in enumerate(self.sets):
            at = 9 + STEP * k
            _, J = cv2.projectPoints(points, x[at : at + 3], x[at + 3 : at + 6], lens.matrix, lens.distortion)
            rows = slice(row, row + 2 * len(points))
            blocks[rows, :9] = J[:, 6:15] / noise
            blocks[rows, at : at + STEP] = J[:, :STEP] / noise
            row += 2 * len(points)
        blocks[:, :9] *= self.free[:9]
        return blocks
