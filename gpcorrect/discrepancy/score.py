"""Which effects explain the discrepancy: forward steps by held-out nats, refinement before the next step, backward deletion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gpcorrect.discrepancy.bench import Bench
from gpcorrect.discrepancy.candidates import Candidate, Member
from gpcorrect.discrepancy.evidence import Grams, fold_of, held_out_nats, solve
from gpcorrect.discrepancy.lens import Lens, estimate_noises, lens_on
from gpcorrect.discrepancy.trial import FOLDS, Trial, held_out, refine, signature, try_set
from gpcorrect.types import BoolArray, FloatArray, Progress

__all__ = [
    "Ranked",
    "Search",
    "Step",
    "contribution",
    "penalty",
    "rank",
    "refitted",
    "refreshed",
    "search",
    "start_search",
    "touch_alike",
    "touched_channels",
    "with_member",
]

PRIOR = 0.01  # probability that any effect at all is added, before its share among the candidates
ROUNDS = 4  # at most one effect a joint in each
REFINED = 3  # leaders that are refined before one is chosen
TRACE = 0.02  # of the noise: a signature below leaves none
FREE_TOGETHER = 8  # members that are refitted with a new one


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
    candidates : tuple of (Candidate, (m, c, a) array)
        Those that leave a trace, with their signatures in the nominal machine.
    members : tuple of Member
        What was found so far.
    silent : tuple of str
        Labels of candidates that leave no trace in these channels.
    waterfall : tuple of (label, nats)
        Steps taken.
    """

    bench: Bench
    lens: Lens
    observed: FloatArray
    candidates: tuple[tuple[Candidate, FloatArray], ...]
    members: tuple[Member, ...] = ()
    silent: tuple[str, ...] = ()
    waterfall: tuple[Step, ...] = ()

    @property
    def n_kinds(self) -> int:
        """Number of different things that could be named."""
        return len({c.key for c, _ in self.candidates})


@dataclass(frozen=True)
class Step:
    """One step of the search: what was added (or, with negative nats, taken out), and its held-out nats."""

    label: str
    nats: float


@dataclass(frozen=True, eq=False)
class Ranked:
    """A candidate's linear gain beyond a set, and the factors of its amplitudes."""

    candidate: Candidate
    nats: float
    factors: FloatArray = field(default_factory=lambda: np.ones(1))

    @property
    def member(self) -> Member:
        """The candidate at its first estimate."""
        return Member(self.candidate, self.candidate.scaled(self.factors))


def penalty(n_kinds: int, round_number: int = 0) -> float:
    """Nats that an effect must gain: ln(K / p), p halved every round."""
    return float(np.log(max(n_kinds, 1) / (PRIOR / 2**round_number)))


def start_search(
    bench: Bench, candidates: Iterable[Candidate], members: Sequence[Member] = (), progress: Progress | None = None
) -> Search:
    """Take every candidate's signature through the simulator, and set those aside that leave no trace."""
    residual = bench.residual([m.effect for m in members])
    discovery = bench.part == 0
    noises = estimate_noises(bench, residual, discovery)
    lens = lens_on(bench, residual, discovery, noises)
    base = bench.predict([m.effect for m in members])
    observed = bench.residual() + bench.predict()
    std = np.array([n.std for n in noises])
    kept, silent = [], []
    todo = list(candidates)
    for i, candidate in enumerate(todo):
        change = signature(bench, base, members, candidate)
        if change is not None and (np.sqrt(np.nanmean(change**2, axis=(0, 2))) > TRACE * std).any():
            kept.append((candidate, change))
        else:
            silent.append(candidate.label)
        if progress is not None:
            progress.step("signatures", (i + 1) / len(todo))
    heard = {c.label for c, _ in kept}
    quiet = tuple(dict.fromkeys(label for label in silent if label not in heard))
    return Search(bench, lens, observed, tuple(kept), tuple(members), quiet)


def rank(search: Search, trial: Trial, without: Sequence[Candidate] = ()) -> list[Ranked]:
    """Linear held-out gain of every candidate beyond a set, the best variant of each, largest first.

    Parameters
    ----------
    search : Search
        Data and signatures.
    trial : Trial
        The set, whose numbers move along with the candidate's.
    without : sequence of Candidate
        Not to be looked at, whatever their numbers.
    """
    taken = {m.candidate.key for m in trial.members} | {c.key for c in without}
    lens, slopes = search.lens, trial.slopes
    p = slopes.shape[1]
    fold = fold_of(int(lens.block.max()) + 1, FOLDS)
    base = lens.grams(slopes, trial.z)
    base_nats = float(held_out_nats(base, fold).sum()) if p else 0.0
    best: dict[tuple[object, ...], Ranked] = {}
    for candidate, change in search.candidates:
        if candidate.key in taken:
            continue
        seen = lens.look(change)
        sums = _joined(base, lens.grams(np.concatenate([seen, slopes], axis=1), trial.z), seen.shape[1])
        factors = solve(sums.gram.sum(axis=0), sums.moment.sum(axis=0))[p:]
        if not _is_physical(candidate, factors):
            continue
        nats = float(held_out_nats(sums, fold).sum()) - base_nats
        if candidate.key not in best or nats > best[candidate.key].nats:
            best[candidate.key] = Ranked(candidate, nats, factors)
    return sorted(best.values(), key=lambda r: -r.nats)


