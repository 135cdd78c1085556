"""Where the tool came to stand on repeated visits: a dot a visit, a column a place."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import FloatArray

__all__ = ["visits"]

SHADES = ("raw", "corrected", "rigid")


def visits(errors: Mapping[str, FloatArray]) -> Figure:
    """Lengths of the errors `(repetitions, places, 6)` of each kind of command, on a logarithmic scale."""
    figure, axes = new_figure(9.5, 3.4, 1, 2)
    quantities = ((slice(0, 3), 1e3, "position error [mm]"), (slice(3, 6), 180 / np.pi, "rotation error [deg]"))
    for ax, (columns, scale, label) in zip(axes, quantities, strict=True):
        for i, ((name, error), shade) in enumerate(zip(errors.items(), SHADES, strict=False)):
            size = scale * np.linalg.norm(error[..., columns], axis=-1)
            x = np.broadcast_to(1 + np.arange(size.shape[1]) + 0.22 * (i - 1), size.shape)
            ax.plot(x.ravel(), size.ravel(), ".", color=COLOURS[shade], markersize=5, alpha=0.75, label=name)
        ax.set(xlabel="place", ylabel=label, yscale="log", xticks=range(1, size.shape[1] + 1))
    axes[0].legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    return figure
