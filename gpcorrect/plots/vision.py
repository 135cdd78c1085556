"""How well cameras were calibrated, and how well they tracked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["marker_residuals", "tracked_path", "tracking_quality", "view_states"]


# Blank, effective, not found, moved too far, wrong size, against the others, coming back; blue is good.
VIEW_COLOURS = ("#ffffff", "#0072b2", "#c3c7cd", "#e69f00", "#cc79a7", "#d55e00", "#56b4e9")
AXES = ("x", "y", "z")


def marker_residuals(residuals: Mapping[str, FloatArray], used: Mapping[str, BoolArray]) -> Figure:
    """Draw where each camera sees the markers, less where they should be (px); crosses were left out.

    Parameters
    ----------
    residuals : mapping of camera to (n, 2) array
        px.
    used : mapping of camera to (n,) mask
        Markers that were not outliers.
    """
    figure, axes = new_figure(2.2 * max(len(residuals), 2), 2.6, columns=max(len(residuals), 1))
    within = [r[used[name]] for name, r in residuals.items()]
    reach = 1.2 * max((float(np.abs(r).max()) for r in within if r.size), default=1.0)
    for ax, (name, r) in zip(axes, residuals.items(), strict=False):
        good = used[name]
        ax.plot(r[good, 0], r[good, 1], "o", markersize=4, color=COLOURS["corrected"])
        shown = np.clip(r[~good], -reach, reach)
        ax.plot(shown[:, 0], shown[:, 1], "x", markersize=6, color=COLOURS["raw"])
        ax.axhline(0.0, color=COLOURS["quiet"], linewidth=0.6)
        ax.axvline(0.0, color=COLOURS["quiet"], linewidth=0.6)
        ax.set(title=name, xlabel="u [px]", xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal")
        ax.title.set_fontsize(9)
    axes[0].set_ylabel("v [px]")
    return figure


def tracked_path(time: FloatArray, position: FloatArray, std: FloatArray, status: IntArray) -> Figure:
    """Draw the position over time (mm, about its mean) with three standard deviations; coasting marked, lost left open.

    Parameters
    ----------
    time : (n,) array
        s.
    position : (n, 3) array
        m; NaN where lost.
    std : (n, 3) array or wider
        Its standard deviation, m.
    status : (n,) int array
        0 measured, 1 coasting, 2 lost.
    """
    figure, axes = new_figure(8.0, 4.6, rows=3, share_x=True)
    gaps = np.flatnonzero(np.diff(np.concatenate([[False], status == 2, [False]]).astype(int)))
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for i, ax in enumerate(axes):
        x = 1e3 * (position[:, i] - np.nanmean(position[:, i]))
        ax.plot(time, x, color=COLOURS["corrected"], linewidth=1.0, label="measured")
        ax.fill_between(
            time, x - 3e3 * std[:, i], x + 3e3 * std[:, i], color=COLOURS["corrected"], alpha=0.2, linewidth=0
        )
        coasting = status == 1
        ax.plot(time[coasting], x[coasting], ".", color=COLOURS["rigid"], markersize=5, label="coasting")
        for k, (first, last) in enumerate(gaps.reshape(-1, 2)):
            span = (time[first] - step / 2, time[last - 1] + step / 2)
            ax.axvspan(*span, color=COLOURS["raw"], alpha=0.2, linewidth=0, label="lost" if k == 0 else None)
        ax.set_ylabel(f"{AXES[i]} [mm]")
    axes[-1].set_xlabel("time [s]")
    axes[0].legend(frameon=False, fontsize=8, ncols=3, loc="upper left", bbox_to_anchor=(0.0, 1.3))
    return figure


def tracking_quality(time: FloatArray, std: FloatArray, reprojection_px: FloatArray) -> Figure:
    """Draw the uncertainty of the position (mm) above, the reprojection error (px) below, frame by frame.

    Parameters
    ----------
    time : (n,) array
        s.
    std : (n, 3) array or wider
        Standard deviation of the position, m.
    reprojection_px : (n,) array
        RMS, px.
    """
    figure, (above, below) = new_figure(8.0, 3.6, rows=2, share_x=True)
    spread = 1e3 * np.sqrt((std[:, :3] ** 2).sum(axis=1))
    above.semilogy(time, spread, color=COLOURS["corrected"], linewidth=1.0)
    above.set_ylabel("position std [mm]")
    below.plot(time, reprojection_px, ".", markersize=3, color=COLOURS["corrected"])
    below.set(ylabel="reprojection [px]", xlabel="time [s]", ylim=(0, None))
    return figure


def view_states(
    time: FloatArray, views: IntArray, cameras: Sequence[str], balls: Sequence[str], reasons: Sequence[str]
) -> Figure:
    """Draw which camera was trusted with which ball, frame by frame, and why not.

    Parameters
    ----------
    time : (n,) array
        s.
    views : (n, c, b) int array
        0: effective; otherwise an index into `reasons`.
    cameras, balls, reasons : sequences of str
        Names; `reasons[0]` stands for effective.
    """
    rows = [f"{camera}  {ball}" for camera in cameras for ball in balls]
    image = views.reshape(len(views), -1).T + 1
    figure, (ax,) = new_figure(8.0, 0.9 + 0.22 * len(rows))
    colours = ListedColormap(VIEW_COLOURS[: len(reasons) + 1])
    extent = (float(time[0]), float(time[-1]) if len(time) > 1 else float(time[0]) + 1.0, len(rows) - 0.5, -0.5)
    ax.imshow(image, aspect="auto", interpolation="nearest", cmap=colours, vmin=0, vmax=len(reasons), extent=extent)
    ax.grid(visible=False)
    ax.set_yticks(range(len(rows)), rows, fontsize=7)
    ax.set_xlabel("time [s]")
    words = ["effective", *reasons[1:]]
    handles = [Patch(color=VIEW_COLOURS[k + 1], label=word) for k, word in enumerate(words) if (views == k).any()]
    figure.legend(handles=handles, frameon=False, fontsize=8, ncols=len(handles), loc="outside upper left")
    return figure
