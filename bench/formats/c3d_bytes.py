"""Writes C3D files byte by byte in three orders, as the C3D user guide (Motion Lab Systems) describes them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

PROCESSORS = {"intel": 84, "dec": 85, "mips": 86}
BLOCK = 512


def write_c3d_bytes(
    path: Path, points: np.ndarray, labels: list[str], rate: float, order: str, scale: float = -1.0, long: str = ""
) -> Path:
    """Write markers `(n, m, 3)` in mm; NaN is a hidden marker with residual -1.

    A positive `scale` (mm) writes integers. How a recording states that it is `long`: "trial", "point" or not at all.
    """
    end = ">" if order == "mips" else "<"

    def real(values: np.ndarray | float) -> bytes:
        single = np.asarray(values, dtype=f"{end}f4")
        if order != "dec":
            return single.tobytes()
        words = (4 * np.asarray(values, "<f4")).tobytes()  # VAX F: the exponent is two larger, the words are swapped
        return np.frombuffer(words, "<u2").reshape(-1, 2)[:, ::-1].tobytes()

    def parameter(name: str, kind: int, dims: list[int], data: bytes) -> bytes:
        body = struct.pack("bB", kind, len(dims)) + bytes(dims) + data + b"\0"
        return struct.pack("bb", len(name), 1) + name.encode() + struct.pack(f"{end}h", len(body) + 2) + body

    n, m = points.shape[:2]
    width = max(map(len, labels))
    group = struct.pack("bb", 5, -1) + b"POINT" + struct.pack(f"{end}h", 3) + b"\0"
    parts = [
        parameter("USED", 2, [], struct.pack(f"{end}h", m)),
        parameter("FRAMES", 2, [], struct.pack(f"{end}H", min(n, 0xFFFF))),
        parameter("SCALE", 4, [], real(scale)),
        parameter("RATE", 4, [], real(rate)),
        parameter("UNITS", -1, [2], b"mm"),
        parameter("LABELS", -1, [width, len(labels)], b"".join(label.ljust(width).encode() for label in labels)),
    ]
    if long == "point":
        parts.append(parameter("LONG_FRAMES", 4, [], real(n)))
    if long == "trial":
        trial = struct.pack("bb", 5, -3) + b"TRIAL" + struct.pack(f"{end}h", 3) + b"\0"
        limits = {"ACTUAL_START_FIELD": 1, "ACTUAL_END_FIELD": n}
        words = {name: struct.pack(f"{end}2H", value % 0x10000, value // 0x10000) for name, value in limits.items()}
        fields = [parameter(name, 2, [2], pair) for name, pair in words.items()]
        parts += [trial, *(field[:1] + b"\3" + field[2:] for field in fields)]
    analog = struct.pack("bb", 6, -2) + b"ANALOG" + struct.pack(f"{end}h", 3) + b"\0"
    used = parameter("USED", 2, [], struct.pack(f"{end}h", 0))
    body = group + b"".join(parts) + analog + used[:1] + b"\2" + used[2:] + b"\0\0"
    blocks = -(-(len(body) + 4) // BLOCK)
    start = 2 + blocks
    parts = [struct.pack(f"{end}5H", m, 0, 1, min(n, 0xFFFF), 0), real(scale), struct.pack(f"{end}2H", start, 0)]
    head = bytes([2, 0x50]) + b"".join(parts) + real(rate)
    section = bytes([1, 0x50, blocks, PROCESSORS[order]]) + body
    hidden = np.isnan(points).any(axis=2)
    data = np.zeros((n, m, 4))
    data[..., :3] = np.where(hidden[..., None], 0.0, points)
    data[..., 3] = np.where(hidden, -1.0, 0.0)
    if scale > 0:
        data[..., :3] = np.round(data[..., :3] / scale)
    values = real(data) if scale < 0 else data.astype(f"{end}i2").tobytes()
    whole = head.ljust(BLOCK, b"\0") + section.ljust(blocks * BLOCK, b"\0") + values
    path.write_bytes(whole + b"\0" * (-len(whole) % BLOCK))
    return path
