"""Streams: signals with stamps of their own, their values at other times, and how they meet on one clock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, LogError
from gpcorrect.logs.order import LEAVE_OUT, Disorder, rising
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, frozen_array
from gpcorrect.velocity import GAP_STEPS

BASE_ORDER = ("tracker_cp", "setpoint_cp", "setpoint_jp")


@dataclass(frozen=True, eq=False)
class Stream:
    """One signal with its own stamps, as a source published it.

    Parameters
    ----------
    name : str, the :class:`~gpcorrect.types.CalibrationLog` field that the stream becomes, such as "tracker_cp"
    stamp : (n,) array, when each sample was taken, by the source's own clock, s
    values : PoseSignal or (n, k) array or (n,) array, the samples
    source : str, topic or file that it came from, for messages
    """

    name: str
    stamp: FloatArray
    values: PoseSignal | FloatArray
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp", frozen_array(self.stamp))
        if not isinstance(self.values, PoseSignal):
            object.__setattr__(self, "values", frozen_array(self.values))
        if len(self.values) != len(self.stamp):
            raise DataError(f"stream {self.name} has {len(self.values)} values for {len(self.stamp)} stamps.")

    def __len__(self) -> int:
        return len(self.stamp)

    def __getitem__(self, rows: Any) -> Self:
        return replace(self, stamp=self.stamp[rows], values=self.values[rows])

    def shifted(self, seconds: float) -> Self:
        """Return the stream with `seconds` added to its stamps.

        Parameters
        ----------
        seconds : float, of either sign
        """
        return replace(self, stamp=self.stamp + seconds)


def default_max_gap(stamp: FloatArray) -> float:
    """Five median steps, s: a longer silence is a gap. Infinite for fewer than two stamps.

    Parameters
    ----------
    stamp : (n,) array, in any order, s
    """
    steps = np.diff(np.unique(stamp))
    return GAP_STEPS * float(np.median(steps)) if steps.size else np.inf


def interpolate(stream: Stream, at: FloatArray, max_gap: float | None = None) -> PoseSignal | FloatArray:
    """Values of a stream at other times: linear, shortest arc for rotations, exact where a sample is hit.

    Samples are taken in the order of their stamps, the first of equal stamps counts, and a missing (NaN)
    sample is as if it had not been recorded.

    Parameters
    ----------
    stream : Stream, what to sample
    at : (m,) array, times on the stream's clock, s, in any order
    max_gap : float, optional
        Longest time between two samples to interpolate across, s; :func:`default_max_gap` of the stream when not given.

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


def _bracket(stamp: FloatArray, at: FloatArray, gap: float) -> tuple[BoolArray, IntArray, BoolArray]:
    """Which times fall on a sorted sample, on which ones, and which times fall between two that are near enough."""
    before = np.clip(np.searchsorted(stamp, at, side="right") - 1, 0, len(stamp) - 1)
    after = np.minimum(before + 1, len(stamp) - 1)
    hit = stamp[before] == at
    within = (stamp[before] < at) & (at < stamp[after]) & (stamp[after] - stamp[before] <= gap)
    return hit, before[hit], within


