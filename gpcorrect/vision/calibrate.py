"""The recipe of a calibration: lens, rough pose, refined pose, both together, and a report of what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError, GpCorrectError, LogError
from gpcorrect.types import FloatArray, Progress
from gpcorrect.vision.boards import Chessboard, LensCalibration, calibrate_lens, find_corners
from gpcorrect.vision.camera import Camera, Intrinsics
from gpcorrect.vision.files import Rig, RigCamera
from gpcorrect.vision.markers import find_blobs, found_from
from gpcorrect.vision.place import Placement, adjust, poses_from_board, poses_from_points, refine_pose
from gpcorrect.vision.settings import DEFAULT
from gpcorrect.vision.sources import read_image

SETTINGS = DEFAULT.calibration


@dataclass(frozen=True, eq=False)
class CameraReport:
    """One camera's calibration and what is left."""

    camera: Camera  # the result
    # chessboard pictures, used and given
    boards_used: int
    boards_given: int
    without_board: tuple[str, ...]  # pictures in which no board was found
    corner_rms_px: float | None  # reprojection error of the chessboards
    marker_residuals: Mapping[str, FloatArray]  # (2,) each, seen minus projected, px
    outliers: tuple[str, ...]  # markers that contradict the others, left out
    moved: float | None  # distance between rough and refined position, m

    def to_dict(self) -> dict[str, Any]:
        """Return plain values; the position's standard deviation is the length of its three."""
        covariance = self.camera.covariance
        return {
            "name": self.camera.name,
            "focal_px": self.camera.intrinsics.focal,
            "position_m": self.camera.position.tolist(),
            "position_std_mm": None if covariance is None else 1e3 * float(np.sqrt(np.trace(covariance[:3, :3]))),
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
    """All cameras of a rig.

    Parameters
    ----------
    cameras : tuple of CameraReport, one a camera
    board : Chessboard, the chessboard
    """

    cameras: tuple[CameraReport, ...]
    board: Chessboard

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `gpcorrect vision calibrate`."""
        return {"cameras": [camera.to_dict() for camera in self.cameras]}


class _MisplacedError(GpCorrectError):
    """Markers that contradict where the board says that the camera stands."""


def calibrate_rig(rig: Rig, progress: Progress | None = None) -> CalibrationReport:
    """Calibrate every camera of a rig.

    Parameters
    ----------
    rig : Rig
    progress : Progress, optional

    Raises
    ------
    GpCorrectError
        A camera has too few chessboards, its markers do not fit its place, or it has no place at all; the message names
        the camera. Cameras whose markers would fit each other's places are called swapped.
    """
    progress = progress or Progress()
    reports: list[CameraReport] = []
    failed: list[tuple[RigCamera, _MisplacedError]] = []
    for k, row in enumerate(rig.cameras):
        progress.step("cameras", k / len(rig.cameras))
        try:
            reports.append(_calibrated(row, rig))
        except DegenerateError as error:
            raise DegenerateError(f"camera {row.name}: {error.message}", hint=error.hint) from error
        except _MisplacedError as error:
            failed.append((row, error))
    progress.step("cameras", 1.0)
    if not failed:
        return CalibrationReport(tuple(reports), rig.board)
    swapped = [
        f"the markers of {other.name} fit where {row.name} stands"
        for row, _ in failed
        for other, _ in failed
        if other is not row and _fits(replace(row, seen=other.seen, markers_in=other.markers_in), rig)
    ]
    if swapped:
        raise DataError(f"cameras are swapped: {'; '.join(swapped)}.", hint="Exchange their files in the rig file.")
    cause = f"the markers do not fit: {'; '.join(f'camera {row.name}: {error.message}' for row, error in failed)}"
    raise DataError(cause, hint="Check the markers' names and places (metres, tracker frame), and the board's place.")


def _fits(row: RigCamera, rig: Rig) -> bool:
    try:
        _calibrated(row, rig)
    except GpCorrectError:
        return False
    return True


def _calibrated(row: RigCamera, rig: Rig) -> CameraReport:
    if row.lens is None:
        lens, without = _lens(row, rig.board)
        intrinsics, corner_rms, used, given = lens.intrinsics, lens.rms_px, len(lens.corners), len(row.boards)
    else:
        intrinsics, without, corner_rms, used, given = row.lens, (), None, 0, 0
    # First phase: where the board at its known place says that the camera stands.
    at = None if row.board_at is None else row.T_tracker_board
    rough = (
        [] if at is None else poses_from_board(_place_corners(row, rig.board, intrinsics), rig.board, at, intrinsics)
    )
    seen = _markers(row, rig, intrinsics, rough)
    if not seen and not rough:
        hint = "Give board_at or markers in the rig file."
        raise LogError(f"camera {row.name} has no place: neither a board at a known place nor markers.", hint=hint)
    if not seen and rig.board.turns_alike:
        return CameraReport(Camera(row.name, intrinsics, rough[0]), used, given, without, corner_rms, {}, (), None)
    if seen:
        points, pixels = np.array([rig.markers[name] for name in seen]), np.array(list(seen.values()))
        placement = _placed(points, pixels, intrinsics, rough)
    else:  # the corners of the board at its place are known points
        assert at is not None
        points, pixels = rig.board.points @ at[:3, :3].T + at[:3, 3], _place_corners(row, rig.board, intrinsics)
        placement = refine_pose(points, pixels, intrinsics, rough[:1])
    if row.lens is None:
        bundle = adjust(lens, rig.board, points, pixels, placement)
        intrinsics, placement, corner_rms = bundle.intrinsics, bundle.placement, bundle.corner_rms_px
    camera = Camera(row.name, intrinsics, placement.T_camera_tracker, placement.covariance, placement.rms_px)
    moved = min((_apart(T, placement.T_camera_tracker)[0] for T in rough), default=None)
    residuals = dict(zip(seen, placement.residuals, strict=bool(seen)))
    outliers = tuple(name for name, good in zip(seen, placement.used, strict=bool(seen)) if not good)
    return CameraReport(camera, used, given, without, corner_rms, residuals, outliers, moved)


def _lens(row: RigCamera, board: Chessboard) -> tuple[LensCalibration, tuple[str, ...]]:
    """Return the lens from the boards, and the pictures without a board."""
    corners, without, sizes = [], [], set()
    for path in row.boards:
        image = read_image(path)
        sizes.add((image.shape[1], image.shape[0]))
        if len(sizes) > 1:
            raise LogError(f"camera {row.name}: its pictures have different sizes.", path=str(path))
        found = find_corners(image, board)
        if found is None:
            without.append(path.name)
        else:
            corners.append(found)
    if not corners:
        cause = f"no chessboard of {board.columns} x {board.rows} inner corners in any of {len(row.boards)} pictures."
        raise DegenerateError(cause, hint="Check columns and rows in the rig file: inner corners, not squares.")
    return calibrate_lens(corners, board, sizes.pop()), tuple(without)


def _place_corners(row: RigCamera, board: Chessboard, lens: Intrinsics) -> FloatArray:
    """Corners of the board at its known place."""
    assert row.board_at is not None
    image = read_image(row.board_at)
    lens.require_size(image, row.name)
    corners = find_corners(image, board)
    if corners is None:
        raise LogError(
            f"camera {row.name}: no chessboard of {board.columns} x {board.rows} inner corners in the picture of its "
            "place.",
            path=str(row.board_at),
            hint="Take it again: the whole board in the picture, nothing over it.",
        )
    return corners


def _markers(row: RigCamera, rig: Rig, lens: Intrinsics, rough: Sequence[FloatArray]) -> dict[str, FloatArray]:
    """Where the markers are seen: as given, or found in a picture from each rough pose."""
    if row.markers_in is None:
        return dict(row.seen)
    if not rough:
        hint = "Give board_at in the rig file."
        raise LogError(f"camera {row.name}: markers can only be looked for near a rough place.", hint=hint)
    image = read_image(row.markers_in)
    lens.require_size(image, row.name)
    blobs = find_blobs(image)
    tried = [found_from(image, blobs, rig.markers, Camera(row.name, lens, T)) for T in rough]
    found = sorted((one for one in tried if one), key=lambda one: (-int(one[0].used.sum()), one[0].rms_px))
    if not found:
        raise LogError(
            f"camera {row.name}: the markers are not where its rough place puts them.",
            path=str(row.markers_in),
            hint="Check the places of board and markers (metres, tracker frame), or give the markers' pixels.",
        )
    best, seen = found[0]
    for rival, _ in found[1:]:
        if _apart(rival.T_camera_tracker, best.T_camera_tracker)[0] > SETTINGS.same:
            if rival.used.sum() >= best.used.sum() - 1 and rival.rms_px < 2.0 * best.rms_px + 0.5:
                raise LogError(
                    f"camera {row.name}: its markers look the same from two sides; two places of the camera fit.",
                    path=str(row.markers_in),
                    hint="Give the markers' pixels in the rig file, or place one marker differently from the others.",
                )
            break
    return seen


def _placed(points: FloatArray, pixels: FloatArray, lens: Intrinsics, rough: Sequence[FloatArray]) -> Placement:
    """Second phase: the pose from the markers, refused when it contradicts the rough one."""
    alone = poses_from_points(points, pixels, lens) if len(points) >= SETTINGS.fewest_points else []
    try:
        placement = refine_pose(points, pixels, lens, [*rough, *alone])
    except DegenerateError as error:
        raise _MisplacedError(error.message, hint=error.hint) from error
    if placement.rms_px > SETTINGS.bad_rms_px:
        raise _MisplacedError(f"its markers miss their places by {placement.rms_px:.1f} px.")
    if rough:
        away, turned = min(_apart(T, placement.T_camera_tracker) for T in rough)
        if away > SETTINGS.far or turned > SETTINGS.turned:
            raise _MisplacedError(
                f"its markers say that it stands {1e3 * away:.0f} mm and {np.rad2deg(turned):.0f} degrees from where "
                "its board says."
            )
    return placement


def _apart(A: FloatArray, B: FloatArray) -> tuple[float, float]:
    """Distance (m) and angle (rad) between two camera poses."""
    away = np.linalg.norm(se3.invert(A)[:3, 3] - se3.invert(B)[:3, 3])
    return float(away), float(se3.angle(A[:3, :3] @ B[:3, :3].T))
