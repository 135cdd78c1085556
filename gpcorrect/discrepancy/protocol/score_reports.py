"""Scores many reports against sealed labels: targets with Wilson intervals, confusion, detection limits."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from gpcorrect.discrepancy.protocol.outcomes import NO_NAME, CaseOutcome, case_outcome
from gpcorrect.errors import DataError

EXACT_TARGETS = {2.0: 0.97, 1.0: 0.95, 0.5: 0.90, 0.25: 0.70}  # of single effects, by effect to noise
DETECTED = 0.7  # fraction of exact names from which on an effect counts as detected
SURE = (0.90, 0.95)  # posterior bin whose names are checked
SECONDS = 120.0  # of a run: target of the protocol


@dataclass(frozen=True)
class Proportion:
    """k of n with the 95 % Wilson interval; NaN for none."""

    k: int
    n: int

    @property
    def value(self) -> float:
        """K / n."""
        return self.k / self.n if self.n else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's score interval (1927)."""
        if not self.n:
            return (float("nan"), float("nan"))
        found = binomtest(self.k, self.n).proportion_ci(0.95, method="wilson")
        return (float(found.low), float(found.high))


@dataclass(frozen=True)
class Target:
    """One line of the target table.

    Parameters
    ----------
    what : str
        Set and measure.
    n : int
        Cases (or names, or numbers) that it is taken over.
    value : float
        Measured.
    interval : pair of float
        95 % Wilson interval of a fraction, else NaN.
    low, high : float
        Range that was asked for.
    """

    what: str
    n: int
    value: float
    interval: tuple[float, float]
    low: float
    high: float

    @property
    def met(self) -> bool:
        """Whether the measured value is in the range asked for."""
        return bool(self.low <= self.value <= self.high)


@dataclass(frozen=True)
class Score:
    """Everything that scoring says.

    Parameters
    ----------
    targets : tuple of Target
        Table of the protocol, of the sets that there are.
    confusion : dict of dict
        For each truth (effects, "nothing", and what is outside the catalogue) how often each answer was given.
    limits : dict
        For each effect the smallest effect to noise from which on 70 % are named exactly, or None.
    missing : tuple of str
        Labels without a report.
    """

    targets: tuple[Target, ...]
    confusion: Mapping[str, Mapping[str, int]]
    limits: Mapping[str, float | None]
    missing: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "targets": [asdict(t) | {"met": t.met} for t in self.targets],
            "confusion": {truth: dict(row) for truth, row in self.confusion.items()},
            "detection_limits": dict(self.limits),
            "missing": list(self.missing),
        }


def read_labels(path: Path) -> dict[str, Any]:
    """Read sealed labels, and check them against the hash beside the logs where that is at hand.

    Parameters
    ----------
    path : Path
        labels.json.

    Raises
    ------
    DataError
        The file cannot be read, is no label file, or is not the one that was sealed.
    """
    try:
        text = path.read_text(encoding="utf-8")
        cases = json.loads(text)["cases"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"cannot read the labels {path}: {error}.", hint="Give labels.json of `generate`.") from error
    seal = path.parent.parent / "labels.sha256"
    if seal.is_file() and seal.read_text(encoding="utf-8").split()[0] != hashlib.sha256(text.encode()).hexdigest():
        raise DataError(f"{path} is not what was sealed: its SHA-256 is not the one in {seal}.")
    found: dict[str, Any] = cases
    return found


def read_reports(folders: Iterable[Path]) -> list[tuple[str, dict[str, Any]]]:
    """Read report.json of folders, or of the folders in them, with the folder's name.

    Parameters
    ----------
    folders : iterable of Path
        Output folders of runs, or folders of them.

    Raises
    ------
    DataError
        A folder holds no report, or one cannot be read.
    """
    found = []
    for folder in folders:
        paths = [folder / "report.json"] if (folder / "report.json").is_file() else sorted(folder.glob("*/report.json"))
        if not paths:
            raise DataError(
                f"{folder} holds no report.json.",
                hint="Give the output folders of `discrepancy run`, or a folder of them.",
            )
        for path in paths:
            try:
                found.append((path.parent.name, json.loads(path.read_text(encoding="utf-8"))))
            except (OSError, ValueError) as error:
                raise DataError(f"cannot read {path}: {error}.") from error
    return found


