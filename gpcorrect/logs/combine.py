"""Streams meet on one clock: one base stream gives the rows, the others are interpolated onto it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.order import Disorder, rising
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, PoseSignal

__all__ = ["combine"]

BASE_ORDER = ("tracker_cp", "setpoint_cp", "setpoint_jp")


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
    streams : sequence of Stream
        At most one for a signal.
    base : str, optional
        Name of the stream whose samples become the rows; tracker_cp, else setpoint_cp, else setpoint_jp, else
        the fastest one.
    max_gap : float, optional
        See :func:`interpolate`.
    shifts : mapping of name to float, optional
        Seconds to add to the stamps of a stream, where its clock differs.
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
    named = _by_name(streams)
    for name, seconds in (shifts or {}).items():
        named[name] = _lookup(named, name).shifted(seconds)
    name = _base_name(named, base)
    remarks = _check_order(named.values(), disorder)
    if disorder != "keep":
        remarks += _say_repeated(named[name])
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


def _by_name(streams: Sequence[Stream]) -> dict[str, Stream]:
    named = {s.name: s for s in streams if len(s)}
    if not named:
        raise LogError("expected at least one signal with samples, got none.")
    if len(named) < sum(len(s) > 0 for s in streams):
        sources = ", ".join(f"{s.name} from {s.source}" for s in streams)
        raise LogError(
            f"more than one stream for one signal: {sources}.",
            hint="Choose one with namespace or tracker_topic.",
        )
    return named


def _lookup(named: Mapping[str, Stream], name: str) -> Stream:
    if name not in named:
        raise LogError(f"there is no stream {name}.", hint=f"Streams here: {', '.join(named)}.")
    return named[name]


def _base_name(named: Mapping[str, Stream], base: str | None) -> str:
    if base is not None:
        return _lookup(named, base).name
    first = [name for name in BASE_ORDER if name in named]
    return first[0] if first else max(named, key=lambda name: len(named[name]))


def _check_order(streams: Iterable[Stream], disorder: Disorder) -> list[str]:
    """Refuse backward stamps, or say how many there are."""
    remarks = []
    for s in streams:
        back = np.flatnonzero(np.diff(s.stamp) < 0)
        if not back.size:
            continue
        found = f"{back.size} stamps of {s.source or s.name} run backwards, the first at sample {back[0] + 2}"
        if disorder == "refuse":
            raise LogError(
                f"{found}.", hint="Read with disorder='drop', or set bag.clock = 'receive' in a mapping file."
            )
        remarks.append(f"{found} ({'left out' if disorder == 'drop' else 'kept'}).")
    return remarks


def _say_repeated(lead: Stream) -> list[str]:
    again = int((np.diff(lead.stamp) == 0).sum())
    return [f"{again} samples of {lead.name} repeat the stamp before and were dropped."] if again else []


def _exists(values: PoseSignal | FloatArray) -> BoolArray:
    """Mask of rows that hold anything."""
    table = values.position if isinstance(values, PoseSignal) else values.reshape(len(values), -1)
    return np.asarray(np.isfinite(table).any(axis=1))


def _with_partner(
    lead: Stream, partners: Mapping[str, Stream], values: Mapping[str, PoseSignal | FloatArray]
) -> BoolArray:
    """Rows of the base for which at least one other signal has a value."""
    if not partners:
        return np.ones(len(lead), dtype=np.bool_)
    keep = np.asarray(np.any([_exists(v) for v in values.values()], axis=0))
    if not keep.any():
        spans = "; ".join(f"{s.name} {s.stamp.min():.6g} to {s.stamp.max():.6g} s" for s in (lead, *partners.values()))
        raise LogError(
            f"the signals share no time: {spans}.",
            hint="Their clocks differ: set bag.clock = 'receive' in a mapping file, or give bag.shifts.",
        )
    return keep
