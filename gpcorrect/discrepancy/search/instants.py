"""Instants at which something happens: found by looking at every row, since no slope leads to them.

For a change-point t, all else held, `y = a s_t + e`: the gain is `(s_t' z)^2 / (2 s_t' s_t)`, and its profile over t is
as good as the likelihood's (Hinkley 1970, Biometrika 57(1)). Under slow noise it is spiky: the jump itself tells most,
and shows in one row. What follows an instant does not depend on it, so that one trace, cut at each row, gives them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from gpcorrect.discrepancy.evidence.lens import Lens
from gpcorrect.discrepancy.recording.bench import Bench
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.types import FloatArray

__all__ = ["Profile", "has_instant", "instant_half_width", "instant_profile", "with_best_instant"]

POINTS = 17
COARSE, NEAR = 8, 200  # rows: of a first look, and on either side of the best of it
AT_ONCE = 128  # traces, for memory's sake


@dataclass(frozen=True, eq=False)
class Profile:
    """Gain of one change-point over its instant.

    Parameters
    ----------
    u : (k,) array
        Its coordinate.
    factor : (k,) array
        By which the member's sizes are best multiplied there.
    nats : (k,) array
        Gain over nothing there.
    """

    u: FloatArray
    factor: FloatArray
    nats: FloatArray


def has_instant(member: Member) -> bool:
    """Whether one of a member's numbers is a change-point."""
    return any(c.parameter.change_point for c in member.candidate.coordinates)


def with_best_instant(
    bench: Bench, lens: Lens, observed: FloatArray, others: Sequence[Member], member: Member
) -> Member:
    """Move a member's change-point, and its size with it, to where they explain most."""
    member = _scanned(bench, lens, observed, others, member)
    profile = instant_profile(bench, lens, observed, others, member, _row_seconds(bench))
    best = int(np.argmax(profile.nats))
    return _moved(member, float(profile.u[best]), float(profile.factor[best])) if len(profile.u) else member


def _moved(member: Member, u_instant: float, factor: float) -> Member:
    u = np.array(member.u)
    u[list(member.candidate.sizes)] *= factor
    u[_place(member)] = u_instant
    return replace(member, u=np.clip(u, *np.array([c.bounds for c in member.candidate.coordinates]).T))


