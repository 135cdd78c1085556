"""C3D motion capture recordings, through ezc3d."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.errors import LogError, MissingExtraError
from gpcorrect.logs.mocap.take import Take, log_of, scale_of
from gpcorrect.logs.settings import ReadSettings, check_size
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["read"]

BLOCK = 512  # bytes
HEADER_MARK = 0x50  # second byte of every C3D file
BIG_ENDIAN = bytes([86])  # processor code of files in big-endian order


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read the tool's pose from its markers; the fit's error becomes the extra column `marker_rms` (m).

    A marker is hidden where its residual is negative. Three markers and more give poses, one gives positions.

    Raises
    ------
    LogError
        The file is damaged or too large, holds no such marker, or the markers do not give a pose.
    MissingExtraError
        The library ezc3d is not installed.
    """
    check_size(path, settings.max_bytes)
    content = _load(path)
    point = content["parameters"]["POINT"]
    labels = _labels(point)
    points, remarks = _points(content, point)
    rate = float(np.ravel(point["RATE"]["value"])[0]) if "RATE" in point else 0.0
    if not rate > 0 or not points.size:
        raise LogError(f"expected markers at a rate, got {len(labels)} markers at {rate:g} Hz.")
    frames = int(content["header"]["points"]["first_frame"]) + np.arange(len(points))
    markers = {name: points[:, k] for k, name in enumerate(labels)}
    return log_of(Take(frames / rate, markers=markers, remarks=remarks), settings.columns.mocap)


def _load(path: Path) -> Mapping[str, Any]:
    try:
        import ezc3d
    except ImportError as error:
        raise MissingExtraError("ezc3d", extra="c3d", purpose="Reading C3D files") from error
    _check_whole(path)
    try:
        content: Mapping[str, Any] = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError, IndexError, MemoryError) as error:
        raise LogError(f"the C3D file cannot be read, it may be cut off: {error}.") from error
    return content


def _check_whole(path: Path) -> None:
    """Refuse a file shorter than its header says: ezc3d reads such a file in part, or never returns."""
    with path.open("rb") as file:
        head = file.read(BLOCK)
        if len(head) < BLOCK or head[1] != HEADER_MARK:
            raise LogError("the file does not begin like a C3D file.")
        file.seek((head[0] - 1) * BLOCK)
        order = ">" if file.read(4)[3:] == BIG_ENDIAN else "<"
    count, analog, first, last, _, scale, start = struct.unpack(f"{order}5HfH", head[2:18])
    number = 4 if scale < 0 else 2  # bytes; a negative scale marks floating point data
    expected = (start - 1) * BLOCK + max(last - first + 1, 0) * (4 * count + analog) * number
    size = path.stat().st_size
    if size < expected:
        raise LogError(f"the C3D file is cut off: its header asks for {expected} bytes, it has {size}.")


def _labels(point: Mapping[str, Any]) -> list[str]:
    """Names of all markers, each its own; the format keeps those beyond the 255th apart."""
    parts = [point[key]["value"] for key in ("LABELS", "LABELS2", "LABELS3", "LABELS4") if key in point]
    labels = [label.strip() for part in parts for label in part]
    return [name if labels.count(name) == 1 else f"{name}#{k + 1}" for k, name in enumerate(labels)]


def _points(content: Mapping[str, Any], point: Mapping[str, Any]) -> tuple[FloatArray, list[str]]:
    """Markers `(n, m, 3)` in metres, NaN where hidden."""
    unit = "".join(point.get("UNITS", {"value": []})["value"]).strip()
    scale = scale_of(unit or "mm")
    remarks = [] if unit else ["the file states no unit; millimetres were assumed, as usual in C3D."]
    points = np.moveaxis(np.asarray(content["data"]["points"][:3]), 0, -1).swapaxes(0, 1)
    hidden = np.asarray(content["data"]["meta_points"]["residuals"])[0].T < 0
    return np.where(hidden[..., None], np.nan, points * scale), remarks
