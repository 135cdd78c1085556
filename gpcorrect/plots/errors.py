"""Held-out errors: how they are distributed, and how they depend on speed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.experiment import METHODS, Measured
from gpcorrect.plots.style import COLOURS, LABELS, new_figure
from gpcorrect.types import FloatArray

__all__ = ["error_by_speed", "error_distribution"]

SPEED_BINS = 8
QUANTITIES = ((slice(0, 3), 1e3, "position error [mm]"), (slice(3, 6), 180 / np.pi, "rotation error [deg]"))


def error_distribution(measured: Measured) -> Figure:
    """Share of held-out samples below an error: position and, where measured, rotation."""
    parts = _parts(measured)
    figure, axes = new_figure(9.0, 3.2, 1, len(parts))
    for ax, (columns, scale, label) in zip(axes, parts, strict=True):
        for method in METHODS:
            size = np.sort(scale * np.linalg.norm(getattr(measured, method)[:, columns], axis=1))
            share = 100 * (np.arange(size.size) + 1) / size.size
            ax.plot(size, share, color=COLOURS[method], label=LABELS[method], linewidth=1.8)
        ax.set(xscale="log", xlabel=label, ylabel="share of samples below [%]", ylim=(0, 100))
    axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    return figure


def error_by_speed(measured: Measured) -> Figure:
    """Median and 90th percentile of the error in bins of speed that hold equally many samples."""
    parts = _parts(measured)
    figure, axes = new_figure(9.0, 3.0, 1, len(parts))
    edges = np.unique(np.quantile(measured.speed, np.linspace(0, 1, SPEED_BINS + 1)))
    for ax, (columns, scale, label) in zip(axes, parts, strict=True):
        for method in METHODS:
            size = scale * np.linalg.norm(getattr(measured, method)[:, columns], axis=1)
            _binned(ax, 100 * measured.speed, size, 100 * edges, method)
        ax.set(xlabel="speed [cm/s]", ylabel=label)
        ax.set_ylim(bottom=0)
    axes[0].legend(frameon=False, fontsize=8)
    return figure


def _binned(ax: Axes, x: FloatArray, y: FloatArray, edges: FloatArray, method: str) -> None:
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    filled = np.unique(index)
    middle = np.array([np.median(x[index == i]) for i in filled])
    half, most = (np.array([np.percentile(y[index == i], p) for i in filled]) for p in (50, 90))
    ax.plot(
        middle,
        half,
        color=COLOURS[method],
        marker="o",
        markersize=3.5,
        linewidth=1.6,
        label=f"{LABELS[method]} (median; band to 90 %)",
    )
    ax.fill_between(middle, half, most, color=COLOURS[method], alpha=0.15, linewidth=0)


def _parts(measured: Measured) -> tuple[tuple[slice, float, str], ...]:
    return QUANTITIES if np.isfinite(measured.corrected[:, 3:]).any() else QUANTITIES[:1]
