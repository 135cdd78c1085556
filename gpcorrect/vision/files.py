"""The files that users write: calibrations, targets and rigs, as JSON or TOML, checked when read."""

from __future__ import annotations

import csv
import glob
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gpcorrect import se3
from gpcorrect.atomic import write_file
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect.vision.boards import Chessboard
from gpcorrect.vision.camera import Camera, Intrinsics
from gpcorrect.vision.sources import IMAGES
from gpcorrect.vision.target import BallSpec, Target, colour_of

FORMAT = "gpcorrect cameras 1"  # of the calibration file
HINTS = {
    "calibration file": "docs/vision.md shows a calibration file; `gpcorrect vision calibrate` writes one.",
    "target file": "docs/vision.md shows a target file.",
    "rig file": "docs/vision.md shows a rig file.",
}
Row3 = tuple[float, float, float]
Row4 = tuple[float, float, float, float]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


Model = TypeVar("Model", bound=_Strict)


class _Lens(_Strict):
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    matrix: tuple[Row3, Row3, Row3]
    distortion: Annotated[tuple[float, ...], Field(max_length=5)] = ()

    def intrinsics(self) -> Intrinsics:
        return Intrinsics(self.width, self.height, np.array(self.matrix), np.array(self.distortion))


class _Camera(_Lens):
    name: str = Field(min_length=1)
    T_camera_tracker: tuple[Row4, Row4, Row4, Row4] | None = None
    rvec: Row3 | None = None
    tvec: Row3 | None = None
    covariance: tuple[tuple[float, ...], ...] | None = None
    rms_px: float | None = None
    delay: Annotated[float, Field(gt=-1, lt=1)] | None = None
    readout: Annotated[float, Field(ge=0, lt=0.2)] = 0.0

    @model_validator(mode="after")
    def _placed_once(self) -> _Camera:
        by_vectors = self.rvec is not None and self.tvec is not None
        if by_vectors == (self.T_camera_tracker is not None):
            raise ValueError("needs its place once: T_camera_tracker, or rvec and tvec")
        return self

    def camera(self) -> Camera:
        if self.T_camera_tracker is None:
            T = se3.pose(se3.matrix_from_rotvec(np.array(self.rvec)), np.array(self.tvec))
        else:
            T = np.array(self.T_camera_tracker)
        covariance = None if self.covariance is None else np.array(self.covariance)
        return Camera(self.name, self.intrinsics(), T, covariance, self.rms_px, self.delay, self.readout)


class _CameraFile(_Strict):
    format: str = FORMAT
    cameras: Annotated[tuple[_Camera, ...], Field(min_length=1)]


class _Ball(_Strict):
    name: str = Field(min_length=1, pattern=r"^\w+$")
    color: str | tuple[int, int, int] | None = None
    hue: float | None = None
    hue_tolerance: Annotated[float, Field(gt=0, le=90)] | None = None
    least_saturation: Annotated[float, Field(ge=0, lt=1)] | None = None
    least_value: Annotated[float, Field(ge=0, lt=1)] | None = None
    place: Row3 = (0.0, 0.0, 0.0)
    radius: Annotated[float, Field(gt=0)] | None = None

    def spec(self) -> BallSpec:
        given = {"tolerance": self.hue_tolerance, "saturation": self.least_saturation, "value": self.least_value}
        changes = {name: value for name, value in given.items() if value is not None}
        colour = colour_of(self.hue if self.hue is not None else self.color if self.color is not None else self.name)
        return BallSpec(self.name, replace(colour, **changes), self.place, self.radius)


class _TargetFile(_Strict):
    ball: Annotated[tuple[_Ball, ...], Field(min_length=1)]


class _Board(_Strict):
    columns: int
    rows: int
    square: float


class _BoardAt(_Strict):
    picture: str
    matrix: tuple[Row4, Row4, Row4, Row4] | None = None
    position: Row3 | None = None
    rotvec: Row3 = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _placed_once(self) -> _BoardAt:
        if (self.matrix is None) == (self.position is None):
            raise ValueError("needs the board's place once: matrix (4 x 4), or position and rotvec")
        return self

    def pose(self) -> FloatArray:
        if self.matrix is not None:
            return np.array(self.matrix)
        return se3.pose(se3.matrix_from_rotvec(np.array(self.rotvec)), np.array(self.position))


