"""Requests that are nearly right: numbers at the edges of floating point, wrong lengths, missing and unknown fields."""

from __future__ import annotations

import struct
from random import Random
from typing import Any

EDGES = (0.0, -0.0, 1.0, -1.0, 1e-3, 5e-324, 2.3e-308, 1.8e308, -1.8e308, float("inf"), -float("inf"), float("nan"))
EDGES = (*EDGES, 5.0, 20.0, 200.0, 1e9, 2**31, 2**53 + 1, 2**63 - 1, 2**63, 2**64 - 1, -(2**63), 10**20, -(10**20))


def nearly_right(draw: Random, joints: int) -> dict[str, Any]:
    """Return the fields of a question about a pose, a path or `joints` joints, with little or much wrong in them."""
    way = draw.randrange(6)
    if way < 2:
        return _joints(draw, joints)
    return (_pose, _pose_and_more, _path, _path_and_more)[way - 2](draw)


def _pose(draw: Random) -> dict[str, Any]:
    body: dict[str, Any] = {"pose": _row(draw)}
    if draw.random() < 0.5:
        body["twist"] = _row(draw) if draw.random() < 0.7 else anything(draw)
    return body


def _pose_and_more(draw: Random) -> dict[str, Any]:
    return _with_more(draw, {"pose": _row(draw) if draw.random() < 0.5 else anything(draw)})


def _path(draw: Random) -> dict[str, Any]:
    poses = _table(draw)
    count = len(poses) if draw.random() < 0.7 else draw.randrange(7)
    return {"poses": poses, "times": sorted(draw.uniform(-10.0, 10.0) for _ in range(count))}


def _path_and_more(draw: Random) -> dict[str, Any]:
    return _with_more(draw, {"poses": _table_or_not(draw), "times": _row_or_not(draw)})


def _joints(draw: Random, joints: int) -> dict[str, Any]:
    """Return a path of joints: mostly of the right shape, with a number or a field replaced."""
    rows = draw.randrange(1, 7)
    body: dict[str, Any] = {
        "q": [[draw.uniform(-1.0, 1.0) for _ in range(joints)] for _ in range(rows)],
        "times": [0.03 * k for k in range(rows)],
    }
    if draw.random() < 0.7:
        body["efforts"] = [[draw.uniform(-1.0, 1.0) for _ in range(joints)] for _ in range(rows)]
    if draw.random() < 0.5:
        body["sessions"] = sorted(draw.randrange(3) for _ in range(rows))
    way = draw.randrange(4)
    if way == 0:
        draw.choice(body["q"])[draw.randrange(joints)] = draw.choice([None, number(draw)])
    if way == 1:
        body["times"][draw.randrange(rows)] = number(draw)
    if way == 2:
        body[draw.choice(list(body))] = draw.choice([_table, _row, anything])(draw)
    return _with_more(draw, body) if way == 3 else body


def _with_more(draw: Random, body: dict[str, Any]) -> dict[str, Any]:
    """Leave a field out, add an unknown one, or neither."""
    if draw.random() < 0.2:
        del body[draw.choice(list(body))]
    if draw.random() < 0.3:
        body["unknown"] = anything(draw)
    return body


def _row_or_not(draw: Random) -> Any:
    return _row(draw) if draw.random() < 0.7 else anything(draw)


def _table_or_not(draw: Random) -> Any:
    return _table(draw) if draw.random() < 0.7 else anything(draw)


def _table(draw: Random) -> list[Any]:
    return [_row(draw) for _ in range(draw.randrange(1, 7))]


def _row(draw: Random) -> list[Any]:
    """Return a place near the training, with or without an orientation, or up to nine numbers of any size."""
    place = [draw.uniform(-0.2, 0.2) for _ in range(3)]
    way = draw.randrange(4)
    if way == 0:
        return place
    if way == 1:
        return [*place, 1.0, 0.0, 0.0, 0.0]
    if way == 2:
        place = [*place, 1.0, 0.0, 0.0, 0.0]
        place[draw.randrange(len(place))] = number(draw)
        return place
    return [number(draw) for _ in range(draw.randrange(10))]


def number(draw: Random) -> float:
    """Return an edge, any 64 bits, a large integer, or a number of usual size."""
    way = draw.randrange(4)
    if way == 0:
        return draw.choice(EDGES)
    if way == 1:
        return float(struct.unpack("d", draw.randbytes(8))[0])
    return draw.randint(-(10**20), 10**20) if way == 2 else draw.uniform(-10.0, 10.0)


def anything(draw: Random, deep: int = 0) -> Any:
    """Return a value of any type, lists in lists included."""
    way = draw.randrange(5 if deep < 4 else 4)
    if way == 0:
        return draw.choice([None, True, False])
    if way == 1:
        return "".join(map(chr, (draw.randrange(0xD800) for _ in range(draw.randrange(9)))))
    if way < 4:
        return number(draw)
    return [anything(draw, deep + 1) for _ in range(draw.randrange(10))]
