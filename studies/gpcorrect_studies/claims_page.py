"""The claims of a paper beside ours as a section of a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from gpcorrect.report.page import Page, Section, TableData, write_page
from gpcorrect_studies.claims import TOLERANCE, Compared, Comparison, StudyResult, Verdict

# What the verdicts of claims mean, under each table of them.
LEGEND = (
    "Beyond: better than printed by more than the tolerance. Reversed: the order of the two things that are compared "
    "is the other one here, or a gain is a loss, whichever is better."
)


def write_study_page(
    result: StudyResult,
    verdict: str,
    facts: Sequence[tuple[str, str]],
    sections: Sequence[Section],
    path: Path,
) -> None:
    """Write the self-contained page of a study, its claims first, then its own sections; raises as :func:`write_page`.

    Parameters
    ----------
    result : StudyResult
    verdict : str, its own first sentences; of a run of less than the whole study, the page says so before anything else
    facts, sections : sequences, what else the page shows
    path : Path
    """
    comparison = result.compared()
    words = f"Of {len(comparison.rows)} claims of the paper: {counted(comparison.counts())}. {verdict}"
    if result.short:
        words = f"A short run, with less of everything than the whole study. {words}"
    facts = [*facts, ("time", f"{result.seconds:.0f} s for everything on this page")]
    write_page(
        Page(f"gpcorrect reproduce {result.STUDY}", words, facts, [_claims_section(comparison), *sections]), path
    )


def _claims_section(comparison: Comparison) -> Section:
    """Return the section with every claim, where it is printed, both numbers and the verdict; failed ones first."""
    half, twice = (f"With {100 * k * TOLERANCE:g} %: {counted(comparison.counts(k))}." for k in (0.5, 2.0))
    note = (
        f"What is within {100 * TOLERANCE:g} % of the printed number (of a ratio: of its distance from 1, if less) "
        f"counts as reproduced. {half} {twice}"
    )
    failed = [row for row in comparison.rows if row.failed]
    others = [row for row in comparison.rows if not row.failed]
    tables = [_table("not reproduced or reversed", failed, "")] if failed else []
    tables.append(_table("all others" if failed else "claim", others, note))
    words = [f"{counted(comparison.counts())}. {comparison.caveat}", LEGEND]
    if any(row.ablated for row in failed):
        words.append(
            f"Of the {len(failed)} that are not reproduced or reversed, {sum(row.found for row in failed)} come back, "
            "or at least their order, where something is taken away; what, and what the number then is, stands beside "
            "the verdict."
        )
    return Section("Claim by claim", words, tables)


def _table(head: str, compared: Sequence[Compared], note: str) -> TableData:
    rows = [
        [
            f"{row.claim.where}: {row.claim.says}",
            number(row.printed),
            "-" if row.ours is None else number(row.ours),
            f"{row.verdict.value}: {row.reason}" if row.reason else row.verdict.value,
        ]
        for row in compared
    ]
    return TableData([head, "printed", "ours", "verdict"], rows, note, text=(0, 3))


def setup_section(printed: Mapping[str, float], here: Mapping[str, float]) -> Section:
    """Return the section with the numbers of the set-up, the paper's and those of the run.

    Parameters
    ----------
    printed, here : mapping, numbers by name; those that a run does not have are left empty
    """
    rows = [
        [name.replace("_", " "), number(value), number(here[name]) if name in here else "-"]
        for name, value in printed.items()
    ]
    return Section("Set-up", (), (TableData(["", "printed", "here"], rows),))


def counted(counts: Mapping[Verdict, int]) -> str:
    """Return the counts as words, such as "12 reproduced, 3 beyond"; verdicts of no claim are left out."""
    return ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)


def number(value: float) -> str:
    """Return a number as text, with three digits at least."""
    return f"{value:.0f}" if abs(value) >= 100 or value == int(value) else f"{value:.3g}"


def paired(ours: Mapping[str, Sequence[str]], printed: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Return the rows of a table, each of ours under the printed one.

    Parameters
    ----------
    ours, printed : mapping, the cells of a row by its name; one of the two may lack it, and printed rows may be shorter
    """
    width, rows = max(len(cells) for cells in ours.values()), []
    for name in {**printed, **ours}:
        if name in printed:
            rows.append([f"{name}, printed", *printed[name], *[""] * (width - len(printed[name]))])
        if name in ours:
            rows.append([f"{name}, ours" if name in printed else name, *ours[name]])
    return rows
