"""Which names may be given: the posterior of each effect against none, its rivals and the unknown, and the level that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.candidates import Member
from gpcorrect.discrepancy.cells import Cells
from gpcorrect.discrepancy.evidence import solve
from gpcorrect.discrepancy.lens import Lens, lens_on
from gpcorrect.discrepancy.score import Search, penalty, rank, touch_alike, touched_channels, with_member
from gpcorrect.discrepancy.trial import held_out, refine, try_set
from gpcorrect.discrepancy.unknown import smooth_columns, smooth_fit
from gpcorrect.types import BoolArray, FloatArray, Progress

__all__ = ["Alternative", "EffectLevel", "Named", "half_widths", "name_members", "smooth_nats"]

EffectLevel = Literal["EXACT", "CLASS", "SET", "UNKNOWN", "INCONCLUSIVE"]

RIVALS = 3  # refined for each effect
EXACT = 0.95
STABLE = 0.05  # posterior above which a rival cannot be told apart
CONFIRMED = 3.0  # nats on the confirmation part
POSITIVE_SHARE = 0.6  # of the trajectories
UNKNOWN_SHARE = 0.25  # of an effect's nats, found beside it by the smooth model: then that model competes in full
EXPLAINED = 0.95  # of a signature by the others: not nameable


@dataclass(frozen=True)
class Alternative:
    """One thing that could stand in an effect's place.

    Parameters
    ----------
    label : str
        "nothing", "unknown", or the candidate's.
    name : str
        Canonical name; empty for nothing and unknown.
    joint : int, str or None
        Where.
    family : str
        Class of the effect.
    nats : float
        Held-out, beyond nothing, its penalty taken off.
    probability : float
        Posterior among the alternatives.
    """

    label: str
    name: str
    joint: int | str | None
    family: str
    nats: float
    probability: float = 0.0


@dataclass(frozen=True, eq=False)
class Named:
    """An effect with the level at which it may be named.

    Parameters
    ----------
    member : Member
        The effect.
    level : str
        EXACT, CLASS, SET, UNKNOWN or INCONCLUSIVE.
    probability : float
        Posterior of this very effect.
    nats : float
        Held-out gain, discovery and confirmation.
    alternatives : tuple of Alternative
        With nothing and unknown, most probable first.
    reasons : tuple of str
        Why it is not EXACT.
    """

    member: Member
    level: EffectLevel
    probability: float
    nats: float
    alternatives: tuple[Alternative, ...]
    reasons: tuple[str, ...]

    @property
    def rivals(self) -> tuple[Alternative, ...]:
        """Other effects that cannot be ruled out."""
        own = self.member.candidate.label
        return tuple(a for a in self.alternatives if a.name and a.label != own and a.probability >= STABLE)


@dataclass(frozen=True, eq=False)
class _View:
    """Both parts as they are seen: discovery and confirmation."""

    search: Search
    confirmation: Lens
    cells: Sequence[Sequence[Cells]]


@dataclass(frozen=True, eq=False)
class _Scored:
    """Nats of a set on both parts against a common reference, by block."""

    discovery: FloatArray
    confirmation: FloatArray

    @property
    def nats(self) -> float:
        return float(self.discovery.sum() + self.confirmation.sum())


def name_members(
    search: Search, cells: Sequence[Sequence[Cells]], *, round_number: int = 0, progress: Progress | None = None
) -> tuple[Named, ...]:
    """Weigh every member of a finished search against nothing, its rivals and the unknown.

    Parameters
    ----------
    search : Search
        Finished.
    cells : sequence of sequences of Cells
        Tests of each channel, for the unknown.
    round_number : int
        Round of the penalty.
    progress : Progress, optional
        Told of each member.
    """
    residual = search.observed - search.bench.predict([m.effect for m in search.members])
    confirmation = lens_on(search.bench, residual, search.bench.part == 1, search.lens.noises)
    view = _View(search, confirmation, cells)
    named = []
    for i in range(len(search.members)):
        named.append(_name(view, i, round_number))
        if progress is not None:
            progress.step("naming", (i + 1) / len(search.members))
    return tuple(named)


def _name(view: _View, index: int, round_number: int) -> Named:
    search = view.search
    member = search.members[index]
    rest = (*search.members[:index], *search.members[index + 1 :])
    alike = [m for m in rest if touch_alike(search, m.candidate, member.candidate)]
    fixed = [m for m in rest if not any(m is a for a in alike)]
    bare = (*fixed, *refine(search.bench, search.lens, search.observed, fixed, alike))
    reference = _seen(view, bare)
    own = _scored(view, reference, search.members)
    cost = penalty(search.n_kinds, round_number)
    rivals = _rivals(view, bare, member, reference, cost)
    unknown = _unknown(view, bare, member, own.nats)
    channels = touched_channels(search, member.candidate)
    temper = _temper(view, channels)
    mine = Alternative(
        member.candidate.label,
        member.candidate.name,
        member.candidate.joint,
        member.candidate.family,
        own.nats - cost,
    )
    others = [Alternative("nothing", "", None, "", 0.0), Alternative("unknown", "", None, "", unknown - cost), *rivals]
    weighed = _posterior([mine, *others], temper)
    probability = weighed[0].probability
    reasons = _doubts(view, index, own, cost, temper)
    level, more = _level(weighed, reasons)
    ordered = tuple(sorted(weighed, key=lambda a: -a.probability))
    return Named(member, level, probability, own.nats / temper, ordered, (*reasons, *more))


def _seen(view: _View, members: Sequence[Member]) -> tuple[FloatArray, FloatArray]:
    left = view.search.observed - view.search.bench.predict([m.effect for m in members])
    return view.search.lens.look_one(left), view.confirmation.look_one(left)


def _scored(view: _View, reference: tuple[FloatArray, FloatArray], members: Sequence[Member]) -> _Scored:
    search = view.search
    trial = try_set(search.bench, search.lens, search.observed, members)
    _, after = _seen(view, members)
    discovery = held_out(search.lens, reference[0], trial.z, trial.slopes)
    block = view.confirmation.block
    change = 0.5 * (reference[1] ** 2 - after**2)
    return _Scored(discovery, np.bincount(block, change) if len(block) else np.zeros(0))


def _rivals(
    view: _View, bare: Sequence[Member], member: Member, reference: tuple[FloatArray, FloatArray], cost: float
) -> list[Alternative]:
    search = view.search
    trial = try_set(search.bench, search.lens, search.observed, bare)
    ranked = [r for r in rank(search, trial, [member.candidate]) if r.nats > 0]
    found = []
    for leader in ranked[:RIVALS]:
        members = with_member(search, bare, leader.member)
        nats = _scored(view, reference, members).nats
        c = leader.candidate
        found.append(Alternative(c.label, c.name, c.joint, c.family, nats - cost))
    return found


def _unknown(view: _View, bare: Sequence[Member], member: Member, own: float) -> float:
    """Nats of the smooth model in this member's place.

    What the smooth model still finds beside the member speaks against it only when it is large beside what the member explains: a big
    effect may well stand next to a small unknown one.
    """
    channels = touched_channels(view.search, member.candidate)
    instead = smooth_nats(view.search, view.confirmation, view.cells, bare, channels)
    beside = smooth_nats(view.search, view.confirmation, view.cells, view.search.members, channels)
    return instead if beside > UNKNOWN_SHARE * own else instead - max(beside, 0.0)


def smooth_nats(
    search: Search,
    confirmation: Lens,
    cells: Sequence[Sequence[Cells]],
    members: Sequence[Member],
    channels: BoolArray,
) -> float:
    """Nats that the smooth model gains in these channels beyond a set, on discovery (held out) and confirmation."""
    left = search.observed - search.bench.predict([m.effect for m in members])
    discovery = search.bench.part == 0
    columns = smooth_columns(cells, channels, left, discovery)
    first = try_set(search.bench, search.lens, search.observed, members)
    second = try_set(search.bench, confirmation, search.observed, members)
    size = float(np.sqrt(np.nanmean(left[discovery][:, channels] ** 2)))
    fit = smooth_fit(search.lens, confirmation, (first.z, second.z), (first.slopes, second.slopes), columns, size)
    return fit.nats


def _temper(view: _View, channels: BoolArray) -> float:
    """How much larger than the noise the best set's residual still is: evidence counts that much less."""
    z, _ = _seen(view, view.search.members)
    rows = channels[view.search.lens.channel]
    return max(1.0, float(np.mean(z[rows] ** 2)))