def _joined(base: Grams, both: Grams, n_new: int) -> Grams:
    """Sums with the set's columns first."""
    p = base.gram.shape[1]
    return both.take([*range(n_new, n_new + p), *range(n_new)])


def _is_physical(candidate: Candidate, factors: FloatArray) -> bool:
    """Whether amplitudes that cannot be negative are not."""
    one_sided = [candidate.coordinates[i] for i in candidate.amplitudes]
    return all(f > 0 for c, f in zip(one_sided, factors, strict=True) if c.parameter.positive or c.kind == "inverse")


def search(state: Search, *, rounds: int = ROUNDS, progress: Progress | None = None) -> Search:
    """Add effects while they pay, at most one a joint in each round, and take out those that no longer do.

    Parameters
    ----------
    state : Search
        Where to start.
    rounds : int
        At most.
    progress : Progress, optional
        Told of each round.

    Returns
    -------
    Search
        With the members found.
    """
    for number in range(rounds):
        threshold = penalty(state.n_kinds, number)
        joints: set[int | str] = set()
        before = len(state.waterfall)
        while (grown := _forward(state, threshold, joints)) is not None:
            state = grown
        state = refreshed(_backward(state, threshold))
        if progress is not None:
            progress.step("search", (number + 1) / rounds)
        if len(state.waterfall) == before:
            break
    if progress is not None:
        progress.step("search", 1.0)
    return state


def _forward(state: Search, threshold: float, joints: set[int | str]) -> Search | None:
    """Add the best of the refined leaders on a joint that is still open in this round; None when none pays."""
    trial = try_set(state.bench, state.lens, state.observed, state.members)
    ranked = [r for r in rank(state, trial) if r.candidate.joint not in joints and r.nats > 0]
    leaders = ranked[:1] + [r for r in ranked[1:] if touch_alike(state, r.candidate, ranked[0].candidate)]
    best: tuple[float, tuple[Member, ...], str] | None = None
    for leader in leaders[:REFINED]:
        members = with_member(state, state.members, leader.member)
        tried = try_set(state.bench, state.lens, state.observed, members)
        gain = float(
            held_out(state.lens, trial.z, tried.z, tried.slopes).sum()
            - held_out(state.lens, trial.z, trial.z, trial.slopes).sum()
        )
        if best is None or gain > best[0]:
            best = (gain, members, leader.candidate.label)
            joint = leader.candidate.joint
    if best is None or best[0] < threshold:
        return None
    joints.add(joint)
    grown = replace(state, members=best[1], waterfall=(*state.waterfall, Step(best[2], best[0])))
    return refreshed(grown)


def with_member(state: Search, members: Sequence[Member], new: Member) -> tuple[Member, ...]:
    """Return the set with one more, refitted together with those that show in the same channels."""
    alike = [m for m in members if touch_alike(state, m.candidate, new.candidate)][-FREE_TOGETHER:]
    fixed = [m for m in members if not any(m is a for a in alike)]
    return (*fixed, *refine(state.bench, state.lens, state.observed, fixed, [*alike, new]))


def touch_alike(state: Search, a: Candidate, b: Candidate) -> bool:
    """Whether two candidates show in a common channel."""
    return bool((touched_channels(state, a) & touched_channels(state, b)).any())


def touched_channels(state: Search, candidate: Candidate) -> BoolArray:
    """Mask `(c,)` of the channels in which a candidate leaves a trace."""
    std = np.array([n.std for n in state.lens.noises])
    for other, change in state.candidates:
        if other.key == candidate.key:
            touched: BoolArray = np.sqrt(np.nanmean(change**2, axis=(0, 2))) > TRACE * std
            return touched
    return np.ones(len(std), dtype=np.bool_)


def refreshed(state: Search) -> Search:
    """Estimate the noise anew from what the set leaves, and look through it."""
    residual = state.observed - state.bench.predict([m.effect for m in state.members])
    discovery = state.bench.part == 0
    noises = estimate_noises(state.bench, residual, discovery)
    return replace(state, lens=lens_on(state.bench, residual, discovery, noises))


def _backward(state: Search, threshold: float) -> Search:
    """Take out members that the others make superfluous, the least useful first."""
    while len(state.members) > 1:
        worth = [contribution(state, i) for i in range(len(state.members))]
        least = int(np.argmin(worth))
        if worth[least] >= threshold:
            break
        label = state.members[least].candidate.label
        members = (*state.members[:least], *state.members[least + 1 :])
        state = replace(state, members=members, waterfall=(*state.waterfall, Step(f"without {label}", -worth[least])))
    return state


def contribution(state: Search, index: int) -> float:
    """Held-out nats that the set loses without one member, the others refitted to first order."""
    full = try_set(state.bench, state.lens, state.observed, state.members)
    rest = (*state.members[:index], *state.members[index + 1 :])
    bare = try_set(state.bench, state.lens, state.observed, rest)
    with_it = held_out(state.lens, bare.z, full.z, full.slopes).sum()
    return float(with_it - held_out(state.lens, bare.z, *refitted(state.lens, bare)).sum())


def refitted(lens: Lens, trial: Trial) -> tuple[FloatArray, FloatArray]:
    """Residual of a set after one linear refit of its numbers, and its tangents."""
    sums = lens.grams(trial.slopes, trial.z)
    shift = solve(sums.gram.sum(axis=0), sums.moment.sum(axis=0))
    return trial.z - trial.slopes @ shift, trial.slopes
