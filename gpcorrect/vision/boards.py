"""Chessboards in calibration pictures, the lens that follows from them, and the rig file for a folder a camera."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.settings import DEFAULT, CalibrationSettings
from gpcorrect.vision.sources import IMAGES, read_image

# m, sides of squares: no webcam sees finer ones, no sheet holds three of the coarser; beyond, it is another unit.
FINEST, COARSEST = 1e-3, 0.5
PLACE = "place"  # name of the picture of the board where all cameras see it at once


@dataclass(frozen=True)
class Chessboard:
    """A chessboard.

    Parameters
    ----------
    columns, rows : int, inner corners: a usual board of 8 x 8 squares has 7 x 7
    square : float, side of a square, m
    """

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3 or not FINEST <= self.square <= COARSEST:
            raise DataError(
                "a chessboard has at least 3 x 3 inner corners and squares of"
                f" {1e3 * FINEST:g} to {1e3 * COARSEST:g} mm;"
                f" got {self.columns} x {self.rows}, {1e3 * self.square:g} mm.",
                hint="--square is in millimetres, square in a rig file in metres.",
            )

    @property
    def turns_alike(self) -> bool:
        """Whether the board looks the same turned by half."""
        return (self.columns + self.rows) % 2 == 0

    @property
    def points(self) -> FloatArray:
        """Corners `(n, 3)` on the board, m: x along the columns, y along the rows, z = x cross y."""
        j, i = np.mgrid[: self.rows, : self.columns]
        return self.square * np.stack([i, j, np.zeros_like(i)], axis=-1).reshape(-1, 3).astype(np.float64)


def find_corners(image: Image, board: Chessboard) -> FloatArray | None:
    """Find the corners of a chessboard to a fraction of a pixel.

    Parameters
    ----------
    image : (height, width, 3) or (height, width) uint8 array
    board : Chessboard

    Returns
    -------
    (n, 2) array or None
        px, in the order of `board.points`, whose first square is dark; of a board that looks the same turned by half
        maybe from its other end. None when it is not there.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
    if not found:  # slower, and sees boards that are dim, blurred or slanted
        found, corners = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    grid = np.asarray(corners, dtype=np.float64).reshape(board.rows, board.columns, 2)
    nearest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    half = int(np.clip(0.35 * nearest, 2, 7))  # a window that holds no other corner
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    flat = _oriented(grey, grid).reshape(-1, 1, 2).astype(np.float32)
    refined = cv2.cornerSubPix(grey, flat, (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def _oriented(grey: Image, grid: FloatArray) -> FloatArray:
    """Corners `(rows, columns, 2)` seen from the front, such that the square after the first corner is dark."""
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[:, ::-1]
    middles = 0.25 * (grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:])
    u, v = np.moveaxis(np.rint(middles).astype(int), -1, 0)
    levels = grey[np.clip(v, 0, grey.shape[0] - 1), np.clip(u, 0, grey.shape[1] - 1)].astype(np.float64)
    even = np.indices(levels.shape).sum(axis=0) % 2 == 0
    return grid if levels[even].mean() < levels[~even].mean() else grid[::-1, ::-1]


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens, and what it was learned from."""

    intrinsics: Intrinsics
    corners: tuple[FloatArray, ...]  # (n, 2) of the boards that were used, px
    # (2, 3) each, rotation vector (rad) and translation (m) of each board in the camera frame
    poses: tuple[FloatArray, ...]
    rms_px: float  # reprojection error over all corners used
    board_rms_px: FloatArray  # (k,) the same for each board


def calibrate_lens(
    corners: Sequence[FloatArray],
    board: Chessboard,
    size: tuple[int, int],
    settings: CalibrationSettings = DEFAULT.calibration,
) -> LensCalibration:
    """Learn a lens from the corners of a board in several pictures, boards that do not fit left out.

    Parameters
    ----------
    corners : sequence of (n, 2) arrays
        In the order of `board.points`, px; at least three pictures, slanted differently.
    board : Chessboard
    size : (2,) tuple, width and height of the pictures, px
    settings : CalibrationSettings

    Raises
    ------
    DegenerateError
        Fewer than three pictures, or all of them from the same side.
    """
    if len(corners) < settings.fewest_boards:
        raise DegenerateError(
            f"a lens needs the chessboard in at least {settings.fewest_boards} pictures, it was found in "
            f"{len(corners)}.",
            hint="Take 10 to 20, slanted differently, all over the picture; check columns, rows (inner corners).",
        )
    result = _solve(corners, board, size, settings)
    errors = result.board_rms_px
    good = errors <= max(settings.bad_board * float(np.median(errors)), settings.bad_board_px)
    if settings.fewest_boards <= good.sum() < len(corners):
        result = _solve([c for c, g in zip(corners, good, strict=True) if g], board, size, settings)
    focal, middle = result.intrinsics.focal, result.intrinsics.matrix[:2, 2]
    off = np.abs(middle - np.array(size) / 2)
    if not 0.2 * max(size) < focal < 20 * max(size) or not (off < 0.4 * np.array(size)).all():
        cause = f"the pictures do not determine the lens: focal length {focal:.0f} px, middle {np.round(middle)}."
        hint = "Slant the board differently from picture to picture: 20 to 40 degrees, about both axes."
        raise DegenerateError(cause, hint=hint)
    return result


def _solve(
    corners: Sequence[FloatArray], board: Chessboard, size: tuple[int, int], settings: CalibrationSettings
) -> LensCalibration:
    """Calibrate without k3, and with it where enough boards ask for it."""
    plain = _opencv(corners, board, size, cv2.CALIB_FIX_K3)
    if len(corners) < 2 * settings.fewest_boards:
        return plain
    richer = _opencv(corners, board, size, 0)
    gain = 4.0 * sum(map(len, corners)) * np.log(max(plain.rms_px, 1e-12) / max(richer.rms_px, 1e-12))
    return richer if gain > settings.k3_gain and np.isfinite(richer.rms_px) else plain


def _opencv(corners: Sequence[FloatArray], board: Chessboard, size: tuple[int, int], flags: int) -> LensCalibration:
    points = [board.points.astype(np.float32)] * len(corners)
    pixels = [np.asarray(c, dtype=np.float32).reshape(-1, 1, 2) for c in corners]
    rms, K, distortion, rotations, shifts, _, _, each = cv2.calibrateCameraExtended(
        points, pixels, size, None, None, flags=flags
    )
    poses = tuple(np.stack([np.ravel(r), np.ravel(t)]) for r, t in zip(rotations, shifts, strict=True))
    lens = Intrinsics(size[0], size[1], K, np.ravel(distortion)[:5])
    return LensCalibration(lens, tuple(corners), poses, float(rms), np.ravel(each))


def rig_text(folders: Sequence[Path], board: Chessboard, beside: Path) -> str:
    """Return a rig file (TOML) for cameras that each have a folder of pictures of the board.

    The tracker frame is that of the board in the picture `place` of every folder; where no folder has one, in the first
    picture whose name all folders share and in which every camera sees the board.

    Parameters
    ----------
    folders : sequence of Path, one a camera, named as the camera
    board : Chessboard
    beside : Path, folder of the rig file: pictures are named from there

    Raises
    ------
    DataError
        A folder has no pictures, or there is no picture in which all cameras see the board.
    """
    if board.turns_alike:
        cause = f"a board of {board.columns} x {board.rows} inner corners looks the same turned by half."
        raise DataError(cause, hint="Take one even and one odd number, as `gpcorrect vision board` does.")
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        cause = f"cameras are named as their folders, and two of these have one name: {', '.join(names)}."
        raise DataError(cause, hint="Name each folder as its camera.")
    pictures: list[dict[str, Path]] = []
    for folder in folders:
        files = sorted(folder.iterdir()) if folder.is_dir() else []
        pictures.append({file.stem: file for file in files if file.suffix.lower() in IMAGES})
        if not pictures[-1]:
            hint = "Give one folder of pictures of the board a camera."
            raise DataError(f"there are no pictures in {folder}.", hint=hint)
    placed = any(PLACE in one for one in pictures)  # then another picture is of other moments
    shared = {PLACE} if placed else set.intersection(*(set(one) for one in pictures))
    for name in sorted(shared):
        blind = [camera for camera, one in zip(names, pictures, strict=True) if not _shows(one.get(name), board)]
        if not blind:
            break
    else:
        those = f": not {', '.join(blind)}" if placed else ""
        raise DataError(
            f"there is no picture {PLACE if placed else 'of one name'} in which all of {len(folders)} cameras see the "
            f"board{those}.",
            hint="Lay the board where every camera sees it, and save that moment as place.png in each folder.",
        )
    lines = ["[board]", f"columns = {board.columns}", f"rows = {board.rows}", f"square = {board.square}"]
    for folder, one in zip(folders, pictures, strict=True):
        where = Path(os.path.relpath(folder, beside)).as_posix()
        lines += ["", "[[camera]]", f"name = {json.dumps(folder.name)}", f"boards = {json.dumps(where)}"]
        at = json.dumps(f"{where}/{one[name].name}")  # a string of JSON is one of TOML
        lines += [f"board_at = {{picture = {at}, position = [0.0, 0.0, 0.0]}}"]
    return "\n".join(lines) + "\n"


def _shows(picture: Path | None, board: Chessboard) -> bool:
    """Whether there is a picture, and the board in it."""
    return picture is not None and find_corners(read_image(picture), board) is not None