def _posterior(alternatives: Sequence[Alternative], temper: float) -> list[Alternative]:
    nats = np.array([a.nats for a in alternatives]) / temper
    weight = np.exp(nats - nats.max())
    return [replace(a, probability=float(w)) for a, w in zip(alternatives, weight / weight.sum(), strict=True)]


def _doubts(view: _View, index: int, own: _Scored, cost: float, temper: float) -> list[str]:
    """Conditions of an exact name that an effect does not meet."""
    search, member = view.search, view.search.members[index]
    doubts = []
    if own.discovery.sum() / temper < cost:
        doubts.append(f"gains only {own.discovery.sum() / temper:.1f} nats on the discovery part, {cost:.1f} are needed")
    if own.confirmation.sum() / temper < CONFIRMED:
        doubts.append(f"not confirmed: {own.confirmation.sum() / temper:.1f} nats on the confirmation part")
    per_block = np.concatenate([own.discovery, own.confirmation])
    share = float((per_block > 0).mean())
    if share < POSITIVE_SHARE:
        doubts.append(f"helps in only {100 * share:.0f} % of the trajectories")
    width = half_widths(search, search.lens, search.members, index)
    coordinates = member.candidate.coordinates
    for i in member.candidate.amplitudes:
        low, high = coordinates[i].bounds
        if not low + 1e-9 < member.u[i] < high - 1e-9:
            doubts.append(f"{coordinates[i].parameter.name} is at the edge of its physical range")
    sizes = [abs(member.u[i] - coordinates[i].identity) - width[i] for i in member.candidate.amplitudes]
    if max(sizes) <= 0:
        doubts.append("its size cannot be told from zero")
    explained = _explained_by_others(search, index)
    if explained > EXPLAINED:
        doubts.append(f"{100 * explained:.1f} % of its signature is explained by the others: not nameable from these data")
    return doubts


