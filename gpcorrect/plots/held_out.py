"""Errors on held-out trajectories in one picture, for documents; the page draws the rest itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.calibration import METHODS, Measured
from gpcorrect.plots.style import COLOURS, LABELS, new_figure
from gpcorrect.types import CalibrationLog, FloatArray


def overview(measured: Measured, log: CalibrationLog) -> Figure:
    """Path of the trajectory with the median error from its widest side, and mean and 95th percentile of all errors.

    Parameters
    ----------
    measured : Measured
        Errors of n samples of `log`.
    log : CalibrationLog
        The held-out recording.
    """
    errors = _errors(measured)
    figure, axes = new_figure(9.5, 3.4, 1, 1 + len(errors))
    paths = _paths(measured, log, typical_trajectory(measured))
    i, j = sorted(int(k) for k in np.argsort(-np.ptp(paths["what was commanded"][0], axis=0))[:2])
    for label, (path, style) in paths.items():
        axes[0].plot(path[:, i], path[:, j], label=label, **style)
    axes[0].set(xlabel=f"{'xyz'[i]} [mm]", ylabel=f"{'xyz'[j]} [mm]", aspect="equal", adjustable="datalim")
    _legend_above(axes[0], 2)
    for ax, (label, sizes) in zip(axes[1:], errors, strict=True):
        means, most = zip(*((size.mean(), np.percentile(size, 95)) for size in sizes.values()), strict=True)
        ax.bar(range(len(sizes)), means, color=[COLOURS[method] for method in sizes], width=0.6)
        for k, (mean, high) in enumerate(zip(means, most, strict=True)):
            place, shift = (k, max(mean, high)), (0, 4)
            ax.annotate(f"{mean:.2f}", place, shift, textcoords="offset points", ha="center", fontsize=8)
        marks = "95th percentile (bar and number: mean)"
        ax.plot(range(len(sizes)), most, "_", color=COLOURS["ink"], markersize=18, label=marks)
        ax.set_xticks(range(len(sizes)), ["before", "rigid", "corrected"])
        ax.set_ylabel(f"{label}: mean")
        ax.margins(y=0.12)
        _legend_above(ax, 1)
    return figure


def typical_trajectory(measured: Measured) -> int:
    """Return the number of the trajectory whose mean corrected error is the median one.

    Parameters
    ----------
    measured : Measured
        Of a whole recording; joints that were not measured count nothing.
    """
    ids = np.unique(measured.trajectory)
    size = np.linalg.norm(np.nan_to_num(measured.corrected[:, :3]), axis=1)
    means = np.array([size[measured.trajectory == i].mean() for i in ids])
    return int(ids[np.argsort(means)[len(ids) // 2]])


def _errors(measured: Measured) -> list[tuple[str, dict[str, FloatArray]]]:
    """Name and size (n,), by method, of the position error (mm) and, where measured, of the rotation error (deg)."""
    parts = [("position error [mm]", slice(0, 3), 1e3), ("rotation error [deg]", slice(3, 6), 180 / np.pi)]
    parts = parts if np.isfinite(measured.corrected[:, 3:]).any() else parts[:1]
    return [
        (label, {method: scale * np.linalg.norm(measured.of(method)[:, columns], axis=1) for method in METHODS})
        for label, columns, scale in parts
    ]


def _paths(measured: Measured, log: CalibrationLog, trajectory: int) -> dict[str, tuple[FloatArray, dict[str, Any]]]:
    """Return, by label, positions (mm) of each method and the command along a trajectory, and their style."""
    assert log.setpoint_cp is not None
    rows = np.flatnonzero(measured.trajectory == trajectory)
    command = 1e3 * log.setpoint_cp.position[measured.rows[rows]]
    paths: dict[str, tuple[FloatArray, dict[str, Any]]] = {
        LABELS[m]: (command - 1e3 * measured.of(m)[rows, :3], {"color": COLOURS[m], "linewidth": 1.4}) for m in METHODS
    }
    paths["what was commanded"] = command, {"color": COLOURS["ink"], "linewidth": 1.2, "linestyle": "--"}
    return paths


def _legend_above(ax: Axes, columns: int) -> None:
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1)}
    ax.legend(frameon=False, fontsize=7, ncols=columns, **place)
