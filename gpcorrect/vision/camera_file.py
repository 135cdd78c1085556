"""The calibration file: every camera's lens and place, as JSON or TOML, checked when read."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gpcorrect import se3
from gpcorrect.atomic import atomic_path
from gpcorrect.errors import DataError
from gpcorrect.vision.camera import Camera, Intrinsics

__all__ = ["problems", "read_cameras", "read_table", "write_cameras"]

Row = tuple[float, ...]
HINT = "docs/vision.md shows a calibration file; `gpcorrect vision calibrate` writes one."


class _Lens(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1)
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    matrix: tuple[Row, Row, Row]
    distortion: Annotated[tuple[float, ...], Field(max_length=5)] = ()
    T_camera_tracker: tuple[Row, Row, Row, Row] | None = None
    rvec: tuple[float, float, float] | None = None
    tvec: tuple[float, float, float] | None = None
    covariance: tuple[Row, ...] | None = None
    rms_px: float | None = None

    @model_validator(mode="after")
    def _placed_once(self) -> _Lens:
        by_vectors = self.rvec is not None and self.tvec is not None
        if by_vectors == (self.T_camera_tracker is not None):
            raise ValueError("needs its place once: T_camera_tracker, or rvec and tvec")
        return self

    def camera(self) -> Camera:
        if self.T_camera_tracker is None:
            T = se3.pose(se3.matrix_from_rotvec(np.array(self.rvec)), np.array(self.tvec))
        else:
            T = np.array(self.T_camera_tracker)
        lens = Intrinsics(self.width, self.height, np.array(self.matrix), np.array(self.distortion))
        covariance = None if self.covariance is None else np.array(self.covariance)
        return Camera(self.name, lens, T, covariance, self.rms_px)


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    format: str = "gpcorrect cameras 1"
    cameras: Annotated[tuple[_Lens, ...], Field(min_length=1)]


def read_cameras(path: str | Path) -> tuple[Camera, ...]:
    """Read a calibration file (JSON, or TOML by its ending).

    Raises
    ------
    DataError
        It cannot be read, a key is unknown or missing, a place is no rigid motion, or two cameras share a name.
    """
    values = read_table(path, "calibration file", HINT)
    try:
        cameras = tuple(lens.camera() for lens in _File.model_validate(values).cameras)
    except ValidationError as error:
        raise DataError(f"{path} is no calibration file: {problems(error)}.", hint=HINT) from error
    except ValueError as error:
        raise DataError(f"{path} is no calibration file: {error}", hint=HINT) from error
    names = [camera.name for camera in cameras]
    if len(set(names)) < len(names):
        raise DataError(f"{path}: two cameras have the same name: {', '.join(names)}.", hint="Name each once.")
    return cameras


def write_cameras(cameras: Sequence[Camera], path: str | Path) -> None:
    """Write a calibration file as JSON, whole or not at all."""
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
        }
        for c in cameras
    ]
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps({"format": "gpcorrect cameras 1", "cameras": rows}, indent=1), encoding="utf-8")


def read_table(path: str | Path, what: str, hint: str) -> Any:
    """Return the values of a JSON or TOML file.

    Raises
    ------
    DataError
        It cannot be read, or is neither.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        return tomllib.loads(text) if Path(path).suffix == ".toml" else json.loads(text)
    except OSError as error:
        raise DataError(f"cannot read the {what} {path}: {error.strerror}.", hint=hint) from error
    except ValueError as error:  # what tomllib, json and a wrong encoding raise
        raise DataError(f"{path} is no {what}: {error}.", hint=hint) from error


def problems(error: ValidationError) -> str:
    """Return in one line what a file's values miss."""
    return "; ".join(
        f"{'.'.join(map(str, e['loc']))}: {e['msg'].removeprefix('Value error, ')}" for e in error.errors()[:5]
    )
