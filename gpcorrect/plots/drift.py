"""The history of a model: scores of trajectory after trajectory, and the evidence that they grew."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpcorrect.adaptation import Ageing, Detection
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray, IntArray

__all__ = ["drift_history"]


def drift_history(baseline: FloatArray, found: Detection, ageing: Ageing, logs: IntArray, names: list[str]) -> Figure:
    """Scores above, beside the band of 95 % of the training's; evidence against its threshold below."""
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
    _name_logs(above, logs, names)
    return figure


def _name_logs(ax: Axes, logs: IntArray, names: list[str]) -> None:
    """Write the name of each log above its trajectories, and part them."""
    for i, name in enumerate(names):
        rows = np.flatnonzero(logs == i)
        if rows.size:
            middle = (rows[0] + rows[-1]) / 2 + 1
            ax.text(middle, 1.02, name, transform=ax.get_xaxis_transform(), ha="center", fontsize=8)
            if rows[0]:
                ax.axvline(rows[0] + 0.5, color=COLOURS["quiet"], linewidth=0.6)