class _RigCamera(_Strict):
    name: str = Field(min_length=1)
    boards: str | tuple[str, ...] = ()
    lens: _Lens | None = None
    board_at: _BoardAt | None = None
    markers: str | dict[str, tuple[float, float]] | None = None


class _RigFile(_Strict):
    board: _Board
    markers: dict[str, Row3] = Field(default_factory=dict)
    camera: Annotated[tuple[_RigCamera, ...], Field(min_length=1)]


def _read(path: str | Path, model: type[Model], what: str) -> Model:
    """Read and check a JSON or TOML file."""
    try:
        text = Path(path).read_text(encoding="utf-8")
        values = json.loads(text) if text.lstrip().startswith("{") else tomllib.loads(text)
    except OSError as error:
        raise DataError(f"cannot read the {what} {path}: {error.strerror}.", hint=HINTS[what]) from error
    except ValueError as error:  # what tomllib, json and a wrong encoding raise
        raise DataError(f"{path} is no {what}: {error}.", hint=HINTS[what]) from error
    try:
        return model.model_validate(values)
    except ValidationError as error:
        wrong = "; ".join(
            f"{'.'.join(map(str, e['loc']))}: {e['msg'].removeprefix('Value error, ')}" for e in error.errors()[:5]
        )
        raise DataError(f"{path} is no {what}: {wrong}.", hint=HINTS[what]) from error


def _check_names(names: Sequence[str], path: str | Path) -> None:
    if len(set(names)) < len(names):
        raise DataError(f"{path}: two cameras have the same name: {', '.join(names)}.", hint="Name each once.")


def read_cameras(path: str | Path) -> tuple[Camera, ...]:
    """Read a calibration file.

    Parameters
    ----------
    path : str or Path, JSON, or TOML by its ending

    Raises
    ------
    DataError
        It cannot be read, a key is unknown or missing, a place is no rigid motion, or two cameras share a name.
    """
    rows = _read(path, _CameraFile, "calibration file").cameras
    _check_names([row.name for row in rows], path)
    try:
        return tuple(row.camera() for row in rows)
    except ValueError as error:
        raise DataError(f"{path} is no calibration file: {error}", hint=HINTS["calibration file"]) from error


def write_cameras(cameras: Sequence[Camera], path: str | Path) -> None:
    """Write a calibration file as JSON, whole or not at all.

    Parameters
    ----------
    cameras : sequence of Camera
    path : str or Path, replaced when there
    """
    rows = [
        {
            "name": c.name,
            "width": c.intrinsics.width,
            "height": c.intrinsics.height,
            "matrix": c.intrinsics.matrix.tolist(),
            "distortion": c.intrinsics.distortion.tolist(),
            "T_camera_tracker": c.T_camera_tracker.tolist(),
            **({} if c.covariance is None else {"covariance": c.covariance.tolist()}),
            **({} if c.rms_px is None else {"rms_px": c.rms_px}),
            **({} if c.delay is None else {"delay": c.delay}),
            **({"readout": c.readout} if c.readout else {}),
        }
        for c in cameras
    ]
    write_file(path, json.dumps({"format": FORMAT, "cameras": rows}, indent=1))


def read_target(path: str | Path) -> Target:
    """Read a target file: a `[[ball]]` table for each ball.

    Parameters
    ----------
    path : str or Path, JSON, or TOML by its ending

    Raises
    ------
    DataError
        It cannot be read, a key is unknown or missing, a value has the wrong type or range, or the balls determine
        nothing.
    """
    return Target(tuple(ball.spec() for ball in _read(path, _TargetFile, "target file").ball))


