"""Error and fitting time against the number of training states, as Mahler 2014, Fig. 5 draws them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.reproduce.training_size import TrainingSize

__all__ = ["training_curves"]

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
