"""Where a search stands, and how it looks on both its parts: whitened data, candidates' signatures, effects so far."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Self

import numpy as np

from gpcorrect.discrepancy.evidence.whitener import DatasetWhitener, whitener_on
from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.instants import with_open_instant_placed
from gpcorrect.discrepancy.search.linearisation import Linearisation, linearise, refine, signature
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.errors import DataError
from gpcorrect.parallel import each
from gpcorrect.types import BoolArray, FloatArray, Progress


@dataclass(frozen=True, eq=False)
class Change:
    """Change of the channels in which it is anything at all: most effects show in few."""

    shown: BoolArray  # (c,) which ones those are, s of them
    columns: FloatArray  # (m, s, a) a column for each amplitude

    @classmethod
    def of(cls, whole: FloatArray) -> Self:
        """Return the change of channels that is `(m, c, a)` in all of them."""
        shown = np.asarray(whole.any(axis=(0, 2)))
        return cls(shown, whole[:, shown])


@dataclass(frozen=True, eq=False)
class Trace:
    """A candidate's signature at its start."""

    candidate: Candidate
    change: Change
    touched: BoolArray  # (c,) channels in which it is more than a fiftieth of the noise


@dataclass(frozen=True)
class Step:
    """One step of the search: what was added (or, with negative nats, taken out), and its held-out nats."""

    label: str
    nats: float


@dataclass(frozen=True, eq=False)
class Search:
    """State of the search."""

    whitener: DatasetWhitener  # data, and how the discovery part is whitened now
    traces: tuple[Trace, ...]  # of the candidates that leave one in the nominal machine
    fitted: tuple[FittedEffect, ...] = ()  # what was found so far
    without_trace: tuple[Candidate, ...] = ()  # one of each label whose candidates leave no trace in these channels
    waterfall: tuple[Step, ...] = ()  # the steps taken
    whitened_by: tuple[FittedEffect, ...] = ()  # whose rest the noise was estimated from last: sets change more often

    @property
    def dataset(self) -> Dataset:
        """The condensed recording."""
        return self.whitener.dataset

    @property
    def n_kinds(self) -> int:
        """Number of different things that could be named."""
        return len({t.candidate.key for t in self.traces})

    def residual(self, fitted: Sequence[FittedEffect]) -> FloatArray:
        """Return measured minus simulated `(m, c)`.

        Parameters
        ----------
        fitted : sequence of FittedEffect
        """
        return self.dataset.observed - self.dataset.predict([f.effect for f in fitted])

    def touched(self, candidate: Candidate) -> BoolArray:
        """Return the mask `(c,)` of the channels in which a candidate leaves a trace.

        Parameters
        ----------
        candidate : Candidate
        """
        known = self._touched.get(candidate.key)
        return np.ones(len(self.whitener.noises), dtype=np.bool_) if known is None else known

    @cached_property
    def _touched(self) -> dict[Hashable, BoolArray]:
        """Channels of the first trace of each key."""
        return {t.candidate.key: t.touched for t in reversed(self.traces)}

    def shown(self, candidates: Iterable[Candidate]) -> BoolArray:
        """Return the mask `(c,)` of the channels in which one of some candidates is anything at all.

        Parameters
        ----------
        candidates : iterable of Candidate
        """
        keys = {c.key for c in candidates}
        seen = [t.change.shown for t in self.traces if t.candidate.key in keys]
        known = {t.candidate.key for t in self.traces} >= keys
        return np.any(seen, axis=0) if seen and known else np.ones(len(self.whitener.noises), dtype=np.bool_)

    def alike(self, a: Candidate, b: Candidate) -> bool:
        """Return whether two candidates show in a common channel.

        Parameters
        ----------
        a, b : Candidate
        """
        return bool((self.touched(a) & self.touched(b)).any())

    def parted(
        self, fitted: Sequence[FittedEffect], candidate: Candidate
    ) -> tuple[list[FittedEffect], list[FittedEffect]]:
        """Return the effects that show in no channel of a candidate, and those that do.

        Of many that do, its own fit and the latest of the others; the rest of them stand among the first.

        Parameters
        ----------
        fitted : sequence of FittedEffect
        candidate : Candidate
        """
        near = [i for i, f in enumerate(fitted) if self.alike(f.candidate, candidate)]
        last = sorted(near, key=lambda i: (fitted[i].candidate.key == candidate.key, i))
        free = set(last[-SEARCH.free_together :])
        return [f for i, f in enumerate(fitted) if i not in free], [fitted[i] for i in sorted(free)]

    def linearise_near(self, fitted: Sequence[FittedEffect], candidate: Candidate) -> Linearisation:
        """Return a set with tangents of those effects that show in a candidate's channels.

        Parameters
        ----------
        fitted : sequence of FittedEffect
        candidate : Candidate
        """
        fixed, near = self.parted(fitted, candidate)
        return linearise(self.whitener, near, fixed)

    def refit(
        self, fitted: Sequence[FittedEffect], candidate: Candidate, worth: float = np.inf
    ) -> tuple[FittedEffect, ...]:
        """Return a set with the numbers fitted anew that show in a candidate's channels.

        Parameters
        ----------
        fitted : sequence of FittedEffect
        candidate : Candidate
        worth : float, misfit that somebody asks for: a fit that will not come there ends early
        """
        fixed, near = self.parted(fitted, candidate)
        return (
            *fixed,
            *refine(self.whitener, fixed, near, worth=worth, channels=self.shown(f.candidate for f in near)),
        )

    def refit_with(
        self, others: Sequence[FittedEffect], new: FittedEffect, worth: float = np.inf
    ) -> tuple[FittedEffect, ...] | None:
        """Return others with a new effect, fitted anew; None where that is no machine, or only at a bound.

        Parameters
        ----------
        others : sequence of FittedEffect
        new : FittedEffect, comes last
        worth : float, as for :meth:`refit`
        """
        try:
            fitted = self.refit((*others, new), new.candidate, worth)
        except DataError:
            return None
        return None if fitted[-1].at_edge else fitted

    def whitened(self, change: Change) -> FloatArray:
        """Return a change whitened in the rows of all channels `(M, a)`.

        Parameters
        ----------
        change : Change
        """
        white = np.zeros((len(self.whitener.weight), change.columns.shape[2]))
        white[change.shown[self.whitener.channel]] = self.whitener.whiten_columns(change.columns, change.shown)
        return white

    def misfit(self, fitted: Sequence[FittedEffect]) -> float:
        """Return half the sum of squares of what a set leaves, in nats.

        Parameters
        ----------
        fitted : sequence of FittedEffect
        """
        z = self.whitener.whiten(self.residual(fitted))
        return 0.5 * float(z @ z)

    def refreshed(self) -> Search:
        """Estimate the noise anew from what the set leaves, and whiten with that."""
        residual = self.residual(self.fitted)
        whitener = whitener_on(self.dataset, residual, self.dataset.discovery)
        return replace(self, whitener=whitener, whitened_by=self.fitted)

    def overdispersion(self, z: FloatArray, channels: BoolArray) -> float:
        """Return the mean square of a residual in units of the noise, 1 at least: evidence is divided by it.

        Parameters
        ----------
        z : (M,) array, whitened residual
        channels : (c,) bool array, those to take it over
        """
        rows = channels[self.whitener.channel]
        return max(1.0, float(np.mean(z[rows] ** 2))) if rows.any() else 1.0


