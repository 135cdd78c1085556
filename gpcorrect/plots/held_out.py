"""Errors on held-out trajectories: how large, at what speed, along a trajectory, where, and inside which intervals."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import norm

from gpcorrect.calibration import COMPONENTS, METHODS, Measured
from gpcorrect.plots.style import COLOURS, LABELS, new_figure
from gpcorrect.rigid.registration import evenly_spaced
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

__all__ = [
    "error_by_speed",
    "error_distribution",
    "overview",
    "reliability",
    "residual_maps",
    "trajectory_errors",
    "trajectory_paths",
    "typical_trajectory",
    "workspace_coverage",
]

SPEED_BINS = 8  # that hold equally many samples; chosen by hand
MOST_POINTS = 6000  # of a scatter plot, so that a page stays under a megabyte or so; chosen by hand
Z95 = float(norm.ppf(0.975))  # of a normal law


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
    _, paths = _paths(measured, log, typical_trajectory(measured, log))
    i, j = sorted(int(k) for k in np.argsort(-np.ptp(paths["what was commanded"][0], axis=0))[:2])
    for label, (path, style) in paths.items():
        axes[0].plot(path[:, i], path[:, j], label=label, **style)
    axes[0].set(xlabel=f"{'xyz'[i]} [mm]", ylabel=f"{'xyz'[j]} [mm]", aspect="equal", adjustable="datalim")
    _legend_above(axes[0], 2, fontsize=7)
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
        _legend_above(ax, 1, fontsize=7)
    return figure


def error_distribution(measured: Measured) -> Figure:
    """Fraction of held-out samples below an error: position and, where measured, rotation.

    Parameters
    ----------
    measured : Measured
    """
    errors = _errors(measured)
    figure, axes = new_figure(9.0, 3.2, 1, len(errors))
    for ax, (label, sizes) in zip(axes, errors, strict=True):
        for method, size in sizes.items():
            below = 100 * (np.arange(size.size) + 1) / size.size
            ax.plot(np.sort(size), below, color=COLOURS[method], label=LABELS[method], linewidth=1.8)
        ax.set(xscale="log", xlabel=label, ylabel="fraction of samples below [%]", ylim=(0, 100))
    axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    return figure


def error_by_speed(measured: Measured) -> Figure:
    """Median and 90th percentile of the error in bins of speed that hold equally many samples.

    Parameters
    ----------
    measured : Measured
    """
    errors = _errors(measured)
    figure, axes = new_figure(9.0, 3.0, 1, len(errors))
    speed = 100 * measured.speed
    edges = np.unique(np.quantile(speed, np.linspace(0, 1, SPEED_BINS + 1)))
    index = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, max(len(edges) - 2, 0))
    bins = [index == i for i in np.unique(index)]
    middle = np.array([np.median(speed[rows]) for rows in bins])
    for ax, (label, sizes) in zip(axes, errors, strict=True):
        for method, size in sizes.items():
            half, most = np.array([np.percentile(size[rows], (50, 90)) for rows in bins]).T
            title = f"{LABELS[method]} (median; band to 90 %)"
            ax.plot(middle, half, color=COLOURS[method], marker="o", markersize=3.5, linewidth=1.6, label=title)
            ax.fill_between(middle, half, most, color=COLOURS[method], alpha=0.15, linewidth=0)
        ax.set(xlabel="speed [cm/s]", ylabel=label)
        ax.set_ylim(bottom=0)
    axes[0].legend(frameon=False, fontsize=8)
    return figure


def typical_trajectory(measured: Measured, log: CalibrationLog) -> int:
    """Return the number of the held-out trajectory whose mean corrected error is the median one.

    Parameters
    ----------
    measured : Measured
        Errors of n samples of `log`.
    log : CalibrationLog
        The held-out recording.
    """
    number = log.trajectory[measured.rows]
    ids = np.unique(number)
    size = np.linalg.norm(measured.corrected[:, :3], axis=1)
    means = np.array([size[number == i].mean() for i in ids])
    return int(ids[np.argsort(means)[len(ids) // 2]])


def trajectory_paths(measured: Measured, log: CalibrationLog, trajectory: int) -> Figure:
    """Commanded positions over time, and what each method commands for the observed poses (Mahler 2014, Fig. 4).

    Parameters
    ----------
    measured : Measured
        Errors of n samples of `log`.
    log : CalibrationLog
        The held-out recording.
    trajectory : int
    """
    time, paths = _paths(measured, log, trajectory)
    figure, axes = new_figure(9.0, 5.2, 3, 1, share_x=True)
    for i, ax in enumerate(axes):
        for label, (path, style) in paths.items():
            ax.plot(time, path[:, i], label=label, **style)
        ax.set_ylabel(f"{'xyz'[i]} [mm]")
    _legend_above(axes[0], 4)
    axes[-1].set_xlabel("time [s]")
    return figure


def trajectory_errors(measured: Measured, log: CalibrationLog, trajectory: int) -> Figure:
    """Errors of the corrected command over time inside their 95 % intervals.

    Parameters
    ----------
    measured : Measured
        Errors of n samples of `log`.
    log : CalibrationLog
        The held-out recording.
    trajectory : int
    """
    time, rows = _samples(measured, log, trajectory)
    figure, axes = new_figure(9.0, 4.2, 3, 1, share_x=True)
    for i, ax in enumerate(axes):
        band, error = 1e3 * measured.interval95[rows, i], 1e3 * measured.corrected[rows, i]
        ax.fill_between(time, -band, band, color=COLOURS["corrected"], alpha=0.15, linewidth=0, label="95 % interval")
        ax.plot(time, error, color=COLOURS["corrected"], linewidth=1.3, label="corrected")
        ax.set_ylabel(f"{'xyz'[i]} error [mm]")
    _legend_above(axes[0], 2)
    axes[-1].set_xlabel("time [s]")
    return figure


def reliability(measured: Measured) -> Figure:
    """Observed coverage of central intervals of every level, a line a component; on the diagonal they are honest.

    The calibrated 95 % half width fixes the scale; other levels follow the normal shape.

    Parameters
    ----------
    measured : Measured
    """
    figure, (ax,) = new_figure(4.6, 4.2)
    ax.plot([0, 100], [0, 100], color=COLOURS["quiet"], linestyle="--", linewidth=1)
    levels = np.linspace(0.05, 0.99, 40)
    shades = ("#0072b2", "#56b4e9", "#009e73", "#d55e00", "#e69f00", "#cc79a7")
    for i, (name, colour) in enumerate(zip(COMPONENTS, shades, strict=True)):
        error, half = np.abs(measured.corrected[:, i]), measured.interval95[:, i]
        if not np.isfinite(error).any():
            continue
        observed = [np.mean(error <= half * norm.ppf(0.5 + level / 2) / Z95) for level in levels]
        ax.plot(100 * levels, 100 * np.array(observed), color=colour, linewidth=1.5, label=name)
    ax.axvline(95, color=COLOURS["quiet"], linewidth=0.6)
    ax.set(xlabel="nominal coverage [%]", ylabel="observed coverage [%]", aspect="equal")
    ax.set(xlim=(0, 100), ylim=(0, 100))
    ax.legend(frameon=False, fontsize=8)
    return figure


def residual_maps(measured: Measured, position: FloatArray) -> Figure:
    """Length of the position error over the workspace, after the rigid part and corrected, on one colour scale.

    Parameters
    ----------
    measured : Measured
        n measured samples.
    position : (n, 3) array
        Their observed positions, m.
    """
    shown = evenly_spaced(len(position), MOST_POINTS)
    before, after = (1e3 * np.linalg.norm(e[shown, :3], axis=1) for e in (measured.registered, measured.corrected))
    figure, axes = new_figure(9.0, 6.4, 2, 2)
    scale: dict[str, Any] = {
        "s": 5,
        "cmap": "viridis",
        "vmin": 0,
        "vmax": float(np.percentile(before, 98)) or 1.0,
        "linewidths": 0,
    }
    for row, (i, j) in enumerate(_views(position)):
        for column, (size, title) in enumerate(((before, "after rigid registration"), (after, "corrected"))):
            ax = axes[2 * row + column]
            points = ax.scatter(100 * position[shown, i], 100 * position[shown, j], c=size, **scale)
            _label_view(ax, i, j)
            ax.set_title(title if row == 0 else "")
    figure.colorbar(points, ax=axes, label="position error [mm]", shrink=0.7)
    return figure


def workspace_coverage(train: FloatArray, test: FloatArray, in_domain: BoolArray) -> Figure:
    """Where the training was, and which held-out samples lie near it.

    Parameters
    ----------
    train, test : (n, 3) and (m, 3) arrays
        Observed positions, m.
    in_domain : (m,) mask
        Of the held-out ones.
    """
    figure, axes = new_figure(9.0, 3.4, 1, 2)
    groups = (
        (train[evenly_spaced(len(train), MOST_POINTS)], ".", "#c9ced6", 2, "training"),
        (test[in_domain], ".", COLOURS["corrected"], 2, "held out, in domain"),
        (test[~in_domain], "x", COLOURS["raw"], 4, "held out, outside"),
    )
    for ax, (i, j) in zip(axes, _views(train), strict=True):
        for points, marker, colour, size, label in groups:
            ax.plot(100 * points[:, i], 100 * points[:, j], marker, color=colour, markersize=size, label=label)
        _label_view(ax, i, j)
    _legend_above(axes[0], 3, markerscale=3)
    return figure


def _errors(measured: Measured) -> list[tuple[str, dict[str, FloatArray]]]:
    """Name and size (n,), by method, of the position error (mm) and, where measured, of the rotation error (deg)."""
    parts = [("position error [mm]", slice(0, 3), 1e3), ("rotation error [deg]", slice(3, 6), 180 / np.pi)]
    parts = parts if np.isfinite(measured.corrected[:, 3:]).any() else parts[:1]
    return [
        (label, {method: scale * np.linalg.norm(measured.of(method)[:, columns], axis=1) for method in METHODS})
        for label, columns, scale in parts
    ]


def _paths(
    measured: Measured, log: CalibrationLog, trajectory: int
) -> tuple[FloatArray, dict[str, tuple[FloatArray, dict[str, Any]]]]:
    """Return times (s) of a trajectory; by label, positions (mm) of each method and the command, and their style."""
    assert log.setpoint_cp is not None
    time, rows = _samples(measured, log, trajectory)
    command = 1e3 * log.setpoint_cp.position[measured.rows[rows]]
    paths: dict[str, tuple[FloatArray, dict[str, Any]]] = {
        LABELS[m]: (command - 1e3 * measured.of(m)[rows, :3], {"color": COLOURS[m], "linewidth": 1.4}) for m in METHODS
    }
    paths["what was commanded"] = command, {"color": COLOURS["ink"], "linewidth": 1.2, "linestyle": "--"}
    return time, paths


def _samples(measured: Measured, log: CalibrationLog, trajectory: int) -> tuple[FloatArray, IntArray]:
    """Return times (s, from 0) and rows of `measured` of one trajectory."""
    rows = np.flatnonzero(log.trajectory[measured.rows] == trajectory)
    time = log.time[measured.rows[rows]]
    return time - time[0], rows


def _legend_above(ax: Axes, columns: int, fontsize: int = 8, markerscale: float = 1.0) -> None:
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "markerscale": markerscale}
    ax.legend(frameon=False, fontsize=fontsize, ncols=columns, **place)


def _views(position: FloatArray) -> list[tuple[int, int]]:
    """Planes to draw: the widest axis against each of the others, the wider one first."""
    widest, second, third = (int(i) for i in np.argsort(-np.ptp(position, axis=0)))
    return [(widest, second), (widest, third)]


def _label_view(ax: Axes, i: int, j: int) -> None:
    ax.set(xlabel=f"{'xyz'[i]} [cm]", ylabel=f"{'xyz'[j]} [cm]", aspect="equal", adjustable="datalim")
