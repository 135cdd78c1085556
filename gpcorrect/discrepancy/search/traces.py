"""What each candidate would leave in the channels: its signature, taken through the simulator."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.trial import signature
from gpcorrect.parallel import each
from gpcorrect.types import BoolArray, FloatArray, Progress

__all__ = ["Trace", "traces_of"]

TRACE = 0.02  # of the noise: a signature below leaves none


@dataclass(frozen=True, eq=False)
class Trace:
    """A candidate's mark.

    Parameters
    ----------
    candidate : Candidate
        At its start.
    change : (m, c, a) array
        Of the condensed channels, a column for each amplitude.
    touched : (c,) bool array
        Channels in which it is more than a fiftieth of the noise.
    """

    candidate: Candidate
    change: FloatArray
    touched: BoolArray


def traces_of(
    bench: Bench,
    candidates: Iterable[Candidate],
    members: Sequence[Member],
    std: FloatArray,
    progress: Progress | None = None,
) -> tuple[list[Trace], list[str]]:
    """Traces of the candidates beside a set, and the labels of those that leave none.

    Parameters
    ----------
    bench : Bench
        Data.
    candidates : iterable of Candidate
        To be tried one by one.
    members : sequence of Member
        The set.
    std : (c,) array
        Noise of each channel.
    progress : Progress, optional
        Told of each candidate.
    """
    base = bench.predict([m.effect for m in members])
    todo = list(candidates)
    changes = each(partial(signature, bench, base, members), todo, progress, "signatures")
    found = [_trace(candidate, change, std) for candidate, change in zip(todo, changes, strict=True)]
    kept = [trace for trace in found if trace is not None]
    silent = [candidate.label for candidate, trace in zip(todo, found, strict=True) if trace is None]
    heard = {t.candidate.label for t in kept}
    return kept, [label for label in dict.fromkeys(silent) if label not in heard]


def _trace(candidate: Candidate, change: FloatArray | None, std: FloatArray) -> Trace | None:
    if change is None or not np.isfinite(change).all():
        return None
    touched: BoolArray = np.sqrt(np.mean(change**2, axis=(0, 2))) > TRACE * std
    return Trace(candidate, change, touched) if touched.any() else None
