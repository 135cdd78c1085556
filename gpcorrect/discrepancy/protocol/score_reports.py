"""Scores many reports against sealed labels: targets with Wilson intervals, confusion, detection limits."""

from __future__ import annotations

import hashlib
import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from gpcorrect.discrepancy.outcome.result import VERSION
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
        """The fraction."""
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
    """One line of the target table."""

    what: str
    n: int  # cases, names or numbers that it was measured over
    value: float
    interval: tuple[float, float]  # 95 % Wilson interval of a fraction; else NaN
    low: float  # the range that was asked for
    high: float

    @property
    def met(self) -> bool:
        """Whether the measured value is in the range asked for."""
        return bool(self.low <= self.value <= self.high)


@dataclass(frozen=True)
class Score:
    """Everything that scoring says."""

    targets: tuple[Target, ...]  # of the sets that there are
    # for each truth (effects, "nothing", and what is outside the catalogue) how often each answer was given
    confusion: Mapping[str, Mapping[str, int]]
    limits: Mapping[str, float | None]  # smallest effect to noise from which on 70 % of an effect are named exactly
    missing: tuple[str, ...] = ()  # labels without a report

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "targets": [asdict(t) | {"met": t.met} for t in self.targets],
            "confusion": self.confusion,
            "detection_limits": self.limits,
            "missing": list(self.missing),
        }