def _present(stamp: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take the samples that exist, by increasing stamp, one for each stamp."""
    exists = np.isfinite(stamp) & np.isfinite(values.reshape(len(stamp), -1)).all(axis=1)
    stamps, first = np.unique(stamp[exists], return_index=True)
    return stamps, values[exists][first]


def _columns(stamp: FloatArray, values: FloatArray, at: FloatArray, gap: float) -> FloatArray:
    """Linear interpolation, each column through its own samples."""
    table = values.reshape(len(stamp), -1)
    result = np.full((len(at), table.shape[1]), np.nan)
    for k, column in enumerate(table.T):
        known, present = _present(stamp, column)
        if len(known):
            hit, rows, inside = _bracket(known, at, gap)
            result[inside, k] = np.interp(at[inside], known, present)
            result[hit, k] = present[rows]
    return result.reshape(len(at), *values.shape[1:])


def _rotations(stamp: FloatArray, quaternion: FloatArray, at: FloatArray, gap: float) -> FloatArray:
    """Shortest-arc interpolation of quaternions wxyz."""
    stamp, quaternion = _present(stamp, quaternion)
    result = np.full((len(at), 4), np.nan)
    if len(stamp):
        hit, rows, inside = _bracket(stamp, at, gap)
        if inside.any():
            between = se3.interpolate_rotations(stamp, se3.matrix_from_quaternion(quaternion), at[inside])
            result[inside] = se3.quaternion_from_matrix(between)
        result[hit] = quaternion[rows]
    return result


def combine(
    streams: Sequence[Stream],
    base: str | None = None,
    max_gap: float | None = None,
    *,
    shifts: Mapping[str, float] | None = None,
    disorder: Disorder = "refuse",
) -> CalibrationLog:
    """One log on the clock of the base stream; every other stream is interpolated onto it.

    Rows for which no other stream has a value are dropped; a signal that alone is missing there is NaN.

    Parameters
    ----------
    streams : sequence of Stream, at most one for a signal
    base : str, optional
        Name of the stream whose samples become the rows; tracker_cp, else setpoint_cp, else setpoint_jp, else
        the fastest one.
    max_gap : float, optional, see :func:`interpolate`
    shifts : mapping of name to float, optional, seconds to add to the stamps of a stream, where its clock differs
    disorder : {"refuse", "drop", "keep"}
        What to do about stamps that run backwards; "keep" is for looking at a recording, not for learning
        from it. A repeated stamp of the base says nothing new and is dropped, unless "keep".

    Returns
    -------
    CalibrationLog
        One trajectory, one session; what was dropped is in its remarks.

    Raises
    ------
    LogError
        No stream, two for one signal, an unknown base or shift, backward stamps, or no time in common.
    """
    named = {s.name: s for s in streams if len(s)}
    if not named:
        raise LogError("expected at least one signal with samples, got none.")
    if len(named) < sum(len(s) > 0 for s in streams):
        sources = ", ".join(f"{s.name} from {s.source}" for s in streams)
        hint = "Choose one with --arm or --tracker-topic (in Python namespace, tracker_topic)."
        raise LogError(f"more than one stream for one signal: {sources}.", hint=hint)
    for name, seconds in (shifts or {}).items():
        named[name] = _lookup(named, name).shifted(seconds)
    usual = next((n for n in BASE_ORDER if n in named), max(named, key=lambda n: len(named[n])))
    name = usual if base is None else _lookup(named, base).name
    remarks = _check_order(named.values(), disorder)
    if disorder != "keep":
        again = int((np.diff(named[name].stamp) == 0).sum())
        remarks += [f"{again} samples of {name} repeat the stamp before and were dropped."] if again else []
        named = {k: s[rising(s.stamp)] for k, s in named.items()}
    lead = named.pop(name)
    partners = {k: interpolate(s, lead.stamp, max_gap) for k, s in named.items()}
    keep = _with_partner(lead, named, partners)
    if not keep.all():
        lost = f"{(~keep).sum()} of {len(keep)} samples of {name}"
        remarks.append(f"{lost} have no other signal near in time and were dropped.")
    signals: dict[str, Any] = {k: v[keep] for k, v in partners.items()} | {name: lead.values[keep]}
    zeros = np.zeros(int(keep.sum()), dtype=np.int64)
    return CalibrationLog(lead.stamp[keep], zeros, zeros, remarks=tuple(remarks), **signals)


def _lookup(named: Mapping[str, Stream], name: str) -> Stream:
    if name not in named:
        raise LogError(f"there is no stream {name}.", hint=f"Streams here: {', '.join(named)}.")
    return named[name]


def _check_order(streams: Iterable[Stream], disorder: Disorder) -> list[str]:
    """Refuse backward stamps, or say how many there are."""
    remarks = []
    for s in streams:
        back = np.flatnonzero(np.diff(s.stamp) < 0)
        if not back.size:
            continue
        found = f"{back.size} stamps of {s.source or s.name} run backwards, the first at sample {back[0] + 2}"
        if disorder == "refuse":
            hint = f"Set bag.clock = 'receive' in a mapping file, or {LEAVE_OUT}."
            raise LogError(f"{found}.", hint=hint)
        lost = f"{(~rising(s.stamp)).sum()} of {len(s)} samples were left out" if disorder == "drop" else "left in"
        remarks.append(f"{found}; {lost}.")
    return list(dict.fromkeys(remarks))  # signals of one topic share their stamps


def _with_partner(
    lead: Stream, partners: Mapping[str, Stream], values: Mapping[str, PoseSignal | FloatArray]
) -> BoolArray:
    """Rows of the base for which at least one other signal has a value."""
    if not partners:
        return np.ones(len(lead), dtype=np.bool_)
    tables = [v.position if isinstance(v, PoseSignal) else v.reshape(len(v), -1) for v in values.values()]
    keep = np.asarray(np.any([np.isfinite(table).any(axis=1) for table in tables], axis=0))
    if not keep.any():
        spans = "; ".join(f"{s.name} {s.stamp.min():.6g} to {s.stamp.max():.6g} s" for s in (lead, *partners.values()))
        hint = "Their clocks differ: set bag.clock = 'receive' in a mapping file, or give bag.shifts."
        raise LogError(f"the signals share no time: {spans}.", hint=hint)
    return keep
