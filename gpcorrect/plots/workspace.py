"""Where in the workspace: residuals before and after, and what the training covered."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.experiment import Measured
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["residual_maps", "workspace_coverage"]

MOST_POINTS = 6000


def residual_maps(measured: Measured, position: FloatArray) -> Figure:
    """Length of the position error over the workspace, after the rigid part and corrected, on one colour scale.

    Parameters
    ----------
    measured : Measured
        n measured samples.
    position : (n, 3) array
        Their observed positions, m.
    """
    shown = _thinned(len(position))
    before, after = (1e3 * np.linalg.norm(e[shown, :3], axis=1) for e in (measured.rigid, measured.corrected))
    figure, axes = new_figure(9.0, 6.4, 2, 2)
    top = float(np.percentile(before, 98)) or 1.0
    for row, (i, j, x, y) in enumerate(_views(position)):
        for column, (size, title) in enumerate(((before, "after rigid registration"), (after, "corrected"))):
            ax = axes[2 * row + column]
            points = ax.scatter(
                100 * position[shown, i],
                100 * position[shown, j],
                c=size,
                s=5,
                cmap="viridis",
                vmin=0,
                vmax=top,
                linewidths=0,
            )
            ax.set(
                xlabel=f"{x} [cm]",
                ylabel=f"{y} [cm]",
                title=title if row == 0 else "",
                aspect="equal",
                adjustable="datalim",
            )
    figure.colorbar(points, ax=axes, label="position error [mm]", shrink=0.7)
    return figure


def workspace_coverage(train: FloatArray, test: FloatArray, in_domain: BoolArray) -> Figure:
    """Training positions `(n, 3)`, and held-out ones `(m, 3)` by whether they lie near them."""
    figure, axes = new_figure(9.0, 3.4, 1, 2)
    shown, near, far = _thinned(len(train)), test[in_domain], test[~in_domain]
    for ax, (i, j, x, y) in zip(axes, _views(train), strict=True):
        ax.plot(100 * train[shown, i], 100 * train[shown, j], ".", color="#c9ced6", markersize=2, label="training")
        ax.plot(
            100 * near[:, i],
            100 * near[:, j],
            ".",
            color=COLOURS["corrected"],
            markersize=2,
            label="held out, in domain",
        )
        ax.plot(
            100 * far[:, i],
            100 * far[:, j],
            "x",
            color=COLOURS["raw"],
            markersize=4,
            label="held out, outside",
        )
        ax.set(xlabel=f"{x} [cm]", ylabel=f"{y} [cm]", aspect="equal", adjustable="datalim")
    axes[0].legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1), markerscale=3)
    return figure


def _views(position: FloatArray) -> list[tuple[int, int, str, str]]:
    """Planes to look at: the widest axis against each of the others, the wider one first."""
    widest, second, third = (int(i) for i in np.argsort(-np.ptp(position, axis=0)))
    return [(widest, other, "xyz"[widest], "xyz"[other]) for other in (second, third)]


def _thinned(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(np.int64))
