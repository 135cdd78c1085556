"""Where simulation and recording differ, without and with the named effects: over one joint, and over two."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.words import channel_words, in_reader_units
from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.rigid.registration import evenly_spaced
from gpcorrect.sim.body import Body
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["loop_plots", "residual_over_joints"]

MOST_POINTS = 2500  # drawn in one panel
BINS = 24
DIRECTIONS = ((1.0, "raw", "forward"), (-1.0, "corrected", "back"))
CELLS = 12  # of a map, along each axis
FEWEST = 3  # rows in a cell that is drawn


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
        shown = chosen[evenly_spaced(len(chosen), MOST_POINTS)]
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


def residual_over_joints(evidence: Evidence, index: int, unit: str, joints: tuple[int, ...], types: str) -> Figure:
    """Draw the mean residual of channel `index` over its own joint and the one that spreads it most, before and after.

    Parameters
    ----------
    evidence : Evidence
        Condensed rows; all parts are drawn.
    index : int
        Of the channel.
    unit : str
    joints : tuple of int
        Numbers of the joint columns.
    types : str
        "R" or "P" for each of them.
    """
    figure, axes = new_figure(9.0, 3.4, 1, 2)
    first, second = _pair(evidence, index)
    scale, symbol = in_reader_units(1.0, unit)
    maps = [
        scale * _mean_map(evidence, values[:, index], (first, second)) for values in (evidence.before, evidence.after)
    ]
    largest = float(np.nanmax(np.abs(maps[0]))) if np.isfinite(maps[0]).any() else 1.0
    for ax, image, title in zip(axes, maps, ("before", "with the named effects"), strict=True):
        drawn = _draw(ax, evidence, image, (first, second), types, largest)
        ax.set_title(title, fontsize=9, loc="left")
        ax.set_xlabel(_axis(joints[first], types[first]), fontsize=8)
        ax.set_ylabel(_axis(joints[second], types[second]) if second != first else "", fontsize=8)
    figure.colorbar(drawn, ax=axes, label=f"mean residual [{symbol}]", shrink=0.85)
    return figure


def _axis(joint: int, kind: str) -> str:
    return f"joint {joint} [{'mm' if kind == 'P' else '°'}]"


def _draw(
    ax: Axes, evidence: Evidence, image: FloatArray, pair: tuple[int, int], types: str, largest: float
) -> QuadMesh:
    edges = [in_reader_units(1.0, "m" if types[j] == "P" else "rad")[0] * _edges(evidence.motor[:, j]) for j in pair]
    ax.grid(visible=False)
    return ax.pcolormesh(edges[0], edges[1], image.T, cmap="RdBu_r", vmin=-largest, vmax=largest)


def _edges(values: FloatArray) -> FloatArray:
    """Even edges over the bulk of the values."""
    low, high = np.percentile(values, [1, 99])
    return np.linspace(low, max(high, low + 1e-9), CELLS + 1)


def _cell(evidence: Evidence, column: int) -> tuple[np.ndarray, BoolArray]:
    values, edges = evidence.motor[:, column], _edges(evidence.motor[:, column])
    code = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, CELLS - 1)
    return code, (values >= edges[0]) & (values <= edges[-1])


def _mean_map(evidence: Evidence, values: FloatArray, pair: tuple[int, int]) -> FloatArray:
    """Means `(CELLS, CELLS)`; NaN where there are too few rows."""
    (a, inside_a), (b, inside_b) = _cell(evidence, pair[0]), _cell(evidence, pair[1])
    good = inside_a & inside_b & np.isfinite(values)
    code = (a * CELLS + b)[good]
    count = np.bincount(code, minlength=CELLS**2)
    total = np.bincount(code, values[good], minlength=CELLS**2)
    return np.where(count >= FEWEST, total / np.maximum(count, 1), np.nan).reshape(CELLS, CELLS)


def _pair(evidence: Evidence, index: int) -> tuple[int, int]:
    """Columns of the two joints whose cells explain most of the residual; a channel's own joint is one of them."""
    n, own = evidence.motor.shape[1], evidence.joint[index]
    pairs = [p for p in combinations(range(n), 2) if own < 0 or own in p]
    if not pairs:
        return 0, 0
    best = max(pairs, key=lambda p: _between(_mean_map(evidence, evidence.before[:, index], p)))
    return best if own < 0 or best[0] == own else (best[1], best[0])


def _between(image: FloatArray) -> float:
    return float(np.nanvar(image)) if np.isfinite(image).sum() > 1 else 0.0
