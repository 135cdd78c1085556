"""The lens from pictures of a chessboard: OpenCV's calibration, with boards that do not fit left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.chessboard import Chessboard
from gpcorrect.vision.opencv import cv2

__all__ = ["LensCalibration", "calibrate_lens"]

FEWEST_BOARDS = 3
BAD_BOARD = 4.0  # times the median board's error
WORTH = 10.0  # by which twice the log likelihood must rise for k3 (BIC of some thousand corners)


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens, and what it was learned from.

    Parameters
    ----------
    intrinsics : Intrinsics
        The lens.
    corners : tuple of (n, 2) arrays
        Of the boards that were used, px.
    poses : tuple of (2, 3) arrays
        Rotation vector (rad) and translation (m) of each board in the camera frame.
    used : tuple of int
        Indices of the boards that were used.
    rms_px : float
        Reprojection error over all corners used.
    board_rms_px : tuple of float
        The same for each of them.
    """

    intrinsics: Intrinsics
    corners: tuple[FloatArray, ...]
    poses: tuple[FloatArray, ...]
    used: tuple[int, ...]
    rms_px: float
    board_rms_px: tuple[float, ...]


def calibrate_lens(corners: Sequence[FloatArray], board: Chessboard, size: tuple[int, int]) -> LensCalibration:
    """Learn a lens from the corners of a board in several pictures.

    Parameters
    ----------
    corners : sequence of (n, 2) arrays
        In the order of `board.points`, px; at least three pictures, slanted differently.
    board : Chessboard
        The board.
    size : (2,) tuple
        Width and height of the pictures, px.

    Raises
    ------
    DegenerateError
        Fewer than three pictures, or all of them from the same side.
    """
    if len(corners) < FEWEST_BOARDS:
        raise DegenerateError(
            f"a lens needs the chessboard in at least {FEWEST_BOARDS} pictures, it was found in {len(corners)}.",
            hint="Take 10 to 20, slanted differently, all over the picture; check columns, rows (inner corners).",
        )
    kept = list(range(len(corners)))
    result = _solve([corners[i] for i in kept], board, size)
    errors = np.array(result.board_rms_px)
    good = errors <= max(BAD_BOARD * float(np.median(errors)), 0.5)
    if FEWEST_BOARDS <= good.sum() < len(kept):
        kept = [i for i, g in zip(kept, good, strict=True) if g]
        result = _solve([corners[i] for i in kept], board, size)
    _check(result.intrinsics, size)
    return LensCalibration(
        result.intrinsics, result.corners, result.poses, tuple(kept), result.rms_px, result.board_rms_px
    )


def _solve(corners: Sequence[FloatArray], board: Chessboard, size: tuple[int, int]) -> LensCalibration:
    plain = _opencv(corners, board, size, cv2.CALIB_FIX_K3)
    if len(corners) < 2 * FEWEST_BOARDS:
        return plain
    richer = _opencv(corners, board, size, 0)
    n = 2 * sum(map(len, corners))
    gain = 2.0 * n * np.log(max(plain.rms_px, 1e-12) / max(richer.rms_px, 1e-12))
    return richer if gain > WORTH and np.isfinite(richer.rms_px) else plain


def _opencv(corners: Sequence[FloatArray], board: Chessboard, size: tuple[int, int], flags: int) -> LensCalibration:
    points = [board.points.astype(np.float32)] * len(corners)
    pixels = [np.asarray(c, dtype=np.float32).reshape(-1, 1, 2) for c in corners]
    rms, K, distortion, rotations, shifts = cv2.calibrateCamera(points, pixels, size, None, None, flags=flags)
    lens = Intrinsics(size[0], size[1], K, np.ravel(distortion)[:5])
    poses = tuple(np.stack([np.ravel(r), np.ravel(t)]) for r, t in zip(rotations, shifts, strict=True))
    each = [_rms(board, pose, lens, c) for pose, c in zip(poses, corners, strict=True)]
    return LensCalibration(lens, tuple(corners), poses, (), float(rms), tuple(each))


def _rms(board: Chessboard, pose: FloatArray, lens: Intrinsics, corners: FloatArray) -> float:
    seen, _ = cv2.projectPoints(board.points, pose[0], pose[1], lens.matrix, lens.distortion)
    return float(np.sqrt(np.mean(np.sum((seen.reshape(-1, 2) - corners) ** 2, axis=1))))


def _check(lens: Intrinsics, size: tuple[int, int]) -> None:
    middle, focal = lens.matrix[:2, 2], lens.focal
    sane = 0.2 * max(size) < focal < 20 * max(size) and np.all(
        np.abs(middle - np.array(size) / 2) < 0.4 * np.array(size)
    )
    if not sane:
        raise DegenerateError(
            f"the pictures do not determine the lens: focal length {focal:.0f} px, middle {np.round(middle)}.",
            hint="Slant the board differently from picture to picture: 20 to 40 degrees, about both axes.",
        )