def penalty(n_kinds: int, round_number: int = 0) -> float:
    """Return the nats that an effect must gain: ln(K / p), p halved every round.

    Parameters
    ----------
    n_kinds : int, K, the number of things that could be named
    round_number : int, of the search, from 0
    """
    return float(np.log(max(n_kinds, 1) / (SEARCH.prior / 2**round_number)))


def start_search(dataset: Dataset, candidates: Iterable[Candidate], progress: Progress | None = None) -> Search:
    """Take every candidate's signature through the simulator, and set those aside that leave no trace.

    Parameters
    ----------
    dataset : Dataset
    candidates : iterable of Candidate
    progress : Progress, optional
    """
    whitener = whitener_on(dataset, dataset.residual(), dataset.discovery)
    todo = list(candidates)
    changes = each(partial(signature, dataset, dataset.predict(near=())), todo, progress, "signatures")
    traces: list[Trace] = []
    silent: dict[str, Candidate] = {}
    for candidate, change in zip(todo, changes, strict=True):
        touched = np.zeros(len(whitener.noises), dtype=np.bool_)
        if change is not None and np.isfinite(change).all():
            touched = np.sqrt(np.mean(change**2, axis=(0, 2))) > SEARCH.trace * whitener.std
        if change is not None and touched.any():
            traces.append(Trace(candidate, Change.of(change), touched))
        else:
            silent.setdefault(candidate.label, candidate)
    active = {t.candidate.label for t in traces}
    return Search(whitener, tuple(traces), (), tuple(c for label, c in silent.items() if label not in active))


@dataclass(frozen=True, eq=False)
class View:
    """A search with the recording that it was made on, and the whitener of its confirmation part."""

    search: Search
    prepared: PreparedData
    confirmation: DatasetWhitener

    def whitened_residuals(self, fitted: Sequence[FittedEffect]) -> tuple[FloatArray, FloatArray]:
        """Return the whitened residual of a set on discovery and confirmation.

        Parameters
        ----------
        fitted : sequence of FittedEffect, the set
        """
        placed = [self.placed(fitted, fit)[0] for fit in fitted]
        discovery, confirmation = self.whitened(self.search.residual(placed)[:, :, None])
        return discovery[:, 0], confirmation[:, 0]

    def placed(self, fitted: Sequence[FittedEffect], fit: FittedEffect) -> tuple[FittedEffect, float]:
        """Return an effect with the instant that confirmation shows where discovery leaves it open, and its price.

        That are the nats which the choice among so many instants costs the confirmation part.

        Parameters
        ----------
        fitted : sequence of FittedEffect, the set
        fit : FittedEffect, one of them
        """
        if fit.candidate.instant is None:
            return fit, 0.0
        others = [m for m in fitted if m is not fit]
        found, instants = with_open_instant_placed(self.confirmation, others, fit, self.search.dataset.discovery)
        return found, float(np.log(instants))

    def whitened(self, columns: FloatArray, channels: BoolArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Return columns of some channels, by default of all, whitened on discovery and confirmation.

        Parameters
        ----------
        columns : (m, s, k) array, of the s channels that are asked for
        channels : (c,) bool array, which ones those are
        """
        discovery, confirmation = (
            w.whiten_columns(columns, channels) for w in (self.search.whitener, self.confirmation)
        )
        return discovery, confirmation


def view_of(search: Search, prepared: PreparedData) -> View:
    """Whiten the confirmation part with the noise of discovery.

    Parameters
    ----------
    search : Search
    prepared : PreparedData
    """
    residual = search.residual(search.fitted)
    confirmation = whitener_on(search.dataset, residual, search.dataset.confirmation, search.whitener.noises)
    return View(search, prepared, confirmation)
