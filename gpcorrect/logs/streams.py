"""Streams: signals that each keep their own stamps, and their values at other times by interpolation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal, frozen_array

__all__ = ["Stream", "default_max_gap", "interpolate"]

GAP_STEPS = 5.0  # the same rule as gpcorrect.velocity: five median steps without a sample are a gap


@dataclass(frozen=True, eq=False)
class Stream:
    """One signal with its own stamps, as a source published it.

    Parameters
    ----------
    name : str
        The :class:`~gpcorrect.types.CalibrationLog` field that the stream becomes, such as "tracker_cp".
    stamp : (n,) array
        When each sample was taken, by the source's own clock, s.
    values : PoseSignal or (n, k) array or (n,) array
        The samples.
    receive : (n,) array or None
        When the recorder received each sample, by the recorder's clock, s; on the same origin as `stamp`.
    source : str
        Topic or file that it came from, for messages.
    """

    name: str
    stamp: FloatArray
    values: PoseSignal | FloatArray
    receive: FloatArray | None = None
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp", frozen_array(self.stamp))
        if not isinstance(self.values, PoseSignal):
            object.__setattr__(self, "values", frozen_array(self.values))
        if self.receive is not None:
            object.__setattr__(self, "receive", frozen_array(self.receive))
        for part, column in (("values", self.values), ("receive stamps", self.receive)):
            if column is not None and len(column) != len(self.stamp):
                raise DataError(f"stream {self.name} has {len(column)} {part} for {len(self.stamp)} stamps.")

    def __len__(self) -> int:
        return len(self.stamp)

    def __getitem__(self, rows: Any) -> Self:
        receive = None if self.receive is None else self.receive[rows]
        return replace(self, stamp=self.stamp[rows], values=self.values[rows], receive=receive)

    def shifted(self, seconds: float) -> Self:
        """Return the stream with `seconds` added to its stamps."""
        return replace(self, stamp=self.stamp + seconds)


def default_max_gap(stamp: FloatArray) -> float:
    """Five median steps of these stamps, s: a longer silence is a gap. Infinite for fewer than two stamps."""
    steps = np.diff(np.unique(stamp))
    return GAP_STEPS * float(np.median(steps)) if steps.size else np.inf


def interpolate(stream: Stream, at: FloatArray, max_gap: float | None = None) -> PoseSignal | FloatArray:
    """Values of a stream at other times: linear, shortest arc for rotations, exact where a sample is hit.

    Samples are taken in the order of their stamps, the first of equal stamps counts, and a missing (NaN)
    sample is as if it had not been recorded.

    Parameters
    ----------
    stream : Stream
        What to sample.
    at : (m,) array
        Times on the stream's clock, s, in any order.
    max_gap : float, optional
        Longest time between two samples to interpolate across, s; :func:`default_max_gap` of the stream
        when not given.

    Returns
    -------
    PoseSignal or array
        As `stream.values`, with m rows; NaN outside the recording and inside gaps.
    """
    at = np.asarray(at, dtype=np.float64)
    gap = default_max_gap(stream.stamp) if max_gap is None else max_gap
    if not isinstance(stream.values, PoseSignal):
        return _columns(stream.stamp, stream.values, at, gap)
    quaternion = stream.values.quaternion
    rotation = None if quaternion is None else _rotations(stream.stamp, quaternion, at, gap)
    return PoseSignal(_columns(stream.stamp, stream.values.position, at, gap), rotation)


@dataclass(frozen=True, eq=False)
class _Bracket:
    """Where times fall among sorted samples: at one (`hit`), or between two near enough (`inside`)."""

    before: IntArray
    hit: BoolArray
    inside: BoolArray


def _bracket(stamp: FloatArray, at: FloatArray, gap: float) -> _Bracket:
    before = np.clip(np.searchsorted(stamp, at, side="right") - 1, 0, max(len(stamp) - 1, 0))
    after = np.minimum(before + 1, len(stamp) - 1)
    hit = stamp[before] == at
    within = (stamp[before] < at) & (at < stamp[after]) & (stamp[after] - stamp[before] <= gap)
    return _Bracket(before, hit, within)


def _present(stamp: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take the samples that exist, by increasing stamp, one for each stamp."""
    exists = np.isfinite(stamp) & np.isfinite(values.reshape(len(stamp), -1)).all(axis=1)
    kept, first = np.unique(stamp[exists], return_index=True)
    return kept, values[exists][first]


def _columns(stamp: FloatArray, values: FloatArray, at: FloatArray, gap: float) -> FloatArray:
    """Linear interpolation, each column through its own samples."""
    table = values.reshape(len(stamp), -1)
    columns = [_linear(*_present(stamp, table[:, k]), at, gap) for k in range(table.shape[1])]
    stacked = np.stack(columns, axis=1) if columns else np.empty((len(at), 0))
    return stacked.reshape(len(at), *values.shape[1:])


def _linear(stamp: FloatArray, values: FloatArray, at: FloatArray, gap: float) -> FloatArray:
    result = np.full(len(at), np.nan)
    if len(stamp):
        bracket = _bracket(stamp, at, gap)
        result[bracket.inside] = np.interp(at[bracket.inside], stamp, values)
        result[bracket.hit] = values[bracket.before[bracket.hit]]
    return result


def _rotations(stamp: FloatArray, quaternion: FloatArray, at: FloatArray, gap: float) -> FloatArray:
    """Shortest-arc interpolation of quaternions wxyz."""
    stamp, quaternion = _present(stamp, quaternion)
    result = np.full((len(at), 4), np.nan)
    if len(stamp):
        bracket = _bracket(stamp, at, gap)
        if bracket.inside.any():
            matrices = se3.matrix_from_quaternion(quaternion)
            between = se3.interpolate_rotations(stamp, matrices, at[bracket.inside])
            result[bracket.inside] = se3.quaternion_from_matrix(between)
        result[bracket.hit] = quaternion[bracket.before[bracket.hit]]
    return result
