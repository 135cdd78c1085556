"""Evidence for an effect and for what could stand in its place.

Rivals in the catalogue, something outside it, nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from gpcorrect.discrepancy.evidence.cells import Cells
from gpcorrect.discrepancy.evidence.lens import Lens, lens_on
from gpcorrect.discrepancy.naming.unknown import smooth_columns, smooth_fit
from gpcorrect.discrepancy.recording.covariates import Covariates
from gpcorrect.discrepancy.search.candidates import Candidate, Member
from gpcorrect.discrepancy.search.rank import rank
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.search.trial import held_out, try_set
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["Rival", "Unknown", "View", "Weighed", "view_of", "wander", "weigh"]

RIVALS = 2  # names that are refined in each effect's place, beside its simpler look-alikes
TRIED = 8  # looked at for likeness
LIKENESS = 0.5  # cosine of two signatures, beyond what the other effects explain, below which they are no rivals
HEARD = 0.01  # of the loudest trajectory's energy: below, one says nothing of a size
SMOOTH_CHANNELS = 3  # of those an effect shows in, the ones where it shows most


@dataclass(frozen=True, eq=False)
class View:
    """Both parts as they are seen: discovery and confirmation."""

    search: Search
    confirmation: Lens
    tests: Sequence[Sequence[Cells]]
    inputs: Sequence[Covariates]

    def look(self, members: Sequence[Member]) -> tuple[FloatArray, FloatArray]:
        """Seen residual of a set on discovery and confirmation."""
        left = self.search.residual(members)
        return self.search.lens.look_one(left), self.confirmation.look_one(left)


def view_of(search: Search, tests: Sequence[Sequence[Cells]], inputs: Sequence[Covariates]) -> View:
    """Look at confirmation with the noise that discovery has taught."""
    residual = search.residual(search.members)
    confirmation = lens_on(search.bench, residual, search.bench.confirmation, search.lens.noises)
    return View(search, confirmation, tests, inputs)


@dataclass(frozen=True, eq=False)
class Rival:
    """Another candidate in an effect's place, refined, and its nats."""

    member: Member
    nats: float

    @property
    def candidate(self) -> Candidate:
        """Which one."""
        return self.member.candidate


@dataclass(frozen=True)
class Unknown:
    """Nats of the smooth model in an effect's place, and beside it."""

    instead: float
    beside: float


@dataclass(frozen=True, eq=False)
class Weighed:
    """Evidence for one member, in nats beyond the set without it.

    Parameters
    ----------
    discovery, confirmation : (b,) arrays
        Its own, of each trajectory of either part.
    heard : (b,) bool array
        Trajectories of discovery, then confirmation, in which it acts: a slip does not before it happens.
    rivals : tuple of Rival
        Those like it, best first.
    unknown : Unknown
        The smooth model's.
    temper : float
        By how much evidence counts less, because the residual is still larger than noise.
    """

    discovery: FloatArray
    confirmation: FloatArray
    heard: BoolArray
    rivals: tuple[Rival, ...]
    unknown: Unknown
    temper: float

    @property
    def nats(self) -> float:
        """Own nats of both parts."""
        return float(self.discovery.sum() + self.confirmation.sum())


def weigh(view: View, member: Member) -> Weighed:
    """Weigh a member of the search's set against what could stand in its place."""
    search = view.search
    candidate = member.candidate
    rest = search.refit([m for m in search.members if m is not member], candidate)
    reference = view.look(rest)
    discovery, confirmation = _gains(view, reference, search.members, candidate)
    channels = search.touched(candidate)
    return Weighed(
        discovery,
        confirmation,
        _heard(view, member),
        tuple(_rivals(view, rest, member, reference)),
        _unknown(view, rest, _loudest(view, member, channels)),
        max(search.tempering(view.look(search.members)[0], channels), wander(search, member)),
    )


def wander(search: Search, member: Member) -> float:
    """How much more a member's size seems to differ from trajectory to trajectory than noise lets it, 1 at least.

    Noise that wanders slowly gives every trajectory a size of its own; nats counted sample by sample do not know that.
    Each trajectory's score along the signature, in its standard deviations, has a mean square of one; what the sum of
    squares is above its 95 % quantile says by how much evidence counts less.
    """
    trial = search.trial(search.members, member.candidate)
    begin, near = 0, search.parted(search.members, member.candidate)[1]
    for other in near:
        if other is member:
            break
        begin += len(other.u)
    own = trial.slopes[:, [begin + i for i in member.candidate.sizes]].sum(axis=1)
    block = search.lens.block
    energy, score = np.bincount(block, own**2), np.bincount(block, own * trial.z)
    heard = energy > HEARD * energy.max(initial=0.0)
    if not heard.any():
        return 1.0
    return max(1.0, float((score[heard] ** 2 / energy[heard]).sum() / chi2.ppf(0.95, heard.sum())))


