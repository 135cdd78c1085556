"""What can be said of an effect: the level at which it may be named, and what else could stand in its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gpcorrect.discrepancy.search.candidates import Member

__all__ = ["EXACT", "STABLE", "Alternative", "EffectLevel", "Named"]

EffectLevel = Literal["EXACT", "CLASS", "SET", "UNKNOWN", "INCONCLUSIVE"]

EXACT = 0.95
STABLE = 0.05  # posterior above which a rival cannot be told apart


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
        Held-out, beyond nothing, the prior's penalty taken off.
    extra : int
        How many numbers it has beyond the first.
    probability : float
        Posterior among the alternatives.
    """

    label: str
    name: str
    joint: int | str | None
    family: str
    nats: float
    extra: int = 0
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
        Held-out gain, discovery and confirmation, tempered.
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
    def may_be_named(self) -> bool:
        """Whether the level is one with names."""
        return self.level in ("EXACT", "CLASS", "SET")

    @property
    def rivals(self) -> tuple[Alternative, ...]:
        """Other effects that cannot be ruled out."""
        own = self.member.candidate.label
        return tuple(a for a in self.alternatives if a.name and a.label != own and a.probability >= STABLE)
