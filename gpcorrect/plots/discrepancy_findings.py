"""What was found and what speaks for it: what the names close, their posterior, the search's gains, likeness."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from gpcorrect.discrepancy.naming.posterior import Alternative
from gpcorrect.discrepancy.outcome.result import ChannelGap
from gpcorrect.discrepancy.outcome.words import channel_words, in_reader_units
from gpcorrect.discrepancy.search.state import Step
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray

__all__ = ["gap_chart", "nats_waterfall", "posterior_bars", "signature_correlation"]

WIDE = 30.0  # largest over smallest: beyond, a linear scale hides the small ones
MOST_BARS = 6  # of one effect's posterior
COLUMNS = 2


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


def posterior_bars(effects: Sequence[tuple[str, Sequence[Alternative]]]) -> Figure:
    """Draw the posterior of what could stand in each effect's place, nothing and unknown among it.

    Parameters
    ----------
    effects : sequence of (str, sequence of Alternative)
        Title, and what could stand in its place, most probable first.
    """
    rows = -(-len(effects) // COLUMNS)
    figure, axes = new_figure(9.0, 0.2 + 1.75 * rows, rows, min(COLUMNS, len(effects)))
    for ax in axes[len(effects) :]:
        ax.set_visible(False)
    for ax, (title, alternatives) in zip(axes, effects, strict=False):
        shown = _with_none_and_unknown(alternatives)
        lines = np.arange(len(shown))[::-1]
        colours = [COLOURS["corrected" if a.is_effect else "quiet"] for a in shown]
        values = [100 * a.probability for a in shown]
        ax.barh(lines, values, color=colours, height=0.62)
        for line, value in zip(lines, values, strict=True):
            ax.text(min(value, 100) + 1.5, line, f"{value:.0f} %", va="center", fontsize=8, color=COLOURS["ink"])
        ax.set_yticks(lines, [a.label for a in shown])
        ax.set(xlim=(0, 115), xticks=[])
        ax.set_title(title, fontsize=9, loc="left")
        ax.grid(visible=False)
    return figure


def _with_none_and_unknown(alternatives: Sequence[Alternative]) -> list[Alternative]:
    """Return the most probable ones; nothing and unknown always among them."""
    fixed = [a for a in alternatives if not a.is_effect]
    named = [a for a in alternatives if a.is_effect]
    return sorted([*named[: MOST_BARS - len(fixed)], *fixed], key=lambda a: -a.probability)


def nats_waterfall(steps: Sequence[Step]) -> Figure:
    """Draw the held-out gain of every step of the search, on a logarithmic scale; removals go back.

    Parameters
    ----------
    steps : sequence of Step
        In their order.
    """
    figure, (ax,) = new_figure(9.0, 0.9 + 0.28 * len(steps))
    lines = np.arange(len(steps))[::-1]
    nats = np.array([s.nats for s in steps])
    colours = [COLOURS["corrected"] if n > 0 else COLOURS["raw"] for n in nats]
    sizes = np.maximum(np.abs(nats), 1.0)
    ax.barh(lines, sizes, color=colours, height=0.62)
    for line, size, value in zip(lines, sizes, nats, strict=True):
        ax.text(size * 1.06, line, f"{value:+,.0f}".replace(",", " "), va="center", fontsize=8)
    ax.set_yticks(lines, [s.label for s in steps])
    ax.set_xscale("log")
    ax.set_xlim(1.0, 3.0 * float(sizes.max()))
    ax.set_xlabel("log Bayes factor on held-out trajectories [nats], in the order of the search", fontsize=8)
    return figure


def signature_correlation(correlation: FloatArray, labels: Sequence[str]) -> Figure:
    """Draw the cosines between whitened signatures: near 1 or -1, these data cannot tell two apart.

    Parameters
    ----------
    correlation : (p, p) array
        Cosines.
    labels : sequence of str
        Of its rows.
    """
    n = len(labels)
    figure, (ax,) = new_figure(3.6 + 0.42 * n, 1.9 + 0.42 * n)
    image = ax.imshow(correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    ax.grid(visible=False)
    ax.set_xticks(range(n), labels, rotation=45, ha="right")
    ax.set_yticks(range(n), labels)
    for i in range(n):
        for j in range(n):
            dark = abs(correlation[i, j]) > 0.6
            ax.text(j, i, f"{correlation[i, j]:.2f}", ha="center", va="center", fontsize=7, color="w" if dark else "k")
    figure.colorbar(image, ax=ax, shrink=0.8, label="cosine")
    return figure
