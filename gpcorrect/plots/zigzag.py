"""A calibration trajectory seen from its joints: over time, and each pair against each other."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray

__all__ = ["joint_trajectory"]

UNITS = ((np.rad2deg(1.0), "deg"), (np.rad2deg(1.0), "deg"), (1e3, "mm"))


def joint_trajectory(time: FloatArray, q: FloatArray, title: str) -> Figure:
    """Draw a path of three joints `(n, 3)`, rad, rad and m, over `time` in seconds."""
    figure, axes = new_figure(9.0, 6.0, 2, 3)
    for j, (scale, unit) in enumerate(UNITS):
        axes[j].plot(time, q[:, j] * scale, color=COLOURS["corrected"], linewidth=0.9)
        axes[j].set_xlabel("time [s]", fontsize=8)
        axes[j].set_ylabel(f"joint {j + 1} [{unit}]", fontsize=8)
        other = (j + 1) % 3
        ax = axes[3 + j]
        ax.plot(q[:, j] * scale, q[:, other] * UNITS[other][0], color=COLOURS["ink"], linewidth=0.7)
        ax.set_xlabel(f"joint {j + 1} [{unit}]", fontsize=8)
        ax.set_ylabel(f"joint {other + 1} [{UNITS[other][1]}]", fontsize=8)
    figure.suptitle(title, fontsize=10)
    return figure
