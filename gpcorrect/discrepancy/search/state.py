"""Where a search stands: data, the lens, what can be named, and what was found."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.discrepancy.evidence.lens import Lens, estimate_noises, lens_on
from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.traces import Trace, traces_of
from gpcorrect.discrepancy.search.trial import Trial, refine, try_set
from gpcorrect.types import BoolArray, FloatArray, Progress

__all__ = ["COMPLEXITY", "Search", "Step", "penalty", "start_search"]

PRIOR = 0.01  # probability that any effect at all is added, before its share among the candidates
COMPLEXITY = 4.0  # nats that each parameter beyond an effect's first must bring: limits of one effect are not another
FREE_TOGETHER = 8  # members that are refitted with a new one


@dataclass(frozen=True)
class Step:
    """One step of the search: what was added (or, with negative nats, taken out), and its held-out nats."""

    label: str
    nats: float


@dataclass(frozen=True, eq=False)
class Search:
    """State of the search.

    Parameters
    ----------
    bench : Bench
        Data.
    lens : Lens
        How the discovery part is seen now.
    observed : (m, c) array
        Measured channels, condensed.
    traces : tuple of Trace
        Of the candidates that leave one in the nominal machine.
    members : tuple of Member
        What was found so far.
    silent : tuple of str
        Labels of candidates that leave no trace in these channels.
    waterfall : tuple of Step
        Steps taken.
    """

    bench: Bench
    lens: Lens
    observed: FloatArray
    traces: tuple[Trace, ...]
    members: tuple[Member, ...] = ()
    silent: tuple[str, ...] = ()
    waterfall: tuple[Step, ...] = ()

    @property
    def n_kinds(self) -> int:
        """Number of different things that could be named."""
        return len({t.candidate.key for t in self.traces})

    def residual(self, members: Sequence[Member]) -> FloatArray:
        """Measured minus simulated `(m, c)` with a set."""
        return self.observed - self.bench.predict([m.effect for m in members])

    def touched(self, candidate: Candidate) -> BoolArray:
        """Mask `(c,)` of the channels in which a candidate leaves a trace."""
        for trace in self.traces:
            if trace.candidate.key == candidate.key:
                return trace.touched
        return np.ones(len(self.lens.noises), dtype=np.bool_)

    def alike(self, a: Candidate, b: Candidate) -> bool:
        """Whether two candidates show in a common channel."""
        return bool((self.touched(a) & self.touched(b)).any())

    def parted(self, members: Sequence[Member], candidate: Candidate) -> tuple[list[Member], list[Member]]:
        """Members that show in no channel of a candidate, and those that do (the latest ones, when there are many)."""
        near = [m for m in members if self.alike(m.candidate, candidate)][-FREE_TOGETHER:]
        return [m for m in members if not any(m is n for n in near)], near

    def trial(self, members: Sequence[Member], candidate: Candidate) -> Trial:
        """Return the set with tangents of those members that show in a candidate's channels."""
        fixed, near = self.parted(members, candidate)
        return try_set(self.bench, self.lens, self.observed, near, fixed)

    def whole_trial(self) -> Trial:
        """Return the set with tangents of all its members."""
        return try_set(self.bench, self.lens, self.observed, self.members)

    def refit(self, members: Sequence[Member], candidate: Candidate) -> tuple[Member, ...]:
        """Return the set with the numbers fitted anew that show in a candidate's channels."""
        fixed, near = self.parted(members, candidate)
        return (*fixed, *refine(self.bench, self.lens, self.observed, fixed, near))

    def refreshed(self) -> Search:
        """Estimate the noise anew from what the set leaves, and look through it."""
        residual, rows = self.residual(self.members), self.bench.discovery
        noises = estimate_noises(self.bench, residual, rows)
        return replace(self, lens=lens_on(self.bench, residual, rows, noises))

    def tempering(self, z: FloatArray, channels: BoolArray) -> float:
        """How much larger than noise a seen residual still is in some channels: evidence counts that much less."""
        rows = channels[self.lens.channel]
        return max(1.0, float(np.mean(z[rows] ** 2))) if rows.any() else 1.0


def penalty(n_kinds: int, round_number: int = 0) -> float:
    """Nats that an effect must gain: ln(K / p), p halved every round."""
    return float(np.log(max(n_kinds, 1) / (PRIOR / 2**round_number)))


def start_search(
    bench: Bench, candidates: Iterable[Candidate], members: Sequence[Member] = (), progress: Progress | None = None
) -> Search:
    """Take every candidate's signature through the simulator, and set those aside that leave no trace."""
    residual = bench.residual([m.effect for m in members])
    noises = estimate_noises(bench, residual, bench.discovery)
    lens = lens_on(bench, residual, bench.discovery, noises)
    std = np.array([n.std for n in noises])
    kept, silent = traces_of(bench, candidates, members, std, progress)
    observed = bench.residual() + bench.predict()
    return Search(bench, lens, observed, tuple(kept), tuple(members), tuple(silent))