def _explained_by_others(search: Search, index: int) -> float:
    """Share of a member's tangent (along its amplitude) that the other members' tangents make up."""
    trial = try_set(search.bench, search.lens, search.observed, search.members)
    ends = np.cumsum([0, *(len(m.u) for m in search.members)])
    own = trial.slopes[:, ends[index] + search.members[index].candidate.amplitudes[0]]
    others = np.delete(trial.slopes, np.arange(ends[index], ends[index + 1]), axis=1)
    if others.shape[1] == 0 or not own.any():
        return 0.0
    beta = solve(others.T @ others, others.T @ own)
    left = own - others @ beta
    return 1.0 - float(left @ left / (own @ own))


def _level(weighed: Sequence[Alternative], doubts: Sequence[str]) -> tuple[EffectLevel, list[str]]:
    mine, others = weighed[0], weighed[1:]
    stable = [a for a in others if a.name and a.probability >= STABLE]
    unknown = next(a.probability for a in others if a.label == "unknown")
    if unknown > 0.5:
        return "UNKNOWN", ["a smooth model outside the catalogue explains more"]
    if doubts or next(a.probability for a in others if a.label == "nothing") > STABLE:
        return "INCONCLUSIVE", []
    if mine.probability >= EXACT:
        return "EXACT", []
    if not stable:
        return "INCONCLUSIVE", ["the catalogue and a smooth model explain it equally well"]
    words = [f"cannot be told from {a.label} ({100 * a.probability:.0f} %)" for a in stable]
    return ("CLASS" if all(a.family == mine.family for a in stable) else "SET"), words


def half_widths(search: Search, lens: Lens, members: Sequence[Member], index: int) -> dict[int, float]:
    """Half widths of the 95 % intervals of one member's coordinates: the larger of sandwich (by trajectory) and Gauss-Newton."""
    trial = try_set(search.bench, lens, search.observed, members)
    block = lens.block
    n_blocks = int(block.max()) + 1
    hessian = trial.slopes.T @ trial.slopes
    inverse = np.linalg.pinv(hessian, hermitian=True)
    scores = np.stack([trial.slopes[block == b].T @ trial.z[block == b] for b in range(n_blocks)])
    meat = scores.T @ scores * n_blocks / max(n_blocks - 1, 1)
    variance = np.maximum(np.diag(inverse @ meat @ inverse), np.diag(inverse))
    half = student.ppf(0.975, max(n_blocks - 1, 1)) * np.sqrt(variance)
    ends = np.cumsum([0, *(len(m.u) for m in members)])
    return {i: float(half[k]) for i, k in enumerate(range(ends[index], ends[index + 1]))}
