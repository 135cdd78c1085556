"""C3D motion capture recordings of any length and in every order of bytes, after the user guide of Motion Lab Systems.

The header counts frames in sixteen bits. Recordings of more than 65535 frames, eleven minutes at 100 Hz, state their
number as parameters, or nowhere; readers that go by the header, ezc3d among them, return their beginning alone.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.mocap.take import Take, scale_of
from gpcorrect.logs.mocap.text import seen_only

BLOCK = 512  # bytes; of the C3D format
HEADER_MARK = 0x50  # second byte of every C3D file
FULL = 0xFFFF  # the last frame that the header has room for
DEC, MIPS = 85, 86  # processor codes: of swapped words in floating point numbers, of big-endian numbers; Intel is 84
FROM, TO, LONG = "TRIAL:ACTUAL_START_FIELD", "TRIAL:ACTUAL_END_FIELD", "POINT:LONG_FRAMES"  # of long recordings
LABELS = ("POINT:LABELS", "POINT:LABELS2", "POINT:LABELS3", "POINT:LABELS4")  # 255 markers each
TEXT, INTEGER, REAL = -1, 2, 4  # kinds of parameters, and bytes of a number; a kind of 1 is a byte

Parameters = Mapping[str, Any]
"""Texts (list of str) and numbers (array) by `GROUP:NAME`."""


@dataclass(frozen=True)
class _Header:
    """What the first block says of the data."""

    markers: int
    numbers: int  # in a frame, of markers and analog channels
    first: int  # number of the first frame; 1 where the recording was not cut
    last: int
    parameters: int  # where they begin, bytes
    data: int  # where frames begin, bytes
    scale: float  # of integers; negative where the data are real numbers
    processor: int

    @classmethod
    def of(cls, content: bytes) -> Self:
        if len(content) < BLOCK or content[1] != HEADER_MARK:
            raise LogError("the file does not begin like a C3D file.")
        parameters = max(content[0] - 1, 0) * BLOCK
        processor = content[parameters + 3] if len(content) > parameters + 3 else 0
        words = _numbers(content[2:24], INTEGER, processor)
        markers, analog, first, last, start = (int(words[k]) for k in (0, 1, 2, 3, 7))
        if start < 2:
            raise LogError("the C3D file does not say where its data begin.")
        scale = float(_numbers(content[12:16], REAL, processor)[0])
        return cls(markers, 4 * markers + analog, first, last, parameters, (start - 1) * BLOCK, scale, processor)

    @property
    def kind(self) -> int:
        return REAL if self.scale < 0 else INTEGER


def read(path: Path, settings: ReadSettings) -> Take:
    """Read markers; one is hidden where its residual is negative, or its position exactly 0, 0, 0."""
    content = path.read_bytes()
    header = _Header.of(content)
    parameters = _parameters(content[header.parameters : header.data], header.processor)
    rate = float(np.ravel(parameters.get("POINT:RATE", 0.0))[0])
    given = [label for key in LABELS for label in parameters.get(key, [])]
    labels = given[: header.markers]  # some programs name more than they write
    first, frames = _frames(header, parameters, content)
    if not rate > 0 or not frames or not labels or len(labels) != header.markers:
        raise LogError(f"expected markers at a rate, got {len(labels)} markers at {rate:g} Hz.")
    unit = "".join(parameters.get("POINT:UNITS", [])).strip()
    remarks = [] if unit else ["the file states no unit; millimetres were assumed, as usual in C3D."]
    points = _points(content, header, frames)
    places = np.where(points[..., 3:] < 0, np.nan, points[..., :3] * scale_of(unit or "mm"))
    # Markers that share a label get names of their own.
    names = [name if labels.count(name) == 1 else f"{name}#{k + 1}" for k, name in enumerate(labels)]
    markers = {name: seen_only(places[:, k]) for k, name in enumerate(names)}
    return Take((first - 1 + np.arange(frames)) / rate, markers=markers, remarks=remarks)


def _frames(header: _Header, parameters: Parameters, content: bytes) -> tuple[int, int]:
    """Return the first frame's number, from 1, and how many there are; refuse a file that does not hold them all."""
    size = header.numbers * header.kind
    first, frames = max(header.first, 1), max(header.last - header.first + 1, 0)
    held = -(-(len(content.rstrip(b"\0")) - header.data) // size) if size else 0  # blocks are filled up with zeros
    if header.last == FULL or held > frames + FULL:  # the header's count is full, or began anew
        stated = {key: _whole(parameters[key]) for key in (FROM, TO, LONG) if key in parameters}
        first = stated.get(FROM, first)
        frames = stated[TO] - first + 1 if TO in stated else stated.get(LONG, max(held, frames))
    expected = header.data + frames * size
    if len(content) < expected:
        raise LogError(f"the C3D file is cut off: its header asks for {expected} bytes, it has {len(content)}.")
    return first, frames


def _whole(words: NDArray[Any]) -> int:
    """Return a whole number that is written as one, or as words of two bytes, the lowest first."""
    return sum(int(word) << (16 * k) for k, word in enumerate(np.ravel(words)))


def _points(content: bytes, header: _Header, frames: int) -> NDArray[np.float64]:
    """Positions in the file's unit, and residuals `(frames, markers, 4)`."""
    end = header.data + frames * header.numbers * header.kind
    values = _numbers(content[header.data : end], header.kind, header.processor, signed=True)
    points = values.reshape(frames, header.numbers)[:, : 4 * header.markers].reshape(frames, -1, 4).astype(np.float64)
    if header.kind == INTEGER:
        points[..., :3] *= header.scale
    return points


def _parameters(section: bytes, processor: int) -> Parameters:
    order = ">" if processor == MIPS else "<"
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Any]] = []
    at = 4
    while at + 2 < len(section) and section[at]:
        length, group = struct.unpack_from("bb", section, at)
        name = section[at + 2 : at + 2 + abs(length)].decode("latin-1").upper()  # a negative length locks it
        at += 2 + abs(length)
        (step,) = struct.unpack_from(f"{order}H", section, at)
        if group < 0:
            groups[-group] = name
        else:
            found.append((group, name, _value(section[at + 2 : at + step if step else None], processor)))
        if not step:
            break
        at += step
    return {f"{groups.get(group, '')}:{name}": value for group, name, value in found}


def _value(record: bytes, processor: int) -> Any:
    """Texts, or an array of numbers, whose kind and sizes stand before them."""
    kind, dimensions = struct.unpack_from("bB", record)
    sizes = record[2 : 2 + dimensions]
    values = record[2 + dimensions : 2 + dimensions + prod(sizes) * abs(kind)]
    if kind == TEXT:
        width = sizes[0] if sizes else 1
        parts = [values[k : k + width] for k in range(0, len(values), max(width, 1))]
        return [part.decode("utf-8", "replace").strip(" \0") for part in parts]
    return np.frombuffer(values, np.int8) if kind == 1 else _numbers(values, kind, processor)


def _numbers(values: bytes, kind: int, processor: int, signed: bool = False) -> NDArray[Any]:
    """Numbers of two bytes (`INTEGER`), or real ones of four."""
    order = ">" if processor == MIPS else "<"
    if kind == INTEGER:
        return np.frombuffer(values, f"{order}{'i' if signed else 'u'}2")
    if processor == DEC:  # VAX F: the words are swapped, the exponent is two larger
        return np.frombuffer(values, "<u2").reshape(-1, 2)[:, ::-1].copy().view("<f4")[:, 0] / 4
    return np.frombuffer(values, f"{order}f4")
