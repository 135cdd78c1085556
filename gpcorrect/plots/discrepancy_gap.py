"""How much the named effects close: before and after, beside noise, permutation control and black box."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from gpcorrect.discrepancy.outcome.result import ChannelGap
from gpcorrect.discrepancy.outcome.words import channel_words, in_reader_units
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray

__all__ = ["gap_chart"]

WIDE = 30.0  # largest over smallest: beyond, a linear scale hides the small ones


def _rms_left(gap: ChannelGap, closed: float) -> float:
    """Root mean square that is left when this fraction of the gap is closed."""
    left = gap.noise**2 + (1.0 - closed) * (gap.before**2 - gap.noise**2)
    return float(np.sqrt(max(left, 0.0))) if np.isfinite(left) else np.nan


Mark = tuple[Callable[[ChannelGap], float], str, str, str]
MARKS: tuple[Mark, ...] = (
    (lambda g: g.before, "o", "raw", "before"),
    (lambda g: g.after, "o", "corrected", "with the named effects"),
    (lambda g: g.noise, "|", "ink", "noise"),
    (lambda g: _rms_left(g, g.black_box_ceiling), "D", "rigid", "black box (ceiling)"),
    (lambda g: _rms_left(g, g.permutation_control), "x", "dropped", "permutation control"),
)


def gap_chart(gaps: Sequence[ChannelGap]) -> Figure:
    """Draw the test set's figures, a line a channel, angles and lengths apart.

    Parameters
    ----------
    gaps : sequence of ChannelGap
        Of a result.
    """
    units = [u for u in ("rad", "m") if any(g.channel.unit == u for g in gaps)]
    most = max(sum(g.channel.unit == u for g in gaps) for u in units)
    figure, axes = new_figure(9.0, 1.1 + 0.33 * most, 1, len(units))
    for ax, unit in zip(axes, units, strict=True):
        _panel(ax, [g for g in gaps if g.channel.unit == unit], unit)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(MARKS), frameon=False, fontsize=8)
    return figure


def _panel(ax: Axes, gaps: Sequence[ChannelGap], unit: str) -> None:
    scale, symbol = in_reader_units(1.0, unit)
    lines = np.arange(len(gaps))[::-1]
    ax.hlines(
        lines, [scale * g.after for g in gaps], [scale * g.before for g in gaps], color="#c9ced6", linewidth=2, zorder=1
    )
    values = [scale * np.array([size(g) for g in gaps]) for size, *_ in MARKS]
    for value, (_, marker, colour, label) in zip(values, MARKS, strict=True):
        ax.plot(value, lines, marker, color=COLOURS[colour], markersize=11 if marker == "|" else 6, label=label)
    ax.set_yticks(lines, [channel_words(g.channel) for g in gaps])
    ax.set_xlabel(f"root mean square of the residual [{symbol}]", fontsize=8)
    _scale(ax, np.concatenate(values))
    ax.set_ylim(-0.6, len(gaps) - 0.4)


def _scale(ax: Axes, values: FloatArray) -> None:
    """Start at zero; where channels differ by far, on a logarithmic scale instead."""
    seen = values[np.isfinite(values) & (values > 0)]
    if len(seen) and seen.max() > WIDE * seen.min():
        ax.set_xscale("log")
        ax.xaxis.set_minor_formatter(NullFormatter())  # over a decade or two its labels lie on top of each other
    else:
        ax.set_xlim(left=0.0)