def read_labels(path: Path) -> dict[str, Any]:
    """Read sealed labels, and check them against the hash beside the logs where that is at hand.

    Parameters
    ----------
    path : Path, labels.json

    Raises
    ------
    DataError
        The file cannot be read, is no label file, or is not the one that was sealed.
    """
    try:
        text = path.read_text(encoding="utf-8")
        cases = dict[str, Any](json.loads(text)["cases"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"cannot read the labels {path}: {error}.", hint="Give labels.json of `generate`.") from error
    seal = path.parent.parent / "labels.sha256"
    if seal.is_file() and seal.read_text(encoding="utf-8").split()[0] != hashlib.sha256(text.encode()).hexdigest():
        raise DataError(f"{path} is not what was sealed: its SHA-256 is not the one in {seal}.")
    return cases


def read_reports(folders: Iterable[Path]) -> list[tuple[str, dict[str, Any]]]:
    """Read report.json of folders, or of the folders in them, with the folder's name.

    Parameters
    ----------
    folders : iterable of Path, output folders of runs, or folders of them

    Raises
    ------
    DataError
        A folder holds no report, or one cannot be read.
    """
    found = []
    for folder in folders:
        paths = [folder / "report.json"] if (folder / "report.json").is_file() else sorted(folder.glob("*/report.json"))
        if not paths:
            hint = "Give the output folders of `discrepancy run`, or a folder of them."
            raise DataError(f"{folder} holds no report.json.", hint=hint)
        for path in paths:
            try:
                report = json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise DataError(f"cannot read {path}: {error}.") from error
            if not (isinstance(report, dict) and report.get("version") == VERSION and "provenance" in report):
                raise DataError(f"{path} is no report of `discrepancy run` (version {VERSION}).")
            found.append((path.parent.name, report))
    return found


def score_reports(labels: Mapping[str, Any], reports: Iterable[tuple[str, Mapping[str, Any]]]) -> Score:
    """Match reports with labels by the hash of the recording, else by the folder's name, and score them.

    Parameters
    ----------
    labels : mapping, by the case's name
    reports : iterable of (str, mapping), folder's name and content of report.json

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
    missing : tuple of str, labels without a report
    """
    return Score(tuple(_targets(outcomes)), _confusion(outcomes), _limits(outcomes), missing)


class Measure(NamedTuple):
    """A fraction of the cases of a set that should lie in a range; of one effect-to-noise ratio where it is given."""

    group: str
    what: str
    hit: Callable[[CaseOutcome], bool]
    low: float
    high: float
    ratio: float | None = None


WRONG, EXACT = attrgetter("wrong"), attrgetter("exact")
MEASURES = (
    Measure("null", "any name", WRONG, 0.0, 0.01),
    Measure("null", "said NONE", lambda o: o.answers == ("none",), 0.0, 1.0),
    Measure("awkward_null", "any name", WRONG, 0.0, 0.03),
    *(
        Measure("single", what, hit, low, high, ratio)
        for ratio, exact in EXACT_TARGETS.items()
        for what, hit, low, high in (("exact", EXACT, exact, 1.0), ("wrong name", WRONG, 0.0, 0.02))
    ),
    Measure("zigzag", "right class or set", attrgetter("right_or_set"), 0.95, 1.0),
    Measure("zigzag", "wrong name", WRONG, 0.0, 0.02),
    Measure("pair", "both exact", EXACT, 0.85, 1.0),
    Measure("pair", "wrong name", WRONG, 0.0, 0.02),
    Measure("triple", "all exact", EXACT, 0.70, 1.0),
    Measure("triple", "wrong name", WRONG, 0.0, 0.02),
    Measure("outside", "UNKNOWN", attrgetter("unknown"), 0.90, 1.0),
    Measure("outside", "misnamed", WRONG, 0.0, 0.05),
    Measure("advised", "resolved by the run", EXACT, 0.90, 1.0),
    Measure("advised", "wrong name", WRONG, 0.0, 0.02),
)


def _targets(outcomes: Sequence[CaseOutcome]) -> list[Target]:
    """Return the lines of which there are cases: sets, honesty of the probabilities and intervals, gaps and times."""
    rows = []
    for m in MEASURES:
        part = [o for o in outcomes if o.group == m.group and (m.ratio is None or _nearest(o.ratio) == m.ratio)]
        words = m.group.replace("_", " ") + ("" if m.ratio is None else f", effect/noise {m.ratio:g}")
        rows += _fraction(f"{words}: {m.what}", [m.hit(o) for o in part], m.low, m.high)
    sure = [right for o in outcomes for p, right in o.probabilities if SURE[0] <= p <= SURE[1]]
    rows += _fraction(f"names of posterior {SURE[0]:g} to {SURE[1]:g}: right", sure, 0.88, 0.98)
    rows += _fraction("95 % intervals: hold the truth", [c for o in outcomes for c in o.covered], 0.92, 0.98)
    closed = [o.closed for o in outcomes if o.closed is not None and o.exact and o.ratio is not None and o.ratio >= 1]
    rows += _quantile("gap closed, effect/noise at least 1: median", closed, 0.5, 0.95, np.inf)
    rows += _quantile("gap closed: 5th percentile", closed, 0.05, 0.80, np.inf)
    seconds = [o.seconds for o in outcomes]
    rows += _quantile("seconds a run: median", seconds, 0.5, 0.0, SECONDS)
    rows += _quantile("seconds a run: longest", seconds, 1.0, 0.0, SECONDS)
    return rows


def _fraction(what: str, hits: Sequence[bool], low: float, high: float) -> list[Target]:
    """One line, or none where nothing was counted."""
    fraction = Proportion(sum(hits), len(hits))
    return [Target(what, fraction.n, fraction.value, fraction.interval, low, high)] if hits else []


def _quantile(what: str, values: Sequence[float], level: float, low: float, high: float) -> list[Target]:
    """One line, or none where nothing was measured."""
    nan = (float("nan"), float("nan"))
    return [Target(what, len(values), float(np.quantile(values, level)), nan, low, high)] if values else []


def _nearest(ratio: float | None) -> float | None:
    """Return the ratio among the targets that is nearest; None where no effect stands out of the noise at all."""
    return None if not ratio else min(EXACT_TARGETS, key=lambda r: abs(np.log(r / ratio)))


def _confusion(outcomes: Sequence[CaseOutcome]) -> dict[str, dict[str, int]]:
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for outcome in outcomes:
        for truth, answer in zip(outcome.truth or ("nothing",), outcome.answers, strict=True):
            counts[truth][answer] += 1
    names = sorted({a for row in counts.values() for a in row} - set(NO_NAME))
    return {truth: {c: counts[truth][c] for c in (*names, *NO_NAME)} for truth in sorted(counts)}


def _limits(outcomes: Sequence[CaseOutcome]) -> dict[str, float | None]:
    """Smallest ratio of each effect such that at it and above, enough are exact."""
    tried: defaultdict[str, defaultdict[float, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for o in outcomes:
        if o.group == "single" and (ratio := _nearest(o.ratio)) is not None:
            tried[o.truth[0]][ratio].append(o.exact)
    limits: dict[str, float | None] = dict.fromkeys(sorted(tried))
    for name in limits:
        for ratio in sorted(tried[name], reverse=True):
            if np.mean(tried[name][ratio]) < DETECTED:
                break
            limits[name] = ratio
    return limits


def score_text(score: Score) -> str:
    """Return target table, confusion matrix and detection limits as text with aligned columns.

    Parameters
    ----------
    score : Score
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
    low, high = (f"{100 * v:g} %" if fraction else f"{v:g}" for v in (target.low, target.high))
    if target.high == 1.0 if fraction else np.isinf(target.high):
        asked = f"at least {low}" if target.low else ""
    else:
        asked = f"{low} to {high}" if target.low else f"at most {high}"
    return [target.what, str(target.n), value, interval, asked, "yes" if target.met else "no"]


def _table(rows: Sequence[Sequence[str]]) -> str:
    """Align columns, the first to the left, under the underlined head."""
    first, *others = ([*map(len, column)] for column in zip(*rows, strict=True))
    lines = [
        "  ".join([row[0].ljust(max(first)), *(c.rjust(max(w)) for c, w in zip(row[1:], others, strict=True))])
        for row in rows
    ]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])
