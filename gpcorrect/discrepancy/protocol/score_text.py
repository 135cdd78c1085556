"""A score as plain text, for terminals and for pages of documentation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.protocol.outcomes import NO_NAME
from gpcorrect.discrepancy.protocol.score_reports import Score, Target

__all__ = ["score_text"]


def score_text(score: Score) -> str:
    """Return target table, confusion matrix and detection limits as text with aligned columns."""
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
    share = np.isfinite(target.interval[0])
    value = f"{100 * target.value:.1f} %" if share else f"{target.value:.3g}"
    interval = " to ".join(f"{100 * end:.1f}" for end in target.interval) if share else ""
    return [
        target.what,
        str(target.n),
        value,
        interval,
        _asked(target, share=bool(share)),
        "yes" if target.met else "no",
    ]


def _asked(target: Target, *, share: bool) -> str:
    low, high = (f"{100 * v:g} %" if share else f"{v:g}" for v in (target.low, target.high))
    unbounded = target.high == 1.0 if share else np.isinf(target.high)
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
