"""C3D motion capture recordings, through ezc3d; what it refuses (MIPS and SPARC machines) through the slower c3d."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.errors import LogError, MissingExtraError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.mocap.take import Take, scale_of
from gpcorrect.logs.mocap.text import seen_only

BLOCK = 512  # bytes; of the C3D format
HEADER_MARK = 0x50  # second byte of every C3D file
DEC, BIG_ENDIAN = bytes([85]), bytes([86])  # processor codes: of swapped words in floating point numbers, big-endian


def read(path: Path, settings: ReadSettings) -> Take:
    """Read markers; one is hidden where its residual is negative, or its position exactly 0, 0, 0."""
    try:
        import ezc3d
    except ImportError as error:
        raise MissingExtraError("ezc3d", extra="c3d", purpose="Reading C3D files") from error
    _check_whole(path)
    try:
        content = _arrays_by_ezc3d(ezc3d.c3d(str(path)))
    except RuntimeError as error:
        if "not supported" not in str(error):
            raise
        content = _arrays_by_c3d(path)
    given = content["labels"].tolist()[: content["points"].shape[1]]  # some programs name more than they write
    # Markers that share a label get names of their own.
    labels = [name if given.count(name) == 1 else f"{name}#{k + 1}" for k, name in enumerate(given)]
    unit = str(content["unit"])
    remarks = [] if unit else ["the file states no unit; millimetres were assumed, as usual in C3D."]
    points = np.where(content["residuals"][..., None] < 0, np.nan, content["points"] * scale_of(unit or "mm"))
    rate = float(content["rate"])
    if not rate > 0 or not points.size or points.shape[1] != len(labels):
        raise LogError(f"expected markers at a rate, got {len(labels)} markers at {rate:g} Hz.")
    frames = int(content["first"]) + np.arange(len(points))
    markers = {name: seen_only(points[:, k]) for k, name in enumerate(labels)}
    return Take(frames / rate, markers=markers, remarks=remarks)


def _arrays_by_ezc3d(content: Any) -> dict[str, Any]:
    """Points `(n, m, 3)`, residuals `(n, m)`, labels, unit, rate and first frame."""
    point = content["parameters"]["POINT"]
    names = [point[key]["value"] for key in ("LABELS", "LABELS2", "LABELS3", "LABELS4") if key in point]
    points = np.asarray(content["data"]["points"])[:3]
    return {
        "points": np.moveaxis(points, 0, -1).swapaxes(0, 1),
        "residuals": np.asarray(content["data"]["meta_points"]["residuals"])[0].T,
        "labels": np.array([label.strip() for part in names for label in part], dtype=str),
        "unit": "".join(point["UNITS"]["value"]).strip() if "UNITS" in point else "",
        "rate": float(np.ravel(point["RATE"]["value"])[0]) if "RATE" in point else 0.0,
        "first": int(content["header"]["points"]["first_frame"]),
    }


def _arrays_by_c3d(path: Path) -> dict[str, Any]:
    """Read the same with the library c3d, which the extra brings too."""
    import c3d

    with warnings.catch_warnings(), path.open("rb") as file:
        warnings.simplefilter("ignore")  # about parameters that markers do not need
        reader = c3d.Reader(file)
        frames = [points[:, :4] for _, points, _ in reader.read_frames()]
        unit = reader.get("POINT:UNITS")
        values = np.array(frames, dtype=np.float64).reshape(len(frames), -1, 4)
        return {
            "points": values[..., :3],
            "residuals": values[..., 3],
            "labels": np.array([label.strip() for label in reader.point_labels], dtype=str),
            "unit": unit.string_value.strip() if unit is not None else "",
            "rate": float(reader.point_rate),
            "first": int(reader.first_frame),
        }


def _check_whole(path: Path) -> None:
    """Refuse a file shorter than its header says: ezc3d reads such a file in part."""
    with path.open("rb") as file:
        head = file.read(BLOCK)
        if len(head) < BLOCK or head[1] != HEADER_MARK:
            raise LogError("the file does not begin like a C3D file.")
        file.seek(max(head[0] - 1, 0) * BLOCK)
        processor = file.read(4)[3:]
    order = ">" if processor == BIG_ENDIAN else "<"
    if processor == DEC:  # the sign is in the other word
        head = head[:12] + head[14:16] + head[12:14] + head[16:]
    count, analog, first, last, _, scale, start = struct.unpack(f"{order}5HfH", head[2:18])
    number = 4 if scale < 0 else 2  # bytes; a negative scale marks floating point data
    expected = (start - 1) * BLOCK + max(last - first + 1, 0) * (4 * count + analog) * number
    size = path.stat().st_size
    if size < expected:
        raise LogError(f"the C3D file is cut off: its header asks for {expected} bytes, it has {size}.")
