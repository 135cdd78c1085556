"""What a paper claims, and what came of it here: each study has a table `claims.toml`, all are compared by one rule.

The tables hold printed numbers only. Ours are read from the figures of a run (`reproduce.json`), under the same names.
"""

from __future__ import annotations

import math
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from importlib.resources import files
from typing import Any, ClassVar

STAYS = "stays so"
"""Of a claim that an ablation does not bring back."""

TOLERANCE = 0.2
"""Fraction of the printed number, and of a ratio's distance from 1 where that is less, within which a number counts as
the printed one. A fifth: no nearer do the simulated robots' errors before correction come to the papers'
(`tests/studies/test_peng2024.py`). Each page states the counts at half and at twice of it."""


class Verdict(StrEnum):
    """What came of a claim."""

    REPRODUCED = "reproduced"
    BEYOND = "beyond"
    NOT_REPRODUCED = "not reproduced"
    REVERSED = "reversed"
    NOT_MEASURED = "not measured"


class Better(StrEnum):
    """Which numbers are at least as good as the printed one."""

    LOWER = "lower"
    HIGHER = "higher"
    SAME = "same"  # only those near it
    AT_MOST = "at most"  # the paper prints a bound: all that are not above it


@dataclass(frozen=True)
class Claim:
    """One claim of a paper: a printed number, or the ratio of two."""

    says: str  # the claim, as a sentence
    where: str  # table, figure or section that prints it
    # places of the number, and of what it is divided by, in the figures (:func:`number_at`). A ratio claims an order
    # too: below 1, the first is less.
    of: str
    against: str = ""
    better: Better = Better.LOWER  # which numbers are at least as good
    printed: float | None = None  # the number itself, where the printed tables do not have it
    missing: str = ""  # why `reproduce` does not measure it; empty where it does
    tried: Sequence[str] = ()  # ablations that are tried where it is not reproduced: names in the table `ablations`

    def number(self, figures: Mapping[str, Any]) -> float | None:
        """Return the number, or the ratio, that these figures give; None where one of its parts was not measured."""
        above = number_at(figures, self.of)
        below = number_at(figures, self.against) if self.against else 1.0
        return None if above is None or below is None else above / below

    def verdict(self, printed: float, ours: float | None, tolerance: float = TOLERANCE) -> Verdict:
        """Compare our number with the printed one.

        A ratio on the other side of 1, and a gain (:attr:`Better.HIGHER`) of the other sign, are reversed, whether that
        is better or worse. What is better than the printed number by more than the tolerance is beyond it.

        Parameters
        ----------
        printed : float
        ours : float or None
        tolerance : float
        """
        if ours is None:
            return Verdict.NOT_MEASURED
        neutral = 1.0 if self.against else 0.0
        if (self.against or self.better is Better.HIGHER) and (ours - neutral) * (printed - neutral) < 0:
            return Verdict.REVERSED
        if self.better is Better.AT_MOST:
            return Verdict.REPRODUCED if ours <= printed else Verdict.NOT_REPRODUCED
        if self.better is Better.SAME:
            near = abs(ours - printed) <= tolerance * abs(printed)
            return Verdict.REPRODUCED if near else Verdict.NOT_REPRODUCED
        margin = tolerance * min(abs(printed), abs(printed - neutral))
        gained = (printed - ours) if self.better is Better.LOWER else (ours - printed)
        if gained > margin:
            return Verdict.BEYOND
        return Verdict.REPRODUCED if gained >= -margin else Verdict.NOT_REPRODUCED


@dataclass(frozen=True)
class Ablated:
    """What a claim's number becomes where something is taken away, and the verdict it then has."""

    name: str  # of the ablation
    without: str  # what was taken away: words that begin with "without" or "with"
    ours: float
    verdict: Verdict
    outcome: str  # "comes back", "its order comes back" or "stays so"


@dataclass(frozen=True)
class Compared:
    """A claim, the printed number and ours (None: not measured), the verdict, and what ablations made of it."""

    claim: Claim
    printed: float
    ours: float | None
    verdict: Verdict
    ablated: Sequence[Ablated] = ()

    @property
    def failed(self) -> bool:
        """Whether it was measured and not reproduced."""
        return self.verdict in (Verdict.NOT_REPRODUCED, Verdict.REVERSED)

    @property
    def found(self) -> bool:
        """Whether an ablation brought back the claim, or the order that was reversed."""
        return any(one.outcome != STAYS for one in self.ablated)

    @property
    def reason(self) -> str:
        """Why it was not reproduced, or not measured; empty where it was reproduced."""
        if self.verdict is Verdict.NOT_MEASURED:
            return self.claim.missing or "not part of a run of this size"
        if not self.failed:
            return ""
        if not self.ablated:
            return "no ablation in a run of this size" if self.claim.tried else "reason not known"
        outcomes = sorted({one.outcome: None for one in self.ablated}, key=STAYS.__eq__)  # those that found it first
        alike = [[f"{a.without} ({a.ours:.3g})" for a in self.ablated if a.outcome == outcome] for outcome in outcomes]
        tried = "; ".join(f"{outcome} {', '.join(some)}" for outcome, some in zip(outcomes, alike, strict=True))
        return tried if self.found else f"reason not known; {tried}"