def score_reports(labels: Mapping[str, Any], reports: Iterable[tuple[str, Mapping[str, Any]]]) -> Score:
    """Match reports with labels by the hash of the recording, else by the folder's name, and score them.

    Parameters
    ----------
    labels : mapping
        By the case's name.
    reports : iterable of (str, mapping)
        Folder's name and content of report.json.

    Raises
    ------
    DataError
        A report belongs to no label.
    """
    by_hash = {label["log_sha256"]: name for name, label in labels.items()}
    outcomes = {}
    for folder, report in reports:
        hashes = [d["sha256"] for d in report["provenance"]["data"]]
        name = next((by_hash[h] for h in hashes if h in by_hash), folder)
        if name not in labels:
            raise DataError(
                f"the report in {folder} is of no recording in the labels.", hint="Give the labels of these logs."
            )
        outcomes[name] = case_outcome(name, labels[name], report)
    return score_cases(list(outcomes.values()), tuple(n for n in labels if n not in outcomes))


def score_cases(outcomes: Sequence[CaseOutcome], missing: tuple[str, ...] = ()) -> Score:
    """Return the score of cases.

    Parameters
    ----------
    outcomes : sequence of CaseOutcome
        One a case.
    missing : tuple of str
        Labels without a report.
    """
    return Score(tuple(_targets(outcomes)), _confusion(outcomes), _limits(outcomes), missing)


def _targets(outcomes: Sequence[CaseOutcome]) -> list[Target]:
    singles = [
        Measure("single", f"single, effect/noise {ratio:g}", what, hit, low, high, ratio)
        for ratio, exact in EXACT_TARGETS.items()
        for what, hit, low, high in (("exact", _exact, exact, 1.0), ("wrong name", _misnamed, 0.0, 0.02))
    ]
    rows = []
    for m in (*NULL_TARGETS, *singles, *SET_TARGETS):
        part = [o for o in outcomes if o.group == m.group]
        if m.ratio is not None:
            part = [o for o in part if o.ratio is not None and _nearest(o.ratio) == m.ratio]
        if part:
            rows.append(_row(f"{m.words}: {m.what}", [m.hit(o) for o in part], m.low, m.high))
    return [*rows, *_honesty(outcomes), *_numbers(outcomes)]


@dataclass(frozen=True)
class Measure:
    """A fraction of the cases of a set that should lie in a range; of one effect-to-noise ratio where it is given."""

    group: str
    words: str
    what: str
    hit: Callable[[CaseOutcome], bool]
    low: float
    high: float
    ratio: float | None = None


def _misnamed(outcome: CaseOutcome) -> bool:
    return outcome.wrong


def _exact(outcome: CaseOutcome) -> bool:
    return outcome.exact


NULL_TARGETS = (
    Measure("null", "null", "any name", _misnamed, 0.0, 0.01),
    Measure("null", "null", "said NONE", lambda o: o.answers == ("none",), 0.0, 1.0),
    Measure("awkward_null", "awkward null", "any name", _misnamed, 0.0, 0.03),
)
SET_TARGETS = (
    Measure("zigzag", "zigzag", "right class or set", lambda o: o.right_or_set, 0.95, 1.0),
    Measure("zigzag", "zigzag", "wrong name", _misnamed, 0.0, 0.02),
    Measure("pair", "pair", "both exact", _exact, 0.85, 1.0),
    Measure("pair", "pair", "wrong name", _misnamed, 0.0, 0.02),
    Measure("triple", "triple", "all exact", _exact, 0.70, 1.0),
    Measure("triple", "triple", "wrong name", _misnamed, 0.0, 0.02),
    Measure("outside", "outside", "UNKNOWN", lambda o: o.unknown, 0.90, 1.0),
    Measure("outside", "outside", "misnamed", _misnamed, 0.0, 0.05),
    Measure("advised", "advised", "resolved by the run", _exact, 0.90, 1.0),
    Measure("advised", "advised", "wrong name", _misnamed, 0.0, 0.02),
)


def _row(what: str, hits: Sequence[bool], low: float, high: float) -> Target:
    fraction = Proportion(sum(hits), len(hits))
    return Target(what, fraction.n, fraction.value, fraction.interval, low, high)


def _honesty(outcomes: Sequence[CaseOutcome]) -> list[Target]:
    names = [right for o in outcomes for p, right in o.probabilities if SURE[0] <= p <= SURE[1]]
    covered = [c for o in outcomes for c in o.covered]
    rows = [_row(f"names of posterior {SURE[0]:g} to {SURE[1]:g}: right", names, 0.88, 0.98)] if names else []
    return rows + ([_row("95 % intervals: hold the truth", covered, 0.92, 0.98)] if covered else [])