def _scanned(bench: Bench, lens: Lens, observed: FloatArray, others: Sequence[Member], member: Member) -> Member:
    """Move a member to the best row: first of every few rows, then of all rows near the best of those."""
    coordinate = member.candidate.coordinates[_place(member)]
    cuts = _cuts(bench, lens, observed, others, member)
    instants = cuts.instants
    for stride in (COARSE, 1):
        tried = instants[::stride]
        if len(tried) == 0:
            return member
        factor, nats = cuts.at(tried)
        flat = np.flatnonzero(nats >= nats.max() - 1e-9 * abs(nats.max()))
        best = int(flat[len(flat) // 2])  # where nothing is seen, the middle
        near = np.searchsorted(instants, tried[best])
        instants = instants[max(near - NEAR, 0) : near + NEAR + 1]
    place = int(np.searchsorted(cuts.instants, tried[best]))
    since = max(cuts.instants[max(place - 1, 0)] + _row_seconds(bench), cuts.instants[0])
    instant = 0.5 * (since + tried[best]) if since < tried[best] else tried[best]  # in the middle of a pause
    return _moved(member, float(coordinate.coordinate(float(instant))), float(factor[best]))


@dataclass(frozen=True, eq=False)
class _Cuts:
    """One trace `(m, c)` that can begin at any row, by the rows' clock `(m,)`, and what it has to explain `(M,)`."""

    lens: Lens
    z: FloatArray
    trace: FloatArray
    clock: FloatArray
    instants: FloatArray

    def at(self, instants: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Best factor of the trace when it begins at each of k instants, and its gain in nats."""
        factor, nats = np.zeros(len(instants)), np.zeros(len(instants))
        for begin in range(0, len(instants), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            seen = self.lens.look(self.trace[:, :, None] * (self.clock[:, None] >= instants[part])[:, None, :])
            energy, along = (seen**2).sum(axis=0), seen.T @ self.z
            heard = energy > 0.0
            factor[part] = np.where(heard, along / np.where(heard, energy, 1.0), 0.0)
            nats[part] = 0.5 * factor[part] * along
        return factor, nats


def _cuts(bench: Bench, lens: Lens, observed: FloatArray, others: Sequence[Member], member: Member) -> _Cuts:
    """Trace of a member from the earliest instant on, and the instants just before each row at which it may begin."""
    bounds = member.candidate.coordinates[_place(member)].bounds
    first, last = (member.candidate.coordinates[_place(member)].value(x) for x in bounds)
    clock = bench.means(bench.scene.layout.gather(bench.scene.motion.time, len(bench.scene)))
    base = bench.predict([m.effect for m in others])
    trace = bench.predict([*(m.effect for m in others), _moved(member, bounds[0], 1.0).effect]) - base
    rows = (clock >= first) & (clock <= last) & trace.any(axis=1)
    instants = np.clip(np.unique(clock[rows]) - 0.5 * _row_seconds(bench), first, last)
    return _Cuts(lens, lens.look_one(observed - base), trace, clock, instants)


def _row_seconds(bench: Bench) -> float:
    return float(np.median(np.diff(bench.time)[np.diff(bench.block) == 0]))


def instant_profile(
    bench: Bench, lens: Lens, observed: FloatArray, others: Sequence[Member], member: Member, window: float
) -> Profile:
    """Gain at instants within `window` seconds of a member's own, its size fitted at each."""
    index = _place(member)
    coordinate = member.candidate.coordinates[index]
    low, high = coordinate.bounds
    at = coordinate.value(float(member.u[index]))
    base = bench.predict([m.effect for m in others])
    z = lens.look_one(observed - base)
    u = np.array([coordinate.coordinate(t) for t in at + np.linspace(-window, window, POINTS) if t > 0.0])
    u = np.unique(np.clip(u, low, high))
    factor, nats = np.zeros(len(u)), np.zeros(len(u))
    for i, x in enumerate(u):
        moved = np.array(member.u)
        moved[index] = x
        trace = bench.predict([*(m.effect for m in others), replace(member, u=moved).effect]) - base
        seen = lens.look_one(trace)
        energy = float(seen @ seen)
        if energy > 0.0:
            factor[i] = float(seen @ z) / energy
            nats[i] = 0.5 * factor[i] ** 2 * energy
    return Profile(u, factor, nats)


def instant_half_width(
    bench: Bench, lens: Lens, observed: FloatArray, others: Sequence[Member], member: Member
) -> float:
    """Half width of the 95 % interval of a change-point's coordinate: where the profile is within 1.92 nats of its top.

    At every row, for the profile has many tops; and a row more, within which nothing is told apart.
    """
    index = _place(member)
    coordinate, cuts = member.candidate.coordinates[index], _cuts(bench, lens, observed, others, member)
    at = coordinate.value(float(member.u[index]))
    tried = np.sort(np.append(cuts.instants, at))
    _, nats = cuts.at(tried)
    inside = np.flatnonzero(nats > nats.max() - 0.5 * chi2.ppf(0.95, 1))
    first, last = tried[max(inside.min() - 1, 0)], tried[inside.max()]  # an instant is anywhere since the row before it
    half = float(max(at - first, last - at)) + _row_seconds(bench)
    ends = [coordinate.coordinate(max(t, 1e-9)) for t in (at - half, at + half)]
    return float(np.abs(np.array(ends) - member.u[index]).max())


def _place(member: Member) -> int:
    return next(i for i, c in enumerate(member.candidate.coordinates) if c.parameter.change_point)
