"""What goes wrong with an optical tracker now and then, and a code for each sample that says what did."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from gpcorrect import se3
from gpcorrect.sim.settings import TrackerFaults
from gpcorrect.types import FloatArray, IntArray

DROPOUT_LENGTH = 3.0  # samples in a row, on average; chosen by hand, as optical trackers lose a few at a time


class Fault(IntEnum):
    """Truth about a tracked sample: what, if anything, was done to it."""

    GOOD = 0
    LOST_FIDUCIAL = 1
    OCCLUSION_JUMP = 2
    OUTLIER = 3
    FLIP = 4
    DROPOUT = 5


def corrupted(
    T: FloatArray, rate_hz: float, faults: TrackerFaults, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """Let a tracker fail.

    Parameters
    ----------
    T : (n, 4, 4) array
        Tracked poses in recorded order.
    rate_hz : float
        Of the samples.
    faults : TrackerFaults
        How often, and how badly.
    rng : numpy.random.Generator

    Returns
    -------
    poses : (n, 4, 4) array
        A missing sample is NaN.
    code : (n,) int array
        :class:`Fault` of each sample; a sample fails in one way only, the first of the list.
    """
    poses, code = np.array(T), np.zeros(len(T), dtype=np.int64)
    for fault, events in _events(len(T), rate_hz, faults, rng):
        for start, stop in events:
            rows = np.arange(start, min(stop, len(T)))
            rows = rows[code[rows] == Fault.GOOD]
            poses[rows] = _failed(T[rows], fault, faults, rng)
            code[rows] = fault
    return poses, code


Event = tuple[int, int]


def _events(n: int, rate_hz: float, faults: TrackerFaults, rng: np.random.Generator) -> list[tuple[Fault, list[Event]]]:
    block = round(faults.lost_share * n)
    begin = int(rng.integers(0, n - block + 1))
    jumps = rng.poisson(faults.jumps_hz * n / rate_hz)
    mean_jump = max(1.0, faults.jump_seconds * rate_hz)
    return [
        (Fault.LOST_FIDUCIAL, [(begin, begin + block)] if block else []),
        (Fault.OCCLUSION_JUMP, _bursts(n, jumps, mean_jump, rng)),
        (Fault.OUTLIER, _bursts(n, rng.binomial(n, faults.outlier_share), 1.0, rng)),
        (Fault.FLIP, _bursts(n, rng.binomial(n, faults.flip_share), 1.0, rng)),
        (Fault.DROPOUT, _bursts(n, rng.binomial(n, faults.dropout_share / DROPOUT_LENGTH), DROPOUT_LENGTH, rng)),
    ]


def _bursts(n: int, count: int, mean_length: float, rng: np.random.Generator) -> list[Event]:
    starts = rng.integers(0, n, count)
    lengths = rng.geometric(1.0 / mean_length, count)
    return [(int(s), int(s + k)) for s, k in zip(starts, lengths, strict=True)]


def _failed(T: FloatArray, fault: Fault, faults: TrackerFaults, rng: np.random.Generator) -> FloatArray:
    """Poses of one event: a constant shift and turn, chance on each sample, half a turn, or nothing at all."""
    match fault:
        case Fault.LOST_FIDUCIAL:
            return _displaced(T, faults.lost_shift * _direction(rng), faults.lost_turn * _direction(rng))
        case Fault.OCCLUSION_JUMP:
            size = rng.uniform(0.5, 1.5)
            return _displaced(T, size * faults.jump_shift * _direction(rng), size * faults.jump_turn * _direction(rng))
        case Fault.OUTLIER:
            return _displaced(
                T,
                faults.outlier_shift * rng.standard_normal((len(T), 3)),
                faults.outlier_turn * rng.standard_normal((len(T), 3)),
            )
        case Fault.FLIP:
            return _displaced(T, np.zeros(3), np.pi * np.eye(3)[rng.integers(3)])
        case _:
            return np.full(T.shape, np.nan)


def _displaced(T: FloatArray, shift: FloatArray, turn: FloatArray) -> FloatArray:
    return se3.pose(T[:, :3, :3] @ se3.matrix_from_rotvec(turn), T[:, :3, 3] + shift)


def _direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)