@dataclass(frozen=True)
class Comparison:
    """All claims of a paper beside a run."""

    rows: Sequence[Compared]
    caveat: str

    def counts(self, factor: float = 1.0) -> dict[Verdict, int]:
        """Return how many claims have each verdict.

        Parameters
        ----------
        factor : float, times the tolerance
        """
        found = [row.claim.verdict(row.printed, row.ours, factor * TOLERANCE) for row in self.rows]
        return {verdict: found.count(verdict) for verdict in Verdict}

    def to_dict(self) -> dict[str, Any]:
        """Return counts and claims as JSON-able data."""
        claims = [
            {
                "claim": row.claim.says,
                "where": row.claim.where,
                "of": row.claim.of,
                "against": row.claim.against or None,
                "better": row.claim.better,
                "printed": row.printed,
                "ours": row.ours,
                "verdict": row.verdict,
                "reason": row.reason,
                "ablations": [asdict(one) for one in row.ablated],
            }
            for row in self.rows
        ]
        return {"tolerance": TOLERANCE, "caveat": self.caveat, "counts": dict(self.counts()), "claims": claims}


@dataclass(frozen=True)
class ClaimTable:
    """The claims of one paper and the tables that it prints."""

    claims: Sequence[Claim]
    printed: Mapping[str, Any]  # printed numbers, under the names that the figures of a run have
    setup: Mapping[str, Any]  # printed numbers of the set-up: no claims
    caveat: str  # what to bear in mind with all of them
    ablations: Mapping[str, str] = field(default_factory=dict)  # what each ablation takes away, by its name

    @classmethod
    def of_study(cls, study: str) -> ClaimTable:
        """Read `claims.toml` of a study.

        Parameters
        ----------
        study : str, folder beside this module
        """
        table = tomllib.loads((files("gpcorrect_studies") / study / "claims.toml").read_text(encoding="utf-8"))
        claims = [Claim(**{**row, "better": Better(row.get("better", Better.LOWER))}) for row in table["claim"]]
        caveat = " ".join(table["caveat"].split())
        return cls(claims, table["printed"], table["setup"], caveat, table.get("ablations", {}))

    def compare(self, figures: Mapping[str, Any]) -> Comparison:
        """Compare every claim with the figures of a run.

        Parameters
        ----------
        figures : mapping, as in `reproduce.json`; those of the ablations by name under `ablations`
        """
        done, rows = figures.get("ablations", {}), []
        for claim in self.claims:
            printed = self.printed_number(claim)
            ours = None if claim.missing else claim.number(figures)
            row = Compared(claim, printed, ours, claim.verdict(printed, ours))
            if row.failed:
                numbers = {name: claim.number(done.get(name, {})) for name in claim.tried}
                ablated = [self._outcome(name, row, found) for name, found in numbers.items() if found is not None]
                row = replace(row, ablated=ablated)
            rows.append(row)
        return Comparison(rows, self.caveat)

    def _outcome(self, name: str, row: Compared, ours: float) -> Ablated:
        """Say whether the claim came back, or at least its order: by a fifth of what the paper's is away from none."""
        verdict, neutral = row.claim.verdict(row.printed, ours), 1.0 if row.claim.against else 0.0
        clear = abs(ours - neutral) >= TOLERANCE * abs(row.printed - neutral)
        if verdict in (Verdict.REPRODUCED, Verdict.BEYOND):
            outcome = "comes back"
        else:
            ordered = row.verdict is Verdict.REVERSED is not verdict
            outcome = "its order comes back" if ordered and clear else STAYS
        return Ablated(name, self.ablations[name], ours, verdict, outcome)

    def printed_number(self, claim: Claim) -> float:
        """Return the number that a claim prints, or the ratio of its two; KeyError where the table lacks it."""
        found = claim.number(self.printed) if claim.printed is None else claim.printed
        if found is None:
            raise KeyError(f"no printed number at {claim.of!r} or {claim.against!r}")
        return found


@dataclass(frozen=True, eq=False)
class StudyResult(ABC):
    """A study done again; what it measured are the fields of its own class."""

    STUDY: ClassVar[str]  # its name on the command line
    CLAIMS: ClassVar[ClaimTable]
    NOTES: ClassVar[Mapping[str, Sequence[str]]] = {}
    """Sentences on what is comparable and what is not."""

    scope: Any  # how much was done
    seed: int
    seconds: float = field(kw_only=True)  # of the whole study

    @abstractmethod
    def figures(self) -> dict[str, Any]:
        """Return what was measured, as JSON-able data."""

    @property
    def short(self) -> bool:
        """Whether less was done than the whole study."""
        whole: bool = self.scope == type(self.scope)()
        return not whole

    def compared(self) -> Comparison:
        """Return the paper's claims beside this run."""
        return self.CLAIMS.compare(self.figures())

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON-able data."""
        head = {"study": self.STUDY, "short": self.short, "seed": self.seed, "seconds": self.seconds}
        notes = {name: list(sentences) for name, sentences in self.NOTES.items()}
        return {**head, **self.figures(), **self.compared().to_dict(), "printed": self.CLAIMS.printed, **notes}


def number_at(figures: Any, place: str) -> float | None:
    """Return a number out of nested tables and lists; None where there is none.

    Parameters
    ----------
    figures : mapping or sequence, tables and lists inside each other
    place : str
        Keys, or places in a list, with "/" between. Keys with "," between stand for the root of the sum of their
        squares: the norm of a mean vector, as the papers' norms are made.
    """
    step, _, rest = place.partition("/")
    if isinstance(figures, Mapping) and step not in figures and "," in step:
        parts = [number_at(figures, f"{key}/{rest}" if rest else key) for key in step.split(",")]
        return (
            None if any(part is None for part in parts) else math.hypot(*(part for part in parts if part is not None))
        )
    try:
        inside = figures[step] if isinstance(figures, Mapping) else figures[int(step)]
    except (KeyError, IndexError):
        return None
    if rest:
        return number_at(inside, rest)
    return None if inside is None else float(inside)
