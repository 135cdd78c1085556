"""Loop plots: the residual against position, by the direction of travel, without and with the named effects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.words import channel_words, in_reader_units
from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.sim.body import Body
from gpcorrect.types import FloatArray

__all__ = ["loop_plots"]

MOST_POINTS = 2500  # drawn in one panel
BINS = 24
DIRECTIONS = ((1.0, "raw", "forward"), (-1.0, "corrected", "back"))


def loop_plots(evidence: Evidence, channels: Sequence[tuple[int, Channel]], body: Body) -> Figure:
    """Draw residual against position on the test set, a row for each channel, before and after.

    Parameters
    ----------
    evidence : Evidence
        Condensed rows.
    channels : sequence of (int, Channel)
        Which ones, with their columns; one of no single joint is drawn against the joint that spreads it most.
    body : Body
        For the joints' numbers and types.
    """
    figure, axes = new_figure(9.0, 0.5 + 2.5 * len(channels), len(channels), 2)
    for row, (index, channel) in enumerate(channels):
        unit = channel.unit
        left, right = axes[2 * row : 2 * row + 2]
        column = _joint_column(evidence, index)
        pair = (evidence.before[:, index], evidence.after[:, index])
        for ax, values, title in zip((left, right), pair, ("before", "with the named effects"), strict=True):
            _panel(ax, evidence, values, column, (unit, "m" if body.types[column] == "P" else "rad"))
            ax.set_title(f"{channel_words(channel)}: {title}", fontsize=9, loc="left")
        limits = _limits(pair[0][evidence.test], unit)
        left.set_ylim(limits)
        right.set_ylim(limits)
        left.set_ylabel(f"measured - simulated [{in_reader_units(0.0, unit)[1]}]", fontsize=8)
        for ax in (left, right):
            position_unit = in_reader_units(0.0, "m" if body.types[column] == "P" else "rad")[1]
            ax.set_xlabel(f"motor position, joint {body.joints[column]} [{position_unit}]", fontsize=8)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, frameon=False, fontsize=8, markerscale=4)
    return figure


def _joint_column(evidence: Evidence, index: int) -> int:
    """Return the joint column to draw a channel against: its own, or the one that explains most of it."""
    if evidence.joint[index] >= 0:
        return evidence.joint[index]
    fractions = [_explained(column, evidence.before[:, index]) for column in evidence.motor.T]
    return int(np.argmax(fractions))


def _explained(position: FloatArray, residual: FloatArray) -> float:
    good = np.isfinite(residual)
    edges = np.unique(np.quantile(position[good], np.linspace(0, 1, 11)))
    if len(edges) < 3:
        return 0.0
    code = np.clip(np.searchsorted(edges, position[good], side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(code)
    mean = np.bincount(code, residual[good]) / np.maximum(count, 1)
    return float((count * (mean - residual[good].mean()) ** 2).sum())


def _panel(ax: Axes, evidence: Evidence, values: FloatArray, column: int, units: tuple[str, str]) -> None:
    scale, along = in_reader_units(1.0, units[0])[0], in_reader_units(1.0, units[1])[0]
    for direction, colour, label in DIRECTIONS:
        rows = evidence.test & (evidence.direction[:, column] * direction > 0.5) & np.isfinite(values)
        chosen = np.flatnonzero(rows)
        if len(chosen) == 0:
            continue
        shown = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), MOST_POINTS)).astype(np.int64))]
        x, y = along * evidence.motor[:, column], scale * values
        ax.plot(x[shown], y[shown], ".", color=COLOURS[colour], markersize=1.6, alpha=0.35, label=label)
        centre, median = _running_median(x[chosen], y[chosen])
        ax.plot(centre, median, color=COLOURS[colour], linewidth=1.8)
    ax.axhline(0.0, color=COLOURS["quiet"], linewidth=0.8)


def _running_median(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Medians of y in cells of x that hold equally many points."""
    order = np.argsort(x, kind="stable")
    parts = np.array_split(order, min(BINS, max(1, len(x) // 10)))
    return np.array([np.median(x[p]) for p in parts]), np.array([np.median(y[p]) for p in parts])


def _limits(values: FloatArray, unit: str) -> tuple[float, float]:
    """Both panels on one scale, a few outliers left outside."""
    low, high = np.nanpercentile(in_reader_units(1.0, unit)[0] * values, [0.5, 99.5])
    low, high = min(low, 0.0), max(high, 0.0)
    margin = 0.08 * (high - low) + 1e-12
    return float(low - margin), float(high + margin)
