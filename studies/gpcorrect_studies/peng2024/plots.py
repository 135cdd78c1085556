"""Figures of the joint-level study: accuracy over minutes of calibration, over hours of use, and over homings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.plots.style import COLOURS, new_figure

__all__ = ["accuracy_over_homings", "accuracy_over_hours", "accuracy_over_minutes"]

STYLES = {
    "linear": ("rigid", "^", "linear"),
    "quadratic": ("dropped", "v", "quadratic"),
    "network": ("raw", "o", "network"),
    "ukf": ("quiet", "D", "UKF"),
    "gp": ("corrected", "s", "ours (gp)"),
}
USES = {"idle": ":", "unloaded": "--", "loaded 500 g": "-"}
SEEN = {"none seen": "-", "one seen": "--", "new zero": ":"}
UNITS = ("deg", "deg", "mm")
WIDTH, HEIGHT = 9.5, 3.3
HEADROOM = 1.1


def accuracy_over_minutes(points: Sequence[Mapping[str, Any]], published: Sequence[float]) -> Figure:
    """RMSE of each joint by minutes of zig-zag, mean and SD of the repeats; the paper's network as a dotted line."""
    figure, axes = new_figure(WIDTH, HEIGHT, 1, 3)
    minutes = [point["minutes"] for point in points]
    for joint, ax in enumerate(axes):
        for method, (colour, marker, label) in STYLES.items():
            cells = [point["rmse"][method] for point in points]
            _line(ax, minutes, cells, joint, color=COLOURS[colour], marker=marker, label=label)
        ax.axhline(published[joint], color=COLOURS["ink"], linestyle=":", linewidth=1.0, label="the paper's network")
        _finish(ax, joint, "zig-zag [min]")
    return _with_legend(figure, axes)


def accuracy_over_hours(uses: Mapping[str, Mapping[str, Any]], methods: Sequence[str]) -> Figure:
    """RMSE of each joint after hours of each use, of models of the fresh robot."""
    figure, axes = new_figure(WIDTH, HEIGHT, 1, 3)
    for joint, ax in enumerate(axes):
        for use, line in USES.items():
            for method in methods:
                colour, _, label = STYLES[method]
                cells = uses[use]["rmse"][method]
                look = {"color": COLOURS[colour], "linestyle": line, "label": f"{label}, {use}"}
                _line(ax, uses[use]["hours"], cells, joint, **look)
        _finish(ax, joint, "hours of use")
    return _with_legend(figure, axes)


def accuracy_over_homings(points: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> Figure:
    """RMSE of each joint after each homing: none or one seen in training, and with a new zero."""
    figure, axes = new_figure(WIDTH, HEIGHT, 1, 3)
    homings = [point["homings"] for point in points]
    for joint, ax in enumerate(axes):
        for seen, line in SEEN.items():
            for method in methods:
                colour, marker, label = STYLES[method]
                cells = [point["rmse"][method][seen] for point in points]
                look = {"color": COLOURS[colour], "linestyle": line, "marker": marker, "label": f"{label}, {seen}"}
                _line(ax, homings, cells, joint, **look)
        ax.set_xticks(homings)
        _finish(ax, joint, "homings after the training")
    return _with_legend(figure, axes)


def _line(ax: Axes, x: Sequence[float], cells: Sequence[Mapping[str, Any]], joint: int, **look: Any) -> None:
    mean = np.array([cell["mean"][joint] for cell in cells])
    spread = np.array([cell["sd"][joint] for cell in cells])
    ax.plot(x, mean, markersize=4, linewidth=1.4, **look)
    ax.fill_between(x, mean - spread, mean + spread, color=look["color"], alpha=0.15, linewidth=0)


def _finish(ax: Axes, joint: int, label: str) -> None:
    top = max(float(np.max(np.asarray(line.get_ydata(), dtype=np.float64))) for line in ax.get_lines())
    ax.set(xlabel=label, ylabel=f"joint {joint + 1}: RMSE [{UNITS[joint]}]", ylim=(0, HEADROOM * top))


def _with_legend(figure: Figure, axes: Sequence[Axes]) -> Figure:
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, frameon=False, fontsize=8, ncols=3 if len(labels) > 6 else 6, loc="outside upper left"
    )
    return figure
