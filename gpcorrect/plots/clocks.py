"""How well tracker and command agree over time offsets."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.logs import TimeOffset
from gpcorrect.plots.style import COLOURS, new_figure

__all__ = ["offset_curve"]


def offset_curve(offset: TimeOffset) -> Figure:
    """Correlation of the speeds against the time offset, with the estimate and its 95 % interval."""
    figure, (ax,) = new_figure(5.6, 3.0)
    ax.plot(offset.lags, offset.correlation, color=COLOURS["ink"], linewidth=1.3)
    if offset.observable and np.isfinite(offset.ci95).all():
        ax.axvspan(*offset.ci95, color=COLOURS["corrected"], alpha=0.25, linewidth=0)
        ax.axvline(offset.offset, color=COLOURS["corrected"], linewidth=1.4)
    ax.set(xlabel="time offset of the tracker [s]", ylabel="correlation of speeds")
    return figure