def _numbers(outcomes: Sequence[CaseOutcome]) -> list[Target]:
    nan = (float("nan"), float("nan"))
    closed = [o.closed for o in outcomes if o.closed is not None and o.exact and o.ratio is not None and o.ratio >= 1]
    rows = []
    if closed:
        rows = [
            Target(
                "gap closed, effect/noise at least 1: median", len(closed), float(np.median(closed)), nan, 0.95, np.inf
            ),
            Target("gap closed: 5th percentile", len(closed), float(np.percentile(closed, 5)), nan, 0.80, np.inf),
        ]
    if outcomes:
        seconds = [o.seconds for o in outcomes]
        rows.append(Target("seconds a run: median", len(seconds), float(np.median(seconds)), nan, 0.0, SECONDS))
        rows.append(Target("seconds a run: longest", len(seconds), max(seconds), nan, 0.0, SECONDS))
    return rows


def _nearest(ratio: float) -> float:
    return min(EXACT_TARGETS, key=lambda r: abs(np.log(r / ratio)))


def _confusion(outcomes: Sequence[CaseOutcome]) -> dict[str, dict[str, int]]:
    counts: dict[str, dict[str, int]] = {}
    for outcome in outcomes:
        for truth, answer in zip(outcome.truth or ("nothing",), outcome.answers, strict=True):
            row = counts.setdefault(truth, {})
            row[answer] = row.get(answer, 0) + 1
    names = sorted({a for row in counts.values() for a in row} - set(NO_NAME))
    columns = [*names, *NO_NAME]
    return {truth: {c: counts[truth].get(c, 0) for c in columns} for truth in sorted(counts)}


def _limits(outcomes: Sequence[CaseOutcome]) -> dict[str, float | None]:
    """Smallest ratio of each effect such that at it and above, enough are exact."""
    tried: dict[str, dict[float, list[bool]]] = {}
    for o in outcomes:
        if o.group == "single" and o.ratio is not None:
            tried.setdefault(o.truth[0], {}).setdefault(_nearest(o.ratio), []).append(o.exact)
    limits: dict[str, float | None] = {}
    for name, by_ratio in sorted(tried.items()):
        limit = None
        for ratio in sorted(by_ratio, reverse=True):
            if np.mean(by_ratio[ratio]) < DETECTED:
                break
            limit = ratio
        limits[name] = limit
    return limits


def score_text(score: Score) -> str:
    """Return target table, confusion matrix and detection limits as text with aligned columns.

    Parameters
    ----------
    score : Score
        Of cases.
    """
    parts = [_table([["target", "n", "measured", "95 % interval", "asked for", "met"], *map(_target, score.targets)])]
    if score.confusion:
        columns = list(next(iter(score.confusion.values())))
        used = [c for c in columns if c in NO_NAME or any(row[c] for row in score.confusion.values())]
        rows = [[truth, *(str(row[c] or ".") for c in used)] for truth, row in score.confusion.items()]
        parts.append(_table([["truth \\ answer", *used], *rows]))
    if score.limits:
        rows = [[name, "not reached" if limit is None else f"{limit:g}"] for name, limit in score.limits.items()]
        parts.append(_table([["effect", "named from effect/noise"], *rows]))
    if score.missing:
        parts.append(f"{len(score.missing)} labels have no report: {', '.join(score.missing)}")
    return "\n\n".join(parts)


def _target(target: Target) -> list[str]:
    fraction = np.isfinite(target.interval[0])
    value = f"{100 * target.value:.1f} %" if fraction else f"{target.value:.3g}"
    interval = " to ".join(f"{100 * end:.1f}" for end in target.interval) if fraction else ""
    return [
        target.what,
        str(target.n),
        value,
        interval,
        _asked(target, fraction=bool(fraction)),
        "yes" if target.met else "no",
    ]


def _asked(target: Target, *, fraction: bool) -> str:
    low, high = (f"{100 * v:g} %" if fraction else f"{v:g}" for v in (target.low, target.high))
    unbounded = target.high == 1.0 if fraction else np.isinf(target.high)
    if target.low == 0.0:
        return "" if unbounded else f"at most {high}"
    return f"at least {low}" if unbounded else f"{low} to {high}"


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "  ".join(
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])
