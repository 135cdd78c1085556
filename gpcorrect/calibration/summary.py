"""What a model says of itself: which parts programs read, and of which type each is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gpcorrect.codec import unpack
from gpcorrect.errors import DataError
from gpcorrect.logs.copies import recalled

Three = tuple[float, float, float]
PARTS: dict[str, Any] = {
    "robot": str | None,
    "arm": str | None,
    "method": str,
    "features": Sequence[str],
    "remarks": Sequence[str],
    "baseline": Sequence[float],
    "data": {"source": str, "sha256": str, "recordings": Sequence[str]},
    "fit": {"n_train": int, "n_trajectories": int, "dropped": Mapping[str, int], "seed": int},
}
"""That every fit writes."""
OPTIONAL: dict[str, Any] = {
    "frames": {"input": str, "output": str},
    "training_region": {"position_min": Three, "position_max": Three},
}
"""That are written of some tasks."""
KNOWN = {"contents": Sequence[str], "marks": str}
"""Of data and updates, in models of this version."""
UPDATE: dict[str, Any] = {"source": str, "sha256": str, "recordings": Sequence[str], "n_added": int, "keep": float}
"""Of each of the `updates`, where there are any."""


def check_summary(summary: Mapping[str, Any]) -> None:
    """Refuse a description, read from a file, that the programs which show or follow it cannot read.

    Parameters
    ----------
    summary : mapping
        As :meth:`Corrector.info` gives it; an empty one says nothing.

    Raises
    ------
    DataError, ValueError
        A part is missing, or of another type.
    """
    if not summary:
        return
    _check(PARTS, summary, "its description")
    _check({name: part for name, part in OPTIONAL.items() if name in summary}, summary, "its description")
    updates = summary.get("updates", [])
    if not isinstance(updates, list):
        raise DataError("its updates are no list.")
    for update in updates:
        _check(UPDATE, update, "one of its updates")
    for entry in (summary["data"], *updates):
        _check({name: part for name, part in KNOWN.items() if name in entry}, entry, "what it says of its data")
        recalled(entry.get("marks", ""))


def _check(parts: Mapping[str, Any], found: Any, where: str) -> None:
    if not isinstance(found, Mapping):
        raise DataError(f"{where} is no table.")
    for name, hint in parts.items():
        if name not in found:
            raise DataError(f"{where} does not say its {name}.")
        if isinstance(hint, dict):
            _check(hint, found[name], f"{where}, {name},")
        else:
            unpack(hint, found[name], {})
