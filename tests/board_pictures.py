"""Pictures of a chessboard, for tests of the calibration of cameras; no maths of `gpcorrect.vision` is in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.types import FloatArray
from gpcorrect_studies.rendering import Lens, Studio


@dataclass(frozen=True, eq=False)
class Board:
    """A chessboard and where it lies.

    Parameters
    ----------
    columns, rows : int
        Inner corners along its x and y.
    square : float
        Side of a square, m.
    origin : (3,) array
        First inner corner, world frame, m.
    x, y : (3,) arrays
        Unit directions of its columns and rows.
    """

    columns: int
    rows: int
    square: float
    origin: FloatArray
    x: FloatArray
    y: FloatArray

    def corners(self) -> FloatArray:
        """World places `(rows * columns, 3)` of the inner corners, row by row."""
        j, i = np.mgrid[: self.rows, : self.columns]
        steps = self.square * (i[..., None] * self.x + j[..., None] * self.y)
        places: FloatArray = (self.origin + steps).reshape(-1, 3)
        return places

    def colours(self, lens: Lens, d: FloatArray) -> FloatArray:
        """Grey levels `(...)` seen along rays; NaN beside the board.

        Parameters
        ----------
        lens : Lens
        d : (..., 3) array
            Directions of the rays from the lens, of any length.
        """
        normal = np.cross(self.x, self.y)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((self.origin - lens.position) @ normal) / (d @ normal)
        local = lens.position + depth[..., None] * d - self.origin
        a, b = local @ self.x / self.square, local @ self.y / self.square
        dark = (np.floor(a) + np.floor(b)) % 2 == 0
        playing = (a > -1) & (a < self.columns) & (b > -1) & (b < self.rows)
        on_board = (a > -1.7) & (a < self.columns + 0.7) & (b > -1.7) & (b < self.rows + 0.7) & (depth > 0)
        return np.where(on_board, np.where(playing & dark, 30.0, 220.0), np.nan)


def board_picture(studio: Studio, board: Board) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return the picture of a board before the studio's background, three rays a pixel side.

    Parameters
    ----------
    studio : Studio
    board : Board
    """
    left, top, right, bottom = _box(studio.lens, board)
    v, u = np.mgrid[top:bottom, left:right].astype(np.float64)
    d = studio.lens.directions(u, v)
    a_row, a_column = np.gradient(d, axis=(0, 1))  # bent less within a pixel than can be seen
    total, covered = np.zeros(u.shape), np.zeros(u.shape)
    for du in (-1 / 3, 0.0, 1 / 3):
        for dv in (-1 / 3, 0.0, 1 / 3):
            grey = board.colours(studio.lens, d + du * a_column + dv * a_row)
            seen = np.isfinite(grey)
            total += np.where(seen, grey, 0.0) / 9.0
            covered += seen / 9.0
    image = np.array(studio.background)
    patch = image[top:bottom, left:right]
    image[top:bottom, left:right] = patch * (1.0 - covered[..., None]) + total[..., None]
    rng = np.random.default_rng(studio.rng.integers(2**31))
    return Studio(studio.lens, image, studio.light, studio.blur, studio.noise, rng).photograph()


def _box(lens: Lens, board: Board) -> tuple[int, int, int, int]:
    """Pixels that the board can touch, inside the picture."""
    steps = board.square * np.array(
        [a * board.x + b * board.y for a in (-2, board.columns + 1) for b in (-2, board.rows + 1)]
    )
    pixels, size = lens.pixels(board.origin + steps), np.array(lens.size)
    low = np.clip(np.floor(pixels.min(axis=0)) - 2, 0, size - 1).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + 2, low + 1, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])
