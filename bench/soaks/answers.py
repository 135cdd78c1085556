"""Every answer again: computed from the model file that it names; its age; whether its stream kept one model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gpcorrect.calibration import load, model_hash
from gpcorrect.correction import Reason, Status
from soaks.records import Record, answer_of, records

TOLERANCE = 1e-9  # m, rad and parts of a quaternion: rounding between two processes of one machine is none


@dataclass
class Tally:
    """What became of the questions of one time.

    Parameters
    ----------
    counts : Counter
        "asked", "answered", "not OK" (EXTRAPOLATING, LIMITED), "lost", "skipped", "wrong", "stale", "mixed".
    refused : Counter, by status
    examples : list of str, of what must not be
    """

    counts: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    @property
    def broken(self) -> int:
        """How many answers broke a promise."""
        return sum(self.counts[name] for name in ("wrong", "stale", "mixed"))


def checked(files: Sequence[Path], models: Sequence[Path], begins: Sequence[float]) -> list[Tally]:
    """Check what planners wrote down; a tally of each span of time, by when its questions were asked.

    Parameters
    ----------
    files : sequence of Path, of the planners
    models : sequence of Path, whose hashes answers may name
    begins : sequence of float
        When each span begins, s of the monotonic clock; the first takes what came before, too.
    """
    correctors = {model_hash(path): load(path) for path in models}
    tallies = [Tally() for _ in begins]
    for file in files:
        held: dict[int, str] = {}
        for record in records(file):
            tally = tallies[max(0, int(np.searchsorted(begins, record.asked, side="right")) - 1)]
            _count(record, tally, correctors, held)
    return tallies


def _count(record: Record, tally: Tally, correctors: dict[str, object], held: dict[int, str]) -> None:
    """Add one record; `held` is the model of each stream of its planner."""
    if record.kind == "skipped":
        tally.counts["skipped"] += 1
        return
    tally.counts["asked"] += 1
    if record.code == "NO_SERVICE":
        tally.counts["lost"] += 1
    elif record.code:
        tally.refused[record.code] += 1
    else:
        tally.counts["answered"] += 1
        tally.counts["not OK"] += bool(record.answer) and any(
            Reason(code).status != Status.OK for code in np.unique(record.answer[-1]).tolist()
        )
        for name in _wrongs(record, correctors, held):
            tally.counts[name] += 1
            took = record.came - record.asked
            tally.examples.append(
                f"{name}: {record.kind} at {record.asked:.3f}, {took:.4f} s of {record.allowed} s, "
                f"{record.starved:.4f} s without a core, {record.replica}"
            )


def _wrongs(record: Record, correctors: dict[str, object], held: dict[int, str]) -> list[str]:
    found = []
    if record.came - record.asked > record.allowed:
        found.append("stale")
    if record.kind == "health":
        return found
    if record.kind == "stream" and held.setdefault(record.stream, record.model_hash) != record.model_hash:
        found.append("mixed")
    if record.kind == "nonsense" or record.model_hash not in correctors or not _same(record, correctors):
        found.append("wrong")
    return found


def _same(record: Record, correctors: dict[str, object]) -> bool:
    """Whether the model that an answer names gives it."""
    model = correctors[record.model_hash]
    expected = answer_of((model.correct_path if record.kind == "path" else model.correct)(*record.question))
    return all(_equal(one, other) for one, other in zip(record.answer, expected, strict=True))


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    if one.shape != other.shape:
        return False
    # Nearly always the same bytes, which takes a fiftieth of the time.
    return one.tobytes() == other.tobytes() or np.allclose(one, other, rtol=0, atol=TOLERANCE, equal_nan=True)
