"""What each candidate would leave in the channels: its signature, taken through the simulator."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.trial import signature
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
    kept, silent = [], []
    todo = list(candidates)
    for i, candidate in enumerate(todo):
        trace = _trace(bench, base, members, candidate, std)
        if trace is None:
            silent.append(candidate.label)
        else:
            kept.append(trace)
        if progress is not None:
            progress.step("signatures", (i + 1) / len(todo))
    heard = {t.candidate.label for t in kept}
    return kept, [label for label in dict.fromkeys(silent) if label not in heard]


def _trace(
    bench: Bench, base: FloatArray, members: Sequence[Member], candidate: Candidate, std: FloatArray
) -> Trace | None:
    change = signature(bench, base, members, candidate)
    if change is None or not np.isfinite(change).all():
        return None
    touched: BoolArray = np.sqrt(np.mean(change**2, axis=(0, 2))) > TRACE * std
    return Trace(candidate, change, touched) if touched.any() else None
