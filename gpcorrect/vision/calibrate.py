"""The recipe of a calibration: lens, rough place, refined place, both together, and a report of what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError, GpCorrectError, LogError
from gpcorrect.types import FloatArray, Progress
from gpcorrect.vision.bundle import adjust
from gpcorrect.vision.camera import Camera, Intrinsics
from gpcorrect.vision.chessboard import Chessboard, find_corners
from gpcorrect.vision.lens import LensCalibration, calibrate_lens
from gpcorrect.vision.markers import find_markers
from gpcorrect.vision.opencv import Image
from gpcorrect.vision.place import FEWEST_POINTS, Placement, poses_from_board, poses_from_points, refine_pose
from gpcorrect.vision.rig_file import Rig, RigCamera
from gpcorrect.vision.sources import read_image

__all__ = ["CalibrationReport", "CameraReport", "calibrate_rig"]

FAR = 0.15  # m by which the refined place may differ from the rough one
TURNED = np.deg2rad(25.0)
BAD_RMS = 5.0  # px: markers that are seen this far from where they should be are not these markers
SAME = 0.01  # m between two places that are one
ROUNDS = 3  # of looking for markers and refining


@dataclass(frozen=True, eq=False)
class CameraReport:
    """One camera's calibration and what is left.

    Parameters
    ----------
    camera : Camera
        The result.
    boards_used, boards_given : int
        Chessboard pictures.
    without_board : tuple of str
        Pictures in which no board was found.
    corner_rms_px : float or None
        Reprojection error of the chessboards.
    marker_residuals : mapping of marker to (2,) array
        Seen minus projected, px.
    outliers : tuple of str
        Markers that contradict the others, left out.
    moved : float or None
        Distance between rough and refined place, m.
    """

    camera: Camera
    boards_used: int
    boards_given: int
    without_board: tuple[str, ...]
    corner_rms_px: float | None
    marker_residuals: Mapping[str, FloatArray]
    outliers: tuple[str, ...]
    moved: float | None

    @property
    def position_std(self) -> float | None:
        """Standard deviation of the camera's position (length of the three), m."""
        covariance = self.camera.covariance
        return None if covariance is None else float(np.sqrt(np.trace(covariance[:3, :3])))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        std = self.position_std
        return {
            "name": self.camera.name,
            "focal_px": self.camera.intrinsics.focal,
            "position_m": self.camera.position.tolist(),
            "position_std_mm": None if std is None else 1e3 * std,
            "boards_used": self.boards_used,
            "boards_given": self.boards_given,
            "without_board": list(self.without_board),
            "corner_rms_px": self.corner_rms_px,
            "marker_rms_px": self.camera.rms_px,
            "markers": len(self.marker_residuals) - len(self.outliers),
            "marker_outliers": list(self.outliers),
            "moved_from_rough_mm": None if self.moved is None else 1e3 * self.moved,
        }


