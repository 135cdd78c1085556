"""How much the named effects close: before and after, between noise, placebo and what a black box reaches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from gpcorrect.discrepancy.outcome.words import channel_words, in_reader_units
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray

__all__ = ["gap_chart", "rms_at"]

WIDE = 30.0  # largest over smallest: beyond, a linear scale hides the small ones
MARKS = (
    ("before", "o", "raw", "before"),
    ("after", "o", "corrected", "with the named effects"),
    ("noise", "|", "ink", "noise"),
    ("black_box_ceiling", "D", "rigid", "black box (ceiling)"),
    ("placebo", "x", "dropped", "placebo"),
)


def rms_at(gap: Mapping[str, Any], key: str) -> float:
    """Return the RMS that a figure of the gap stands for; ceiling and placebo are given as closed shares."""
    value = gap[key]
    if value is None or key in ("before", "after", "noise"):
        return np.nan if value is None else float(value)
    left = gap["noise"] ** 2 + (1.0 - value) * (gap["before"] ** 2 - gap["noise"] ** 2)
    return float(np.sqrt(max(left, 0.0)))


def gap_chart(gaps: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Draw the sealed part's figures, a line a channel, angles and lengths apart.

    Parameters
    ----------
    gaps : mapping
        `gap` of the report's JSON form.
    """
    units = [u for u in ("rad", "m") if any(g["unit"] == u for g in gaps.values())]
    most = max(sum(g["unit"] == u for g in gaps.values()) for u in units)
    figure, axes = new_figure(9.0, 1.1 + 0.33 * most, 1, len(units))
    for ax, unit in zip(axes, units, strict=True):
        _panel(ax, {n: g for n, g in gaps.items() if g["unit"] == unit}, unit)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(MARKS), frameon=False, fontsize=8)
    return figure


def _panel(ax: Axes, gaps: Mapping[str, Mapping[str, Any]], unit: str) -> None:
    scale, symbol = in_reader_units(1.0, unit)
    lines = np.arange(len(gaps))[::-1]
    values = {key: scale * np.array([rms_at(g, key) for g in gaps.values()]) for key, *_ in MARKS}
    ax.hlines(lines, values["after"], values["before"], color="#c9ced6", linewidth=2, zorder=1)
    for key, marker, colour, label in MARKS:
        ax.plot(values[key], lines, marker, color=COLOURS[colour], markersize=11 if marker == "|" else 6, label=label)
    ax.set_yticks(lines, [channel_words(name) for name in gaps])
    ax.set_xlabel(f"root mean square of the residual [{symbol}]", fontsize=8)
    _scale(ax, np.concatenate(list(values.values())))
    ax.set_ylim(-0.6, len(gaps) - 0.4)


def _scale(ax: Axes, values: FloatArray) -> None:
    """Start at zero; where channels differ by far, on a logarithmic scale instead."""
    seen = values[np.isfinite(values) & (values > 0)]
    if len(seen) and seen.max() > WIDE * seen.min():
        ax.set_xscale("log")
        ax.xaxis.set_minor_formatter(NullFormatter())  # over a decade or two its labels lie on top of each other
    else:
        ax.set_xlim(left=0.0)
