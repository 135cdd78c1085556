"""Recordings: joint paths, and a model's history over many of them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.calibration import Ageing, Detection
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray, IntArray


def joint_trajectory(time: FloatArray, q: FloatArray, title: str) -> Figure:
    """Draw a path of three joints over time, and each pair of them against each other.

    Parameters
    ----------
    time : (n,) array
        Seconds.
    q : (n, 3) array
        rad, rad and m.
    title : str
    """
    figure, axes = new_figure(9.0, 6.0, 2, 3)
    shown = (np.rad2deg(q[:, 0]), np.rad2deg(q[:, 1]), 1e3 * q[:, 2])
    names = ("joint 1 [deg]", "joint 2 [deg]", "joint 3 [mm]")
    for j, other in enumerate((1, 2, 0)):
        axes[j].plot(time, shown[j], color=COLOURS["corrected"], linewidth=0.9)
        axes[j].set_xlabel("time [s]", fontsize=8)
        axes[j].set_ylabel(names[j], fontsize=8)
        axes[3 + j].plot(shown[j], shown[other], color=COLOURS["ink"], linewidth=0.7)
        axes[3 + j].set_xlabel(names[j], fontsize=8)
        axes[3 + j].set_ylabel(names[other], fontsize=8)
    figure.suptitle(title, fontsize=10)
    return figure


def drift_history(baseline: FloatArray, found: Detection, ageing: Ageing, logs: IntArray, names: list[str]) -> Figure:
    """Scores of trajectory after trajectory above, and the evidence that they grew below.

    Parameters
    ----------
    baseline : (m,) array
        Scores of left-out training trajectories.
    found : Detection
        Scores and evidence of n trajectories, oldest first.
    ageing : Ageing
        With the score at which a model is worn out.
    logs : (n,) int array
        Recording of each trajectory.
    names : list of str
        Of the recordings.
    """
    figure, (above, below) = new_figure(7.0, 5.0, rows=2, share_x=True)
    number = np.arange(1, len(found.scores) + 1)
    low, high = np.percentile(baseline, [2.5, 97.5])
    above.axhspan(low, high, color=COLOURS["quiet"], alpha=0.2, linewidth=0, label="95 % of left-out training")
    above.axhline(ageing.limit, color=COLOURS["raw"], linestyle="--", linewidth=1, label="worn out")
    above.plot(number, found.scores, "o", markersize=4, color=COLOURS["corrected"], label="trajectories")
    above.set(ylabel="error over its standard deviation", ylim=(0, None))
    below.semilogy(number, found.evidence, "-o", markersize=3, color=COLOURS["corrected"])
    below.axhline(found.threshold, color=COLOURS["raw"], linestyle="--", linewidth=1)
    below.set(ylabel="evidence of drift", xlabel="trajectory, in order of recording")
    if found.alarm is not None:
        for ax in (above, below):
            ax.axvline(found.alarm + 1, color=COLOURS["raw"], linewidth=1, label="alarm")
    above.legend(frameon=False, fontsize=8, loc="upper left")
    for i, name in enumerate(names):
        rows = np.flatnonzero(logs == i)
        if rows.size:
            middle = (rows[0] + rows[-1]) / 2 + 1
            above.text(middle, 1.02, name, transform=above.get_xaxis_transform(), ha="center", fontsize=8)
            if rows[0]:
                above.axvline(rows[0] + 0.5, color=COLOURS["quiet"], linewidth=0.6)
    return figure
