"""Parts of recordings that come twice: cut out, put together, under other trajectory numbers or in other columns.

A tracker or an outside encoder that moves never reads the same five times in a row to the last digit. So each stretch
of five samples of such a sensor has a mark, a number of 64 bits, and two recordings that share marks share samples,
whatever else their files say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpcorrect.types import BoolArray, CalibrationLog, PoseSignal

Marks = NDArray[np.uint64]

OUTSIDE = ("tracker_cp", "external_jp")
STRETCH = 5  # samples: a coarse encoder of one joint may read the same two or three times; chosen by hand
DIGITS = 8  # behind the point, of m and rad: other units in a file change later ones; chosen by hand
REMEMBERED = 256  # marks that a model file remembers, 4 kB; of a part of a tenth some 25 are found again
LEAST = 2  # marks of those; chosen by hand, for one is a stretch of five samples
LARGEST = 1e6  # m or rad, beyond which a number means nothing
STEP = 0x9E3779B97F4A7C15  # of SplitMix64 (Steele, Lea and Flood 2014), as are the other two
FIRST, SECOND = 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


def marks_of(log: CalibrationLog) -> Marks:
    """Return the marks of a log's stretches, each once, in rising order; where a sensor stands still there is none.

    A stretch that comes again in its own trajectory is left out: that is an arm near rest, and no copy.

    Parameters
    ----------
    log : CalibrationLog, n samples
    """
    found = [stretches(log, name)[1] for name in OUTSIDE if getattr(log, name) is not None]
    return np.unique(np.concatenate([*found, np.empty(0, dtype=np.uint64)]))


def remembered(marks: Marks) -> str:
    """Return the smallest marks as hexadecimal digits, by which a part of a recording is known again.

    Parameters
    ----------
    marks : (k,) array, in rising order
    """
    return marks[:REMEMBERED].astype(">u8").tobytes().hex()


def recalled(digits: str) -> Marks:
    """Return the marks that :func:`remembered` wrote.

    Parameters
    ----------
    digits : str, 16 a mark
    """
    return np.frombuffer(bytes.fromhex(digits), dtype=">u8").astype(np.uint64)


def stretches(log: CalibrationLog, name: str) -> tuple[NDArray[np.intp], Marks]:
    """Return first rows and marks of the stretches of a signal, in which it moves, that come once in a trajectory.

    Parameters
    ----------
    log : CalibrationLog, n samples
    name : str
    """
    if len(log) < STRETCH:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.uint64)
    signal = getattr(log, name)
    table = signal.position if isinstance(signal, PoseSignal) else signal
    known: BoolArray = np.all(np.abs(table) < LARGEST, axis=1)
    # A number of 64 bits for each row, the same for the same rounded numbers.
    whole_numbers = np.round(np.where(known[:, None], table, 0.0) * 10.0**DIGITS).astype(np.int64).astype(np.uint64)
    rows = np.zeros(len(table), dtype=np.uint64)
    for column in whole_numbers.T:
        rows = _mixed(rows + column)
    last = len(log) - STRETCH + 1
    marks, whole = np.zeros(last, dtype=np.uint64), log.trajectory[:last] == log.trajectory[STRETCH - 1 :]
    for k in range(STRETCH):
        marks = _mixed(marks + rows[k : k + last])
        whole = whole & known[k : k + last]
    starts = np.flatnonzero(whole & (rows[:last] != rows[STRETCH - 1 :]))
    pairs = np.column_stack([log.trajectory[starts].astype(np.uint64), marks[starts]])
    _, first, counts = np.unique(pairs, axis=0, return_index=True, return_counts=True)
    starts = starts[first[counts == 1]]
    return starts, marks[starts]


def _mixed(numbers: Marks) -> Marks:
    """One step of SplitMix64, in which every bit changes about half of all others."""
    z = numbers + np.uint64(STEP)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(FIRST)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(SECOND)
    return np.asarray(z ^ (z >> np.uint64(31)))
