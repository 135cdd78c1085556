"""What an arm can do from one sample to another, and the pieces of a recording between impossible steps.

An occlusion shows as two false velocities around a block: an impossible step in and another out. Neither step tells
which side is wrong; the chain of pieces that hang together by possible steps and explain most samples does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from scipy.ndimage import maximum_filter1d

from gpcorrect.cleaning.report import Reason
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.signals import Samples
from gpcorrect.cleaning.smooth import Residual
from gpcorrect.robust import robust_scale
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

# The constants here were chosen by hand on the simulated recordings of bench/cleaning_faults.py.
FAST_QUANTILE = 0.999  # the fastest command, but for the odd sample of a setpoint that steps
SLOWEST = {"P": 0.05, "R": float(np.radians(30.0))}  # m/s, rad/s: below these no speed of an arm is impossible
SPEED_REASONS = {"P": Reason.SPEED, "R": Reason.ANGULAR_SPEED}
REACH = 200  # pieces that a chain looks back: bounds the time, which grows with it
RETURN_FRACTION = 0.3  # steps in and out that cancel to within this fraction are one excursion


@dataclass(frozen=True, eq=False)
class StepThresholds:
    """Limits on steps that no working arm and sensor exceed, learned from training data.

    The observation moves at most at `speeds`, beyond the step that noise can feign. The error changes by at most
    `noise` plus `follow` times the commanded travel, and never by more than `cap`: an arm that sticks while commanded
    to move, or springs back, changes its error no faster than that; a marker that is lost, occluded or mistaken for
    another does.
    """

    units: str  # "P" or "R" for each of g groups
    noise: FloatArray  # (g,) largest step of the error that noise makes, m and rad
    speeds: FloatArray  # (g,) largest observed speed, m/s and rad/s
    follow: float  # times the commanded travel that the error may step besides
    cap: FloatArray  # (g,) largest difference of any two errors, m and rad

    @classmethod
    def learn(cls, samples: Samples, residual: Residual, settings: CleaningSettings) -> Self:
        """Return limits: noise from the median step of the error, speeds from the settings or the fastest commands.

        Parameters
        ----------
        samples : Samples, training samples, faults among them
        residual : Residual, what the smooth model leaves of their error
        settings : CleaningSettings, Factors, floors, and speeds if given
        """
        inside = samples.run[1:] == samples.run[:-1]
        steps = np.linalg.norm(np.diff(residual.left, axis=0)[inside], axis=2)
        noise, fastest = settings.resolution(samples.units), np.zeros(len(samples.units))
        if len(steps):
            noise = np.maximum(robust_scale(steps, samples.error.shape[2]), noise)
            fastest = np.quantile(_commanded_speeds(samples)[0][inside], FAST_QUANTILE, axis=0)
        given = {"P": settings.max_speed, "R": settings.max_angular_speed}
        speeds = [
            given[unit] or max(settings.speed_factor * float(own), SLOWEST[unit])
            for unit, own in zip(samples.units, fastest, strict=True)
        ]
        return cls(
            units=samples.units,
            noise=frozen_array(settings.step_factor * noise),
            speeds=frozen_array(speeds),
            follow=settings.follow_factor,
            cap=frozen_array(settings.step_factor * np.sqrt(2.0) * residual.scale),
        )

    @property
    def limits(self) -> list[tuple[Reason, float]]:
        """Reason and limit of each column of :meth:`Path.ratios`: speeds first, then steps of the error."""
        speeds = [(SPEED_REASONS[unit], float(speed)) for unit, speed in zip(self.units, self.speeds, strict=True)]
        return [*speeds, *[(Reason.JUMP, 1.0)] * len(self.units)]


@dataclass(frozen=True, eq=False)
class Path:
    """Samples, how far they were commanded to travel, and what steps they can take."""

    samples: Samples  # n samples
    error: FloatArray  # (n, g, w) their error, or what a smooth model leaves of it, m and rad
    thresholds: StepThresholds  # limits on their steps
    # (n, g) commanded travel since the first sample, m and rad, at the largest speed of each sample's neighbourhood:
    # what an arm that follows late can have moved
    travel: FloatArray

    @classmethod
    def of(cls, samples: Samples, error: FloatArray, thresholds: StepThresholds, response_time: float) -> Self:
        """Return the path of samples whose arm follows within a time.

        Parameters
        ----------
        samples, error, thresholds
            See above.
        response_time : float, s
        """
        speed, dt = _commanded_speeds(samples)
        if not len(dt):
            return cls(samples, error, thresholds, np.zeros((len(samples), speed.shape[1])))
        width = 2 * int(np.clip(np.ceil(response_time / max(np.median(dt), 1e-9)), 1, len(dt))) + 1
        steps = maximum_filter1d(speed, width, axis=0, mode="nearest") * dt[:, None]
        travel = np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
        return cls(samples, error, thresholds, travel)

    def ratios(self, i: IntArray, j: IntArray) -> FloatArray:
        """Return steps (m, 2 g) between samples, as multiples of the largest that are possible.

        Parameters
        ----------
        i, j : (m,) array, sample numbers, j later than i
        """
        samples, limits = self.samples, self.thresholds
        moved = np.maximum(samples.steps(samples.observed, i, j) - limits.noise, 0.0)
        speed = moved / (samples.time[j] - samples.time[i])[:, None] / limits.speeds
        step = np.linalg.norm(self.error[j] - self.error[i], axis=2)
        travel = np.abs(self.travel[j] - self.travel[i])
        plausible = np.maximum(np.minimum(limits.noise + limits.follow * travel, limits.cap), limits.noise)
        return np.hstack([speed, step / plausible])

    def possible(self, i: IntArray, j: IntArray) -> BoolArray:
        """Return the mask (m,) of steps that break no limit.

        Parameters
        ----------
        i, j : (m,) array, sample numbers, j later than i
        """
        return np.asarray(self.ratios(i, j).max(axis=1) <= 1.0)


def _commanded_speeds(samples: Samples) -> tuple[FloatArray, FloatArray]:
    """Commanded speeds (n - 1, g), m/s and rad/s, from sample to sample, 0 across runs, and time steps (n - 1,), s."""
    i = np.arange(len(samples) - 1)
    inside = samples.run[1:] == samples.run[:-1]
    dt = np.where(inside, np.diff(samples.time), 0.0)
    speed: FloatArray = samples.steps(samples.command, i, i + 1) / np.where(inside, dt, np.inf)[:, None]
    return speed, dt


@dataclass(frozen=True, eq=False)
class Pieces:
    """m stretches of samples without an impossible step."""

    label: IntArray  # (n,) piece that each sample belongs to
    # (m,) each: first and last sample of each piece
    first: IntArray
    last: IntArray
    run: IntArray  # (m,) run that each piece lies in
    # (m,) step into the piece from the sample before, as a multiple of the largest possible; 0 at the start of a run
    ratio: FloatArray
    cause: IntArray  # (m,) which limit that step breaks

    def __len__(self) -> int:
        return len(self.first)

    @property
    def counts(self) -> IntArray:
        """(m,) samples in each piece."""
        return self.last - self.first + 1


def split_pieces(path: Path) -> Pieces:
    """Cut the samples where a run ends or a step breaks a limit.

    Parameters
    ----------
    path : Path, n samples
    """
    n, run = len(path.samples), path.samples.run
    i = np.flatnonzero(run[1:] == run[:-1])
    ratios = np.zeros((n, len(path.thresholds.limits)))
    ratios[i + 1] = path.ratios(i, i + 1)
    worst = ratios.max(axis=1)
    starts = worst > 1.0
    starts[0] = True
    starts[1:] |= run[1:] != run[:-1]
    first = np.flatnonzero(starts)
    # A sample names the first limit that it breaks: a speed before a step of the error.
    cause = np.where(worst > 1.0, (ratios > 1.0).argmax(axis=1), 0)[first]
    return Pieces(np.cumsum(starts) - 1, first, np.append(first[1:], n) - 1, run[first], ratios[first, cause], cause)


def largest_chain(pieces: Pieces, scores: FloatArray, path: Path, switch_cost: float) -> BoolArray:
    """Return the mask (m,) of the pieces in the chain of greatest total score, a chain for each run.

    Neighbours in a chain are joined by a possible step, or by an impossible one at `switch_cost`. Pieces with a score
    that is not positive are in no chain.

    Parameters
    ----------
    pieces : Pieces, m pieces
    scores : (m,) array, what each is worth, samples
    path : Path
    switch_cost : float, samples
    """
    chained = np.zeros(len(pieces), dtype=bool)
    for chosen in np.split(np.arange(len(pieces)), np.flatnonzero(np.diff(pieces.run)) + 1):
        chosen = chosen[scores[chosen] > 0]
        if len(chosen):
            first, last = pieces.first[chosen], pieces.last[chosen]
            chain = best_chain(scores[chosen], first, last, path.possible, switch_cost)
            chained[chosen[chain]] = True
    return chained


def best_chain(
    scores: FloatArray,
    first: IntArray,
    last: IntArray,
    possible: Callable[[IntArray, IntArray], BoolArray],
    switch_cost: float = np.inf,
) -> IntArray:
    """Return which of m pieces, in order, are the chain of greatest total score.

    Dynamic programming over the last `REACH` pieces.

    Parameters
    ----------
    scores : (m,) array, positive
    first, last : (m,) int arrays, first and last sample of each
    possible : callable, from samples i and later samples j to the mask of possible steps
    switch_cost : float, of an impossible step in the chain
    """
    best, before = scores.astype(np.float64), np.full(len(scores), -1)
    for k in range(1, len(scores)):
        low = max(0, k - REACH)
        steps = possible(last[low:k], np.full(k - low, first[k]))
        gain = best[low:k] - np.where(steps, 0.0, switch_cost)
        choice = int(np.argmax(gain))
        if gain[choice] > 0:
            best[k] += gain[choice]
            before[k] = low + choice
    chain = [int(np.argmax(best))]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1])


def excursions(pieces: Pieces, candidates: BoolArray, path: Path, residual: FloatArray, occlusion: float) -> BoolArray:
    """Return the mask (m,) of pieces that lie between two impossible steps which cancel, found shortest first.

    Two independent steps do not cancel in three or six numbers; a marker that is lost and found again does that.
    Longer than an occlusion, it must also stand out: by half of the step or more from what the smooth model expects.

    Parameters
    ----------
    pieces, candidates : Pieces, (m,) bool array, all pieces, and those that may be motions
    path : Path
    residual : (n, g, w) array, what the smooth model leaves of the error
    occlusion : float, samples of the longest occlusion
    """
    dropped = np.zeros(len(pieces), dtype=bool)
    stretches: list[_Stretch] = []
    for k in np.flatnonzero(candidates):
        first, last = int(pieces.first[k]), int(pieces.last[k])
        _append(stretches, _Stretch(first, last, last - first + 1, [int(k)], int(pieces.run[k])), path)
    while (inside := _shortest_excursion(stretches, path, residual, occlusion)) is not None:
        dropped[[piece for stretch in stretches[inside] for piece in stretch.pieces]] = True
        # What lies around is joined where the step is possible: no impossible step is left there.
        after = stretches[inside.stop :]
        stretches = stretches[: inside.start]
        _append(stretches, after[0], path)
        stretches += after[1:]
    return dropped


@dataclass(frozen=True)
class _Stretch:
    """Pieces of one run that are one motion: from sample `first` to sample `last`, `count` samples in all."""

    first: int
    last: int
    count: int
    pieces: list[int]
    run: int


def _append(stretches: list[_Stretch], new: _Stretch, path: Path) -> None:
    """Append a stretch, as a part of the last one where the step from that is possible."""
    last = stretches[-1] if stretches else None
    if last and last.run == new.run and path.possible(np.array([last.last]), np.array([new.first]))[0]:
        stretches[-1] = _Stretch(last.first, new.last, last.count + new.count, last.pieces + new.pieces, last.run)
    else:
        stretches.append(new)


def _shortest_excursion(stretches: list[_Stretch], path: Path, residual: FloatArray, occlusion: float) -> slice | None:
    """Positions of the fewest samples that are left as they were entered, with pauses but no other steps between."""
    scaled = (path.error / path.thresholds.noise[:, None]).reshape(len(path.error), -1)
    inner = [k for k, (a, b) in enumerate(pairwise(stretches)) if a.run == b.run]
    found = []
    for a, b in pairwise(inner):
        step_in, step_out = (scaled[stretches[k + 1].first] - scaled[stretches[k].last] for k in (a, b))
        height = min(np.linalg.norm(step_in), np.linalg.norm(step_out))
        inside = slice(a + 1, b + 1)
        count = sum(stretch.count for stretch in stretches[inside])
        if (
            np.linalg.norm(step_in + step_out) <= 0.5 + RETURN_FRACTION * height
            and count < len(residual) / 2
            and (count <= occlusion or _stands_out(stretches[a : b + 2], residual.reshape(len(residual), -1)))
        ):
            found.append((count, inside))
    return min(found, key=lambda excursion: excursion[0])[1] if found else None


def _stands_out(stretches: list[_Stretch], residual: FloatArray) -> bool:
    """Whether the smooth model misses all but the outer stretches by half of the steps that bound them, or more."""
    before, *inner, after = stretches
    step_in = residual[inner[0].first] - residual[before.last]
    step_out = residual[after.first] - residual[inner[-1].last]
    step = (step_in - step_out) / 2
    inside = np.vstack([residual[s.first : s.last + 1] for s in inner])
    outside = np.vstack([residual[s.first : s.last + 1] for s in (before, after)])
    return bool((np.median(inside, axis=0) - np.median(outside, axis=0)) @ step >= 0.5 * (step @ step))
