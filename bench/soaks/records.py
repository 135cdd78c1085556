"""What a planner writes down of every question, and how that is read again."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class Record(NamedTuple):
    """One question of a planner and what came of it; times are s of the monotonic clock, which all processes share.

    Parameters
    ----------
    kind : str
        "pose", "stream", "path", "nonsense", "health", or "skipped": due while the planner waited for another answer.
    asked, came : float
    allowed : float, s that the client may take
    stream : int, another number whenever the planner was told to change its model, or connected anew
    question : tuple, poses and twist, or poses and times
    code : str, status of a refusal; empty for an answer
    model_hash, replica : str, whose answer it is
    answer : tuple, arrays position, quaternion, std, interval95, and reasons
    starved : float, s in which the planner could have run, and had no core
    """

    kind: str
    asked: float
    came: float
    allowed: float
    stream: int
    question: tuple[Any, ...] = ()
    code: str = ""
    model_hash: str = ""
    replica: str = ""
    answer: tuple[Any, ...] = ()
    starved: float = 0.0


def answer_of(correction: Any) -> tuple[np.ndarray, ...]:
    """Return the numbers of a correction, the reasons last."""
    return (
        correction.position,
        correction.quaternion,
        correction.std,
        correction.interval95,
        np.asarray(correction.reasons, dtype=np.int64),
    )


def records(path: Path) -> Iterator[Record]:
    """Read what one planner wrote."""
    with path.open("rb") as file:
        while True:
            try:
                yield Record(*pickle.load(file))  # noqa: S301  # written by our own planner a moment ago
            except EOFError:
                return