@dataclass(frozen=True, eq=False)
class CalibrationReport:
    """All cameras of a rig."""

    cameras: tuple[CameraReport, ...]
    board: Chessboard

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `gpcorrect vision calibrate`."""
        return {"cameras": [camera.to_dict() for camera in self.cameras]}


def calibrate_rig(rig: Rig, progress: Progress | None = None) -> CalibrationReport:
    """Calibrate every camera of a rig.

    Raises
    ------
    GpCorrectError
        A camera has too few chessboards, its markers do not fit its place, or it has no place at all; the message names
        the camera. Cameras whose markers would fit each other's places are called swapped.
    """
    progress = progress or Progress()
    reports, failed = [], []
    for k, row in enumerate(rig.cameras):
        progress.step("cameras", k / len(rig.cameras))
        try:
            reports.append(_calibrated(row, rig))
        except DegenerateError as error:
            raise DegenerateError(f"camera {row.name}: {error.message}", hint=error.hint) from error
        except _MisplacedError as error:
            failed.append((row, error))
    progress.step("cameras", 1.0)
    if failed:
        _refuse(failed, rig)
    return CalibrationReport(tuple(reports), rig.board)


class _MisplacedError(GpCorrectError):
    """Markers that contradict where the board says that the camera stands."""


def _calibrated(row: RigCamera, rig: Rig) -> CameraReport:
    lens, given, without = _lens(row, rig.board)
    intrinsics = row.lens if lens is None else lens.intrinsics
    assert intrinsics is not None
    rough = _rough(row, rig.board, intrinsics)
    seen = _markers(row, rig, intrinsics, rough)
    corner_rms = None if lens is None else lens.rms_px
    used = 0 if lens is None else len(lens.corners)
    if not seen:
        if not rough:
            raise LogError(
                f"camera {row.name} has no place: neither a board at a known place nor markers.",
                hint="Give board_at or markers in the rig file.",
            )
        camera = Camera(row.name, intrinsics, rough[0])
        return CameraReport(camera, used, given, without, corner_rms, {}, (), None)
    points, pixels = np.array([rig.markers[name] for name in seen]), np.array(list(seen.values()))
    placement = _placed(row, points, pixels, intrinsics, rough)
    if lens is not None:
        bundle = adjust(lens, rig.board, points, pixels, placement)
        intrinsics, placement, corner_rms = bundle.intrinsics, bundle.placement, bundle.corner_rms_px
    camera = Camera(row.name, intrinsics, placement.T_camera_tracker, placement.covariance, placement.rms_px)
    moved = min((_apart(T, placement.T_camera_tracker)[0] for T in rough), default=None)
    residuals = dict(zip(seen, placement.residuals, strict=True))
    outliers = tuple(name for name, good in zip(seen, placement.used, strict=True) if not good)
    return CameraReport(camera, used, given, without, corner_rms, residuals, outliers, moved)


def _lens(row: RigCamera, board: Chessboard) -> tuple[LensCalibration | None, int, tuple[str, ...]]:
    """Return the lens from the boards, how many pictures there were, and those without a board."""
    if row.lens is not None:
        return None, 0, ()
    corners, without, size = [], [], None
    for path in row.boards:
        image = read_image(path)
        if size is not None and size != (image.shape[1], image.shape[0]):
            raise LogError(f"camera {row.name}: its pictures have different sizes.", path=str(path))
        size = (image.shape[1], image.shape[0])
        found = find_corners(image, board)
        if found is None:
            without.append(path.name)
        else:
            corners.append(found)
    assert size is not None
    try:
        lens = calibrate_lens(corners, board, size)
    except DegenerateError as error:
        if corners:
            raise
        raise DegenerateError(
            f"no chessboard of {board.columns} x {board.rows} inner corners in any of {len(row.boards)} pictures.",
            hint="Check columns and rows in the rig file: inner corners, not squares.",
        ) from error
    return lens, len(row.boards), tuple(without)


def _rough(row: RigCamera, board: Chessboard, lens: Intrinsics) -> list[FloatArray]:
    """First phase: where the board at its known place says that the camera stands."""
    if row.board_at is None or row.T_tracker_board is None:
        return []
    corners = find_corners(read_image(row.board_at), board)
    if corners is None:
        raise LogError(
            f"camera {row.name}: no chessboard of {board.columns} x {board.rows} inner corners in the picture of its "
            "place.",
            path=str(row.board_at),
            hint="Take it again: the whole board in the picture, nothing over it.",
        )
    return poses_from_board(corners, board, row.T_tracker_board, lens)


def _markers(row: RigCamera, rig: Rig, lens: Intrinsics, rough: Sequence[FloatArray]) -> dict[str, FloatArray]:
    """Where the markers are seen: as told, or found in a picture, looking again after each refinement."""
    if row.markers_in is None:
        return dict(row.seen)
    if not rough:
        raise LogError(
            f"camera {row.name}: markers can only be looked for near a rough place.",
            hint="Give board_at in the rig file.",
        )
    image = read_image(row.markers_in)
    found = [one for one in (_looked_up(image, rig, Camera(row.name, lens, T)) for T in rough) if one is not None]
    found.sort(key=lambda one: (-int(one[0].used.sum()), one[0].rms_px))
    if not found:
        raise LogError(
            f"camera {row.name}: the markers are not where its rough place puts them.",
            path=str(row.markers_in),
            hint="Check the places of board and markers (metres, tracker frame), or give the markers' pixels.",
        )
    rivals = [p for p, _ in found[1:] if _apart(p.T_camera_tracker, found[0][0].T_camera_tracker)[0] > SAME]
    if rivals and _as_good(rivals[0], found[0][0]):
        raise LogError(
            f"camera {row.name}: its markers look the same from two sides; two places of the camera fit.",
            path=str(row.markers_in),
            hint="Give the markers' pixels in the rig file, or place one marker differently from the others.",
        )
    return found[0][1]


def _looked_up(image: Image, rig: Rig, camera: Camera) -> tuple[Placement, dict[str, FloatArray]] | None:
    """Look for the markers and refine the place in turns; None when they do not settle."""
    points = np.array(list(rig.markers.values()))
    placed, found = None, {}
    for _ in range(ROUNDS):
        found = find_markers(image, dict(zip(rig.markers, camera.project(points), strict=True)))
        if len(found) < FEWEST_POINTS:
            return None
        known = np.array([rig.markers[name] for name in found])
        try:
            placed = refine_pose(known, np.array(list(found.values())), camera.intrinsics, [camera.T_camera_tracker])
        except DegenerateError:
            return None
        camera = replace(camera, T_camera_tracker=placed.T_camera_tracker)
    return None if placed is None else (placed, found)


def _as_good(rival: Placement, best: Placement) -> bool:
    return rival.used.sum() >= best.used.sum() - 1 and rival.rms_px < 2.0 * best.rms_px + 0.5


def _placed(
    row: RigCamera, points: FloatArray, pixels: FloatArray, lens: Intrinsics, rough: Sequence[FloatArray]
) -> Placement:
    starts = [*rough, *(poses_from_points(points, pixels, lens) if len(points) >= FEWEST_POINTS else [])]
    try:
        placement = refine_pose(points, pixels, lens, starts)
    except DegenerateError as error:
        raise _MisplacedError(error.message, hint=error.hint) from error
    if placement.rms_px > BAD_RMS:
        raise _MisplacedError(f"its markers miss their places by {placement.rms_px:.1f} px.")
    if rough:
        away, turned = min(_apart(T, placement.T_camera_tracker) for T in rough)
        if away > FAR or turned > TURNED:
            raise _MisplacedError(
                f"its markers say that it stands {1e3 * away:.0f} mm and {np.rad2deg(turned):.0f} degrees from where "
                "its board says."
            )
    return placement


def _apart(A: FloatArray, B: FloatArray) -> tuple[float, float]:
    """Distance (m) and angle (rad) between two camera places."""
    away = np.linalg.norm(se3.invert(A)[:3, 3] - se3.invert(B)[:3, 3])
    return float(away), float(se3.angle(A[:3, :3] @ B[:3, :3].T))


def _refuse(failed: Sequence[tuple[RigCamera, _MisplacedError]], rig: Rig) -> None:
    """Say which cameras' markers do not fit, and whether they fit another's place."""
    swapped = []
    for row, _ in failed:
        for other, _ in failed:
            if other is not row and _fits(replace(row, seen=other.seen, markers_in=other.markers_in), rig):
                swapped.append(f"the markers of {other.name} fit where {row.name} stands")
    names = "; ".join(f"camera {row.name}: {error.message}" for row, error in failed)
    if swapped:
        raise DataError(f"cameras are swapped: {'; '.join(swapped)}.", hint="Exchange their files in the rig file.")
    raise DataError(
        f"the markers do not fit: {names}",
        hint="Check the markers' names and places (metres, tracker frame), and the board's place.",
    )


def _fits(row: RigCamera, rig: Rig) -> bool:
    try:
        _calibrated(row, rig)
    except GpCorrectError:
        return False
    return True