@dataclass(frozen=True, eq=False)
class RigCamera:
    """One camera's calibration pictures."""

    name: str  # of the camera
    boards: tuple[Path, ...] = ()  # pictures of the chessboard, anywhere
    lens: Intrinsics | None = None  # a lens that is known already; boards are then not needed
    board_at: Path | None = None  # the picture of the board at its known place
    T_tracker_board: FloatArray | None = None  # (4, 4) that place, roughly
    # (2,) each, where markers appear, px
    seen: Mapping[str, FloatArray] = field(default_factory=dict)
    markers_in: Path | None = None  # a picture in which the markers are to be found


@dataclass(frozen=True, eq=False)
class Rig:
    """What a set of cameras is calibrated from.

    Parameters
    ----------
    board : Chessboard, the chessboard of all pictures
    cameras : tuple of RigCamera, one a camera
    markers : mapping of marker to (3,) array, places in the tracker frame, m
    """

    board: Chessboard
    cameras: tuple[RigCamera, ...]
    markers: Mapping[str, FloatArray]


def read_rig(path: str | Path) -> Rig:
    """Read a rig file.

    Parameters
    ----------
    path : str or Path, TOML or JSON; names of pictures in it are relative to its own folder

    Raises
    ------
    DataError
        It cannot be read, a key is unknown or missing, a picture is not there, or a camera sees a marker that has no
        place.
    """
    read, folder = _read(path, _RigFile, "rig file"), Path(path).parent
    _check_names([camera.name for camera in read.camera], path)
    markers = {name: np.array(place) for name, place in read.markers.items()}
    cameras = tuple(_rig_camera(row, folder) for row in read.camera)
    for camera in cameras:
        if camera.lens is None and not camera.boards:
            cause = f"{path}: camera {camera.name} has neither a lens nor pictures of the chessboard."
            raise DataError(cause, hint=HINTS["rig file"])
        if unknown := sorted(set(camera.seen) - set(markers)):
            cause = f"{path}: camera {camera.name} sees markers without a place: {', '.join(unknown)}."
            raise DataError(cause, hint="Give each marker's place in [markers], or name them alike.")
    return Rig(Chessboard(read.board.columns, read.board.rows, read.board.square), cameras, markers)


def _rig_camera(row: _RigCamera, folder: Path) -> RigCamera:
    patterns = (row.boards,) if isinstance(row.boards, str) else row.boards
    boards: list[Path] = []
    for pattern in patterns:  # of files, or the name of a folder of images
        whole = folder / pattern
        files = whole.iterdir() if whole.is_dir() else (folder / name for name in glob.glob(pattern, root_dir=folder))
        images = sorted(file for file in files if file.suffix.lower() in IMAGES and not file.name.startswith("."))
        if not images:
            raise DataError(f"there are no pictures {whole}.", hint=HINTS["rig file"])
        boards += images
    at = row.board_at
    board_at, place = (None, None) if at is None else (_file(folder, at.picture), at.pose())
    lens = None if row.lens is None else row.lens.intrinsics()
    return RigCamera(row.name, tuple(boards), lens, board_at, place, *_markers(row.markers, folder))


def _file(folder: Path, name: str) -> Path:
    if not (folder / name).is_file():
        raise DataError(f"there is no picture {folder / name}.", hint=HINTS["rig file"])
    return folder / name


def _markers(
    given: str | Mapping[str, tuple[float, float]] | None, folder: Path
) -> tuple[dict[str, FloatArray], Path | None]:
    """Pixels of markers, from the rig file itself or a table (marker, u, v), or the picture that shows them."""
    if given is None:
        return {}, None
    if not isinstance(given, str):
        return {name: np.array(pixel) for name, pixel in given.items()}, None
    path = _file(folder, given)
    if path.suffix.lower() in IMAGES:
        return {}, path
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [[cell.strip() for cell in line] for line in csv.reader(file) if line and line[0][:1] != "#"]
        seen = {name: np.array([float(u), float(v)]) for name, u, v in rows if name.lower() != "marker"}
        if bad := [name for name, pixel in seen.items() if not np.isfinite(pixel).all()]:
            raise ValueError(f"no pixel of {', '.join(bad)}")
        return seen, None
    except ValueError as error:
        hint = HINTS["rig file"]
        raise DataError(f"{path}: expected lines of marker, u, v; got something else ({error}).", hint=hint) from error
