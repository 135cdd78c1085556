"""Instants at which something happens: found by looking at many, since no slope leads to them.

For a change-point t, all else held, `y = a s_t + e`: the gain is `(s_t' z)^2 / (2 s_t' s_t)`, and its profile over t is
as good as the likelihood's (Hinkley 1970, Biometrika 57(1)).
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

WINDOW = 1.0 / 24.0  # of the session, on either side: beyond the next rung of the ladder
POINTS = 17
LEVELS = 2


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
    """Move a member's change-point, and its size with it, to where they explain most, in ever finer steps."""
    index = _place(member)
    window = WINDOW * float(np.ptp(bench.scene.motion.time))
    for _ in range(LEVELS):
        profile = instant_profile(bench, lens, observed, others, member, window)
        best = int(np.argmax(profile.nats))
        u = np.array(member.u)
        u[list(member.candidate.sizes)] *= profile.factor[best]
        u[index] = profile.u[best]
        member = replace(member, u=np.clip(u, *np.array([c.bounds for c in member.candidate.coordinates]).T))
        window *= 2.0 / (POINTS - 1)
    return member


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

    Looked at ever closer, from the ladder's distance down; never less than a step of the last look.
    """
    index = _place(member)
    window = WINDOW * float(np.ptp(bench.scene.motion.time))
    for _ in range(2 * LEVELS):
        profile = instant_profile(bench, lens, observed, others, member, window)
        inside = profile.u[profile.nats > profile.nats.max() - 0.5 * chi2.ppf(0.95, 1)]
        if len(inside) > 3:
            break
        window *= 4.0 / (POINTS - 1)
    step = float(np.diff(profile.u).max(initial=0.0))
    return float(np.abs(inside - member.u[index]).max()) + step


def _place(member: Member) -> int:
    return next(i for i, c in enumerate(member.candidate.coordinates) if c.parameter.change_point)
