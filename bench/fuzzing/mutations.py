"""Ways to damage a file: its bytes, its lengths, the cells of a text; the parts of a model file, to be forged."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Mutation = Callable[[np.random.Generator, bytes], bytes]

HUGE = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**64 - 1)
CELLS = ("NaN", "nan", "inf", "-inf", "1e304", "-1e304", "1e-320", "", " ", '"', "'", "1,5", "abc", "0x10", "-0", "1_0")
CELLS = (*CELLS, "9" * 400, "\0", "\u2028", "é", "1e9999", "--", ";", "\t", '""', "true", "[", "#", "2026-11-22")
CELL = re.compile(rb"[^,;\t\r\n ]+")
EDGE = 600  # bytes at either end, where headers and indices are


def _place(rng: np.random.Generator, data: bytes) -> int:
    """Draw a place: in the header, in the index at the end, or anywhere."""
    size, way = len(data), rng.integers(3)
    if size <= EDGE or way == 0:
        return int(rng.integers(size))
    return int(rng.integers(EDGE)) if way == 1 else size - 1 - int(rng.integers(EDGE))


def flipped(rng: np.random.Generator, data: bytes) -> bytes:
    """Flip up to eight bits."""
    changed = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        changed[_place(rng, data)] ^= 1 << rng.integers(8)
    return bytes(changed)


def replaced(rng: np.random.Generator, data: bytes) -> bytes:
    """Put other values into up to four bytes."""
    changed = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        changed[_place(rng, data)] = int(rng.choice([0, 255, rng.integers(256)]))
    return bytes(changed)


def cut(rng: np.random.Generator, data: bytes) -> bytes:
    """Keep the beginning, or the end."""
    place = int(rng.integers(len(data)))
    return data[:place] if rng.random() < 0.8 else data[place:]


def block_moved(rng: np.random.Generator, data: bytes) -> bytes:
    """Repeat a block elsewhere, leave it out, or fill it with zeros."""
    start = _place(rng, data)
    block = data[start : start + int(rng.integers(1, max(2, len(data) // 4)))]
    way, to = rng.integers(3), _place(rng, data)
    if way == 0:
        return data[:to] + block + data[to:]
    rest = data[start + len(block) :]
    return data[:start] + (rest if way == 1 else bytes(len(block)) + rest)


def length_changed(rng: np.random.Generator, data: bytes) -> bytes:
    """Write a number at the edge of its type over two, four or eight bytes."""
    width, place = int(rng.choice([2, 4, 8])), _place(rng, data)
    place -= place % 2 if rng.random() < 0.7 else 0
    value = int(HUGE[rng.integers(len(HUGE))]) % 2 ** (8 * width)
    return data[:place] + value.to_bytes(width, "little" if rng.random() < 0.7 else "big") + data[place + width :]


def cells_changed(rng: np.random.Generator, data: bytes) -> bytes:
    """Write other words into up to four cells of a text."""
    for _ in range(rng.integers(1, 5)):
        cells = list(CELL.finditer(data))
        if not cells:
            return data
        found = cells[rng.integers(min(len(cells), 60)) if rng.random() < 0.5 else rng.integers(len(cells))]
        other = cells[rng.integers(len(cells))].group() if rng.random() < 0.3 else None
        word = CELLS[rng.integers(len(CELLS))].encode() if other is None else other
        data = data[: found.start()] + word + data[found.end() :]
    return data


def lines_changed(rng: np.random.Generator, data: bytes) -> bytes:
    """Leave out a line, repeat it, exchange two, or write all with another delimiter or end."""
    lines, way = data.splitlines(keepends=True), rng.integers(5)
    if len(lines) < 2:
        return cut(rng, data)
    one, two = (int(k) for k in rng.integers(len(lines), size=2))
    if way == 0:
        del lines[one]
    elif way == 1:
        lines.insert(two, lines[one])
    elif way == 2:
        lines[one], lines[two] = lines[two], lines[one]
    elif way == 3:
        return data.replace(b",", rng.choice([b";", b"\t", b" ", b",,"]))
    else:
        return data.replace(b"\n", rng.choice([b"\r", b"\r\n\r\n", b"\n\n", b""]))
    return b"".join(lines)


BYTES: tuple[Mutation, ...] = (flipped, replaced, cut, block_moved, length_changed)
TEXT: tuple[Mutation, ...] = (flipped, replaced, cut, block_moved, cells_changed, cells_changed, lines_changed)


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every place of a JSON tree: a node, and a key of it."""
    keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
    for key in keys:
        yield node, key
        yield from places(node[key])


def archive(header: Any, arrays: Any) -> bytes:
    """Write the bytes of a model file."""
    out = io.BytesIO()
    contents = {"header": np.frombuffer(json.dumps(header, sort_keys=True).encode(), dtype=np.uint8)}
    np.savez(out, **contents, **{name: np.asarray(value) for name, value in arrays.items()})
    return out.getvalue()
