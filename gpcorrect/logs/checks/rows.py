"""Whether the rows of a static table belong together: each measured pose to the command beside it.

Without a clock nothing can be shifted against a motion. What frames, mountings and mirrors leave as it is can be
compared: how far each pose lies from the others of its own signal, and by how much it is turned against them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpcorrect.logs.checks.evidence import MIN_PAIRED, Evidence, Finding, check
from gpcorrect.types import BoolArray, FloatArray, IntArray

BESIDE = 200  # rows, to which the distances of all others are compared; more say nothing new
BELONGS = 0.5  # of the difference that chance leaves: rows that belong together leave 0.03 to 0.3, others 0.7 and more
SHIFTS = (-1, 1)  # rows by which measured poses may be late or early: one reading doubled, or one missed
LEAST_CHANCE = 0.1  # of the typical distance: where chance leaves less, most rows are repeated, and none is found wrong
LEAST_TURN = np.deg2rad(5.0)  # between typical rows; turns of less may be all noise
LEAST_SHIFTED = 0.05  # of the rows must belong when shifted; chosen by hand
LEAST_EXPLAINED = 0.8  # likewise, of those that do not belong as they are; chosen by hand
REFERENCES = ("setpoint_cp", "measured_cp")


@check
def _rows_unrelated(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether the measured poses of a table without a clock are those of the commands beside them."""
    reference = next((name for name in REFERENCES if name in evidence.present), None)
    if not evidence.log.static or reference is None or "tracker_cp" not in evidence.present:
        return
    rows = np.flatnonzero(evidence.known[reference] & evidence.known["tracker_cp"])
    if rows.size < MIN_PAIRED:
        return
    commanded, observed = (evidence.tables[name][rows] for name in (reference, "tracker_cp"))
    belongs = _belongs(commanded, observed)
    for shift in SHIFTS:
        shifted = ~belongs & _belongs_shifted(commanded, observed, belongs, shift)
        if shifted.sum() >= max(LEAST_SHIFTED * len(rows), LEAST_EXPLAINED * (~belongs).sum(), 2):
            # From there on most are shifted: the most of those, less the others, lie behind it.
            start = len(shifted) - 1 - int(np.argmax(np.cumsum(np.where(shifted, 1, -1)[::-1])))
            yield _shifted(reference, rows[start:], shift, len(rows))
            return
    if belongs.mean() < BELONGS:
        wrong = rows[~belongs]
        what = f"{wrong.size} of {len(rows)} measured poses are not where {reference} puts them, in whatever frames."
        hint = "Does each row hold the pose that was measured at its command? Was one of the columns sorted?"
        yield Finding("error", "unrelated", "tracker_cp", what, hint, wrong.size, wrong)


def _shifted(reference: str, rows: IntArray, shift: int, count: int) -> Finding:
    where = "" if rows.size > 0.9 * count else f" from data row {rows[0] + 1} on"
    other = "k-1" if shift > 0 else "k+1"
    what = f"it is one row off{where}: row k of the measured poses belongs to row {other} of {reference}."
    hint = f"Shift them by one row; was one reading {'doubled' if shift > 0 else 'missed'}?"
    return Finding("error", "unrelated", "tracker_cp", what, hint, rows.size, rows)


def _belongs(commanded: FloatArray, observed: FloatArray) -> BoolArray:
    """Return which rows `(n,)` of two tables of poses lie and turn alike, seen from most others."""
    found = [_alike(a, b) for a, b in _apart(commanded, observed, _some(np.arange(len(commanded))))]
    return np.asarray(min(found, key=np.median) < BELONGS)  # by positions or by turns: the lever of a marker hides one


def _belongs_shifted(commanded: FloatArray, observed: FloatArray, belongs: BoolArray, shift: int) -> BoolArray:
    """Return which rows of the commands belong to the measured row `shift` later, seen from rows that belong already.

    Where hardly any do, all rows are shifted.
    """
    n, found = len(commanded), np.zeros(len(commanded), dtype=np.bool_)
    first, last = max(0, -shift), n - max(0, shift)
    if belongs.mean() < BELONGS:
        found[first:last] = _belongs(commanded[first:last], observed[first + shift : last + shift])
        return found
    kinds = [
        (np.median(_alike(a, b)[belongs]), _alike(a[first:last], b[first + shift : last + shift]))
        for a, b in _apart(commanded, observed, _some(np.flatnonzero(belongs)))
    ]
    found[first:last] = min(kinds, key=lambda kind: float(kind[0]))[1] < BELONGS
    return found


def _some(rows: IntArray) -> IntArray:
    return np.asarray(rows[np.linspace(0, rows.size - 1, min(rows.size, BESIDE)).astype(int)])


def _apart(commanded: FloatArray, observed: FloatArray, some: IntArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield how far poses of each table are from `some` of it `(n, k)`, then by how much they are turned.

    In units of the typical one: a table in millimetres is another check's.
    """
    moved = [np.linalg.norm(table[:, None, :3] - table[some, :3], axis=2) for table in (commanded, observed)]
    yield _typical(moved[0]), _typical(moved[1])
    if commanded.shape[1] == observed.shape[1] == 7:
        cosines = [np.abs(q @ q[some].T) for q in (commanded[:, 3:], observed[:, 3:])]  # of half the turn
        turned = [2 * np.arccos(np.clip(cosine, 0.0, 1.0)) for cosine in cosines]
        if min(map(np.median, turned)) > LEAST_TURN:
            yield _typical(turned[0]), _typical(turned[1])


def _typical(apart: FloatArray) -> FloatArray:
    return np.asarray(apart / max(float(np.median(apart)), np.finfo(float).tiny))


def _alike(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the median difference `(n,)` of distances to the same rows, over that of distances to other ones."""
    others = np.random.default_rng(0).permutation(b.shape[1])  # a table may go through its poses twice
    chance = np.median(np.abs(a - b[:, others]), axis=1)
    return np.asarray(np.median(np.abs(a - b), axis=1) / np.maximum(chance, LEAST_CHANCE))
