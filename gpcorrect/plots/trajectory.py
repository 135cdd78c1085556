"""One held-out trajectory as Mahler 2014, Fig. 4 draws it: the command, and what each method would have commanded."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.experiment import METHODS, Measured
from gpcorrect.plots.style import COLOURS, LABELS, new_figure
from gpcorrect.types import CalibrationLog

__all__ = ["trajectory_errors", "trajectory_paths", "typical_trajectory"]

AXES = "xyz"


def typical_trajectory(measured: Measured, log: CalibrationLog) -> int:
    """Return the number of the held-out trajectory whose mean corrected error is the median one."""
    number = log.trajectory[measured.rows]
    ids = np.unique(number)
    size = np.linalg.norm(measured.corrected[:, :3], axis=1)
    means = np.array([size[number == i].mean() for i in ids])
    return int(ids[np.argsort(means)[len(ids) // 2]])


def trajectory_paths(measured: Measured, log: CalibrationLog, trajectory: int) -> Figure:
    """Commanded positions over time, and what each method commands for the observed poses."""
    rows, time = _rows_and_time(measured, log, trajectory)
    figure, axes = new_figure(9.0, 5.2, 3, 1, share_x=True)
    assert log.setpoint_cp is not None
    command = log.setpoint_cp.position[measured.rows[rows]]
    for i, ax in enumerate(axes):
        for method in METHODS:
            wrong = getattr(measured, method)[rows, i]
            ax.plot(
                time,
                1e3 * (command[:, i] - wrong),
                color=COLOURS[method],
                linewidth=1.4,
                label=LABELS[method],
            )
        ax.plot(
            time,
            1e3 * command[:, i],
            color=COLOURS["ink"],
            linewidth=1.2,
            linestyle="--",
            label="what was commanded",
        )
        ax.set_ylabel(f"{AXES[i]} [mm]")
    axes[0].legend(frameon=False, fontsize=8, ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
    axes[-1].set_xlabel("time [s]")
    return figure


def trajectory_errors(measured: Measured, log: CalibrationLog, trajectory: int) -> Figure:
    """Errors of the corrected command over time inside their 95 % intervals."""
    rows, time = _rows_and_time(measured, log, trajectory)
    figure, axes = new_figure(9.0, 4.2, 3, 1, share_x=True)
    for i, ax in enumerate(axes):
        band = 1e3 * measured.interval95[rows, i]
        ax.fill_between(time, -band, band, color=COLOURS["corrected"], alpha=0.15, linewidth=0, label="95 % interval")
        ax.plot(
            time,
            1e3 * measured.corrected[rows, i],
            color=COLOURS["corrected"],
            linewidth=1.3,
            label="corrected",
        )
        ax.set_ylabel(f"{AXES[i]} error [mm]")
    axes[0].legend(frameon=False, fontsize=8, ncols=2, loc="lower left", bbox_to_anchor=(0, 1))
    axes[-1].set_xlabel("time [s]")
    return figure


def _rows_and_time(measured: Measured, log: CalibrationLog, trajectory: int) -> tuple[np.ndarray, np.ndarray]:
    rows = np.flatnonzero(log.trajectory[measured.rows] == trajectory)
    time = log.time[measured.rows[rows]]
    return rows, time - time[0]