def _heard(view: View, member: Member) -> BoolArray:
    """Trajectories of both parts in which a member changes what is seen by more than a little of what it can."""
    without = view.look([m for m in view.search.members if m is not member])
    parts = zip(without, view.look(view.search.members), (view.search.lens, view.confirmation), strict=True)
    energy = np.concatenate([np.bincount(lens.block, (a - b) ** 2) for a, b, lens in parts])
    return np.asarray(energy > HEARD * energy.max(initial=0.0), dtype=np.bool_)


def _gains(
    view: View, reference: tuple[FloatArray, FloatArray], members: Sequence[Member], candidate: Candidate
) -> tuple[FloatArray, FloatArray]:
    search = view.search
    trial = search.trial(members, candidate)
    discovery = held_out(search.lens, reference[0], trial.z, trial.slopes)
    change = 0.5 * (reference[1] ** 2 - view.look(members)[1] ** 2)
    block = view.confirmation.block
    return discovery, np.bincount(block, change).astype(np.float64) if len(block) else np.zeros(0)


def _rivals(
    view: View, rest: tuple[Member, ...], member: Member, reference: tuple[FloatArray, FloatArray]
) -> list[Rival]:
    search = view.search
    bare = search.trial(rest, member.candidate)
    own = reference[0] - view.look(search.members)[0]
    ranked = [r for r in rank(search, bare, [member.candidate], search.touched(member.candidate)) if r.nats > 0]
    found: list[Rival] = []
    for place, leader in enumerate(ranked):
        enough = sum(not r.candidate.called_like(member.candidate) for r in found) >= RIVALS
        if (enough or place >= TRIED) and not _is_simpler(leader.candidate, member.candidate):
            continue
        if any(leader.candidate.called_like(r.candidate) for r in found):
            continue
        first = reference[0] - view.look((*rest, leader.member))[0]
        if _likeness(first, own, bare.slopes) < LIKENESS:
            continue
        members = search.refit((*rest, leader.member), leader.candidate)
        if members[-1].at_edge:
            continue
        gains = _gains(view, reference, members, leader.candidate)
        found.append(Rival(members[-1], float(gains[0].sum() + gains[1].sum())))
    return sorted(found, key=lambda r: -r.nats)


def _is_simpler(rival: Candidate, candidate: Candidate) -> bool:
    """Whether a rival is a look-alike in the catalogue, on the same joint, with fewer numbers: it may say the same."""
    alike = {n.name for n in candidate.kind.about.neighbours}
    return rival.name in alike and rival.joint == candidate.joint and rival.extra < candidate.extra


def _likeness(a: FloatArray, b: FloatArray, slopes: FloatArray) -> float:
    """Cosine of two seen changes once the part along the others' tangents is taken off both."""
    if slopes.shape[1]:
        basis, _ = np.linalg.qr(slopes)
        a, b = a - basis @ (basis.T @ a), b - basis @ (basis.T @ b)
    return float(abs(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300))


def _loudest(view: View, member: Member, channels: BoolArray) -> BoolArray:
    """Return the few channels in which a member is largest beside the noise."""
    search = view.search
    change = search.bench.predict([member.effect]) - search.bench.predict()
    size = np.sqrt(np.mean(change**2, axis=0)) / np.array([n.std for n in search.lens.noises])
    few = np.argsort(np.where(channels, size, -1.0))[::-1][:SMOOTH_CHANNELS]
    mask = np.zeros(len(channels), dtype=np.bool_)
    mask[few] = channels[few]
    return mask


def _unknown(view: View, rest: Sequence[Member], channels: BoolArray) -> Unknown:
    left = view.search.residual(rest)
    columns = smooth_columns(view.inputs, view.tests, channels, left, view.search.bench.discovery)
    return Unknown(
        smooth_nats(view, rest, channels, columns), smooth_nats(view, view.search.members, channels, columns)
    )


def smooth_nats(view: View, members: Sequence[Member], channels: BoolArray, columns: FloatArray | None = None) -> float:
    """Nats that the smooth model gains in these channels beyond a set, on discovery (held out) and confirmation."""
    search = view.search
    left, discovery = search.residual(members), search.bench.discovery
    if columns is None:
        columns = smooth_columns(view.inputs, view.tests, channels, left, discovery)
    touching = [m for m in members if (search.touched(m.candidate) & channels).any()]
    others = [m for m in members if not any(m is t for t in touching)]
    first = try_set(search.bench, search.lens, search.observed, touching, others)
    second = try_set(search.bench, view.confirmation, search.observed, touching, others)
    size = float(np.sqrt(np.nanmean(left[discovery][:, channels] ** 2)))
    fit = smooth_fit(search.lens, view.confirmation, (first.z, second.z), (first.slopes, second.slopes), columns, size)
    return fit.nats
