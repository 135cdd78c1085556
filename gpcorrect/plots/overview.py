"""The whole result in one picture: a held-out path before and after, and the errors of all of them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.experiment import METHODS, Measured
from gpcorrect.plots.style import COLOURS, LABELS, new_figure
from gpcorrect.plots.trajectory import typical_trajectory
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["overview"]


def overview(measured: Measured, log: CalibrationLog) -> Figure:
    """Path of the trajectory with the median error from its widest side, and mean and 95th percentile of the errors."""
    turned = bool(np.isfinite(measured.corrected[:, 3:]).any())
    figure, axes = new_figure(9.5, 3.4, 1, 3 if turned else 2)
    _path(axes[0], measured, log)
    _bars(axes[1], measured, slice(0, 3), 1e3, "position error [mm]")
    if turned:
        _bars(axes[2], measured, slice(3, 6), 180 / np.pi, "rotation error [deg]")
    return figure


def _path(ax: Axes, measured: Measured, log: CalibrationLog) -> None:
    assert log.setpoint_cp is not None
    rows = log.trajectory[measured.rows] == typical_trajectory(measured, log)
    command = log.setpoint_cp.position[measured.rows[rows]]
    i, j = sorted(int(k) for k in np.argsort(-np.ptp(command, axis=0))[:2])
    for method in METHODS:
        given = command - getattr(measured, method)[rows, :3]
        _line(ax, given, (i, j), COLOURS[method], LABELS[method])
    _line(ax, command, (i, j), COLOURS["ink"], "what was commanded", "--")
    ax.set(xlabel=f"{'xyz'[i]} [mm]", ylabel=f"{'xyz'[j]} [mm]", aspect="equal", adjustable="datalim")
    ax.legend(frameon=False, fontsize=7, loc="lower left", bbox_to_anchor=(0, 1), ncols=2)


def _line(ax: Axes, path: FloatArray, plane: tuple[int, int], colour: str, label: str, style: str = "-") -> None:
    x, y = (1e3 * path[:, k] for k in plane)
    ax.plot(x, y, style, color=colour, linewidth=1.5, label=label)


def _bars(ax: Axes, measured: Measured, columns: slice, scale: float, label: str) -> None:
    sizes = [scale * np.linalg.norm(getattr(measured, method)[:, columns], axis=1) for method in METHODS]
    means, most = [s.mean() for s in sizes], [np.percentile(s, 95) for s in sizes]
    ax.bar(range(len(sizes)), means, color=[COLOURS[m] for m in METHODS], width=0.6)
    for i, (mean, high) in enumerate(zip(means, most, strict=True)):
        ax.annotate(f"{mean:.2f}", (i, max(mean, high)), (0, 4), textcoords="offset points", ha="center", fontsize=8)
    marks = "95th percentile (bar and number: mean)"
    ax.plot(range(len(sizes)), most, "_", color=COLOURS["ink"], markersize=18, label=marks)
    ax.set_xticks(range(len(sizes)), ["before", "rigid", "corrected"])
    ax.set_ylabel(f"{label}: mean")
    ax.margins(y=0.12)
    ax.legend(frameon=False, fontsize=7, loc="lower left", bbox_to_anchor=(0, 1))
