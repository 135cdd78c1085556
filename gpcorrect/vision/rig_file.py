"""The rig file: which pictures calibrate which camera, the chessboard, and the markers at known places."""

from __future__ import annotations

import csv
import glob
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Intrinsics
from gpcorrect.vision.camera_file import problems, read_table
from gpcorrect.vision.chessboard import Chessboard
from gpcorrect.vision.sources import IMAGES

__all__ = ["Rig", "RigCamera", "read_rig"]

HINT = "docs/vision.md shows a rig file."
Place = tuple[float, float, float]
Row = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class RigCamera:
    """One camera's calibration pictures.

    Parameters
    ----------
    name : str
        Of the camera.
    boards : tuple of Path
        Pictures of the chessboard, anywhere.
    lens : Intrinsics or None
        A lens that is known already; boards are then not needed.
    board_at : Path or None
        The picture of the board at its known place.
    T_tracker_board : (4, 4) array or None
        That place, roughly.
    seen : mapping of marker to (2,) array
        Where markers appear, px.
    markers_in : Path or None
        A picture in which to look for the markers.
    """

    name: str
    boards: tuple[Path, ...] = ()
    lens: Intrinsics | None = None
    board_at: Path | None = None
    T_tracker_board: FloatArray | None = None
    seen: Mapping[str, FloatArray] = field(default_factory=dict)
    markers_in: Path | None = None


@dataclass(frozen=True, eq=False)
class Rig:
    """All cameras, the chessboard, and the markers' places `(3,)` in the tracker frame, m."""

    board: Chessboard
    cameras: tuple[RigCamera, ...]
    markers: Mapping[str, FloatArray]


class _Board(BaseModel):
    model_config = ConfigDict(extra="forbid")
    columns: int
    rows: int
    square: float


class _At(BaseModel):
    model_config = ConfigDict(extra="forbid")
    picture: str
    matrix: tuple[Row, Row, Row, Row] | None = None
    position: Place | None = None
    rotvec: Place = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _placed_once(self) -> _At:
        if (self.matrix is None) == (self.position is None):
            raise ValueError("needs the board's place once: matrix (4 x 4), or position and rotvec")
        return self

    def pose(self) -> FloatArray:
        if self.matrix is not None:
            return np.array(self.matrix)
        return se3.pose(se3.matrix_from_rotvec(np.array(self.rotvec)), np.array(self.position))


class _Lens(BaseModel):
    model_config = ConfigDict(extra="forbid")
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    matrix: tuple[Place, Place, Place]
    distortion: Annotated[tuple[float, ...], Field(max_length=5)] = ()


class _Camera(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1)
    boards: str | tuple[str, ...] = ()
    lens: _Lens | None = None
    board_at: _At | None = None
    markers: str | dict[str, tuple[float, float]] | None = None


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    board: _Board
    markers: dict[str, Place] = Field(default_factory=dict)
    camera: Annotated[tuple[_Camera, ...], Field(min_length=1)]


def read_rig(path: str | Path) -> Rig:
    """Read a rig file (TOML or JSON); the names of pictures in it are relative to its own folder.

    Raises
    ------
    DataError
        It cannot be read, a key is unknown or missing, a picture is not there, or a camera sees a marker that has no
        place.
    """
    values, folder = read_table(path, "rig file", HINT), Path(path).parent
    try:
        read = _File.model_validate(values)
    except ValidationError as error:
        raise DataError(f"{path} is no rig file: {problems(error)}.", hint=HINT) from error
    markers = {name: np.array(place) for name, place in read.markers.items()}
    cameras = tuple(_camera(row, folder, markers, str(path)) for row in read.camera)
    if len({camera.name for camera in cameras}) < len(cameras):
        raise DataError(f"{path}: two cameras have the same name.", hint="Name each once.")
    return Rig(Chessboard(read.board.columns, read.board.rows, read.board.square), cameras, markers)


def _camera(row: _Camera, folder: Path, markers: Mapping[str, FloatArray], source: str) -> RigCamera:
    patterns = (row.boards,) if isinstance(row.boards, str) else row.boards
    boards = tuple(file for pattern in patterns for file in _pictures(folder, pattern))
    if row.lens is None and not boards:
        raise DataError(f"{source}: camera {row.name} has neither a lens nor pictures of the chessboard.", hint=HINT)
    seen, markers_in = _seen(row, folder)
    unknown = sorted(set(seen) - set(markers))
    if unknown:
        raise DataError(
            f"{source}: camera {row.name} sees markers without a place: {', '.join(unknown)}.",
            hint="Give each marker's place in [markers], or name them alike.",
        )
    lens = row.lens
    known = (
        None if lens is None else Intrinsics(lens.width, lens.height, np.array(lens.matrix), np.array(lens.distortion))
    )
    at = row.board_at
    return RigCamera(
        row.name,
        boards,
        known,
        None if at is None else _file(folder, at.picture),
        None if at is None else at.pose(),
        seen,
        markers_in,
    )


def _pictures(folder: Path, pattern: str) -> list[Path]:
    """Files of a pattern, or all images of a folder."""
    if (folder / pattern).is_dir():
        pattern = str(Path(pattern) / "*")
    found = sorted(Path(name) for name in glob.glob(str(folder / pattern)))
    images = [file for file in found if file.suffix.lower() in IMAGES]
    if not images:
        raise DataError(f"there are no pictures {folder / pattern}.", hint=HINT)
    return images


def _file(folder: Path, name: str) -> Path:
    if not (folder / name).is_file():
        raise DataError(f"there is no picture {folder / name}.", hint=HINT)
    return folder / name


def _seen(row: _Camera, folder: Path) -> tuple[dict[str, FloatArray], Path | None]:
    """Pixels of markers: from the file itself, a table (marker, u, v), or a picture to look in."""
    if row.markers is None:
        return {}, None
    if isinstance(row.markers, dict):
        return {name: np.array(pixel) for name, pixel in row.markers.items()}, None
    path = _file(folder, row.markers)
    if path.suffix.lower() in IMAGES:
        return {}, path
    with path.open(newline="", encoding="utf-8") as file:
        rows = [line for line in csv.reader(file) if line and not line[0].startswith("#")]
    try:
        return {name: np.array([float(u), float(v)]) for name, u, v in rows if name.strip().lower() != "marker"}, None
    except ValueError as error:
        raise DataError(f"{path}: expected lines of marker, u, v; got something else ({error}).", hint=HINT) from error
