"""What speaks for the names: posterior bars with none and unknown, nats of the search, likeness of the signatures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.discrepancy.naming.posterior import Alternative
from gpcorrect.discrepancy.search.state import Step
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray

__all__ = ["nats_waterfall", "posterior_bars", "signature_correlation"]

MOST_BARS = 6
COLUMNS = 2


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
