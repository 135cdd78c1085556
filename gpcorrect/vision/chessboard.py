"""Chessboards: their corners in a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect.vision.opencv import Image, cv2

__all__ = ["Chessboard", "find_corners"]


@dataclass(frozen=True)
class Chessboard:
    """A chessboard.

    Parameters
    ----------
    columns, rows : int
        Inner corners: a usual board of 8 x 8 squares has 7 x 7.
    square : float
        Side of a square, m.
    """

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3 or not self.square > 0:
            raise DataError(
                f"a chessboard has at least 3 x 3 inner corners and squares of some size; got {self.columns} x "
                f"{self.rows}, {self.square} m."
            )

    @property
    def points(self) -> FloatArray:
        """Corners `(n, 3)` on the board, m: x along the columns, y along the rows, z = x cross y."""
        j, i = np.mgrid[: self.rows, : self.columns]
        flat: FloatArray = self.square * np.stack([i, j, np.zeros_like(i)], axis=-1).reshape(-1, 3).astype(np.float64)
        return flat


def find_corners(image: Image, board: Chessboard) -> FloatArray | None:
    """Sub-pixel corners `(n, 2)` in the order of `board.points`, or None when the board is not there.

    The order may be turned by half: a board looks the same from its other end.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
    if not found:  # slower, and sees boards that are dim, blurred or slanted
        found, corners = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    return _polished(grey, np.asarray(corners, dtype=np.float64).reshape(-1, 2), board) if found else None


def _polished(grey: Image, corners: FloatArray, board: Chessboard) -> FloatArray:
    """Refine each corner by the gradients around it, in a window that holds no other corner."""
    grid = corners.reshape(board.rows, board.columns, 2)
    nearest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    half = int(np.clip(0.35 * nearest, 2, 7))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    flat = np.ascontiguousarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    done = cv2.cornerSubPix(grey, flat, (half, half), (-1, -1), criteria)
    return np.asarray(done, dtype=np.float64).reshape(-1, 2)
