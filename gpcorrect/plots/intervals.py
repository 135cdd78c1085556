"""Are the intervals honest? Nominal against observed coverage on held-out trajectories."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm

from gpcorrect.experiment import COMPONENTS, Measured
from gpcorrect.plots.style import COLOURS, new_figure

__all__ = ["reliability"]

LEVELS = np.linspace(0.05, 0.99, 40)
Z95 = float(norm.ppf(0.975))


def reliability(measured: Measured) -> Figure:
    """Observed coverage of central intervals of every level, a line a component; the diagonal is honest.

    The calibrated 95 % half width fixes the scale; other levels follow the normal shape.
    """
    figure, (ax,) = new_figure(4.6, 4.2)
    ax.plot([0, 100], [0, 100], color=COLOURS["quiet"], linestyle="--", linewidth=1)
    shades = ("#0072b2", "#56b4e9", "#009e73", "#d55e00", "#e69f00", "#cc79a7")
    for i, (name, colour) in enumerate(zip(COMPONENTS, shades, strict=True)):
        error, half = np.abs(measured.corrected[:, i]), measured.interval95[:, i]
        if not np.isfinite(error).any():
            continue
        observed = [np.mean(error <= half * norm.ppf(0.5 + level / 2) / Z95) for level in LEVELS]
        ax.plot(100 * LEVELS, 100 * np.array(observed), color=colour, linewidth=1.5, label=name)
    ax.axvline(95, color=COLOURS["quiet"], linewidth=0.6)
    ax.set(
        xlabel="nominal coverage [%]",
        ylabel="observed coverage [%]",
        xlim=(0, 100),
        ylim=(0, 100),
        aspect="equal",
    )
    ax.legend(frameon=False, fontsize=8)
    return figure
