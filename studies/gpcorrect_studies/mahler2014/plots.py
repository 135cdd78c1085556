"""Figures of the study: error and time over training states (Fig. 5), and where the tool came to stand (Table II)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray
from gpcorrect_studies.mahler2014.training_size import TrainingSize

__all__ = ["training_curves", "visits"]

SHADES = ("raw", "corrected", "rigid")


def visits(errors: Mapping[str, FloatArray]) -> Figure:
    """Lengths of the errors `(repetitions, places, 6)` of each kind of command, on a logarithmic scale."""
    figure, axes = new_figure(9.5, 3.4, 1, 2)
    quantities = ((slice(0, 3), 1e3, "position error [mm]"), (slice(3, 6), 180 / np.pi, "rotation error [deg]"))
    for ax, (columns, scale, label) in zip(axes, quantities, strict=True):
        for i, ((name, error), shade) in enumerate(zip(errors.items(), SHADES, strict=False)):
            size = scale * np.linalg.norm(error[..., columns], axis=-1)
            x = np.broadcast_to(1 + np.arange(size.shape[1]) + 0.22 * (i - 1), size.shape)
            ax.plot(x.ravel(), size.ravel(), ".", color=COLOURS[shade], markersize=5, alpha=0.75, label=name)
        ax.set(xlabel="place", ylabel=label, yscale="log", xticks=range(1, size.shape[1] + 1))
    axes[0].legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    return figure


STYLES = {"exact": ("raw", "o"), "sparse": ("corrected", "s")}
HEADROOM = 1.15  # of the axis above the largest error
NAMES = {"exact": "exact posterior", "sparse": "inducing points (default)"}


def training_curves(points: Sequence[TrainingSize], published_seconds: Mapping[int, float]) -> Figure:
    """Position error, rotation error and fitting time; the paper's times (by number of states, s) as crosses."""
    figure, axes = new_figure(9.5, 3.2, 1, 3)
    quantities = (
        ("position_mm", "position error [mm]"),
        ("rotation_deg", "rotation error [deg]"),
        ("seconds", "fitting time [s]"),
    )
    for ax, (name, label) in zip(axes, quantities, strict=True):
        _lines(ax, points, name)
        ax.set(xscale="log", xlabel="training states", ylabel=label)
    for ax, (name, _) in zip(axes[:2], quantities, strict=False):
        ax.set_ylim(0, HEADROOM * max(getattr(point, name) for point in points))
    states = list(published_seconds)
    axes[2].plot(states, list(published_seconds.values()), "x", color=COLOURS["ink"], label="the paper's")
    axes[2].set_yscale("log")
    axes[2].legend(frameon=False, fontsize=7)
    return figure


def _lines(ax: Axes, points: Sequence[TrainingSize], name: str) -> None:
    for method, (colour, marker) in STYLES.items():
        chosen = [point for point in points if point.method == method]
        states, values = [point.states for point in chosen], [getattr(point, name) for point in chosen]
        ax.plot(states, values, color=COLOURS[colour], marker=marker, markersize=4, linewidth=1.4, label=NAMES[method])
