"""Where simulation and recording differ: the mean residual over two joints, without and with the named effects."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.words import in_reader_units
from gpcorrect.plots.style import new_figure
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["residual_over_joints"]

CELLS = 12  # along each axis
FEWEST = 3  # rows in a cell that is drawn


def residual_over_joints(evidence: Evidence, index: int, unit: str, joints: tuple[int, ...], types: str) -> Figure:
    """Draw the mean residual of channel `index` over its own joint and the one that spreads it most, before and after.

    Parameters
    ----------
    evidence : Evidence
        Condensed rows; all parts are drawn.
    index : int
        Of the channel.
    unit : str
        Its unit.
    joints : tuple of int
        Numbers of the joint columns.
    types : str
        "R" or "P" for each of them.
    """
    figure, axes = new_figure(9.0, 3.4, 1, 2)
    first, second = _pair(evidence, index)
    scale, symbol = in_reader_units(1.0, unit)
    maps = [
        scale * _mean_map(evidence, values[:, index], (first, second)) for values in (evidence.before, evidence.after)
    ]
    largest = float(np.nanmax(np.abs(maps[0]))) if np.isfinite(maps[0]).any() else 1.0
    for ax, image, title in zip(axes, maps, ("before", "with the named effects"), strict=True):
        drawn = _draw(ax, evidence, image, (first, second), types, largest)
        ax.set_title(title, fontsize=9, loc="left")
        ax.set_xlabel(_axis(joints[first], types[first]), fontsize=8)
        ax.set_ylabel(_axis(joints[second], types[second]) if second != first else "", fontsize=8)
    figure.colorbar(drawn, ax=axes, label=f"mean residual [{symbol}]", shrink=0.85)
    return figure


def _axis(joint: int, kind: str) -> str:
    return f"joint {joint} [{'mm' if kind == 'P' else '°'}]"


def _draw(
    ax: Axes, evidence: Evidence, image: FloatArray, pair: tuple[int, int], types: str, largest: float
) -> QuadMesh:
    edges = [in_reader_units(1.0, "m" if types[j] == "P" else "rad")[0] * _edges(evidence.motor[:, j]) for j in pair]
    ax.grid(visible=False)
    return ax.pcolormesh(edges[0], edges[1], image.T, cmap="RdBu_r", vmin=-largest, vmax=largest)


def _edges(values: FloatArray) -> FloatArray:
    """Even edges over the bulk of the values."""
    low, high = np.percentile(values, [1, 99])
    edges: FloatArray = np.linspace(low, max(high, low + 1e-9), CELLS + 1)
    return edges


def _cell(evidence: Evidence, column: int) -> tuple[np.ndarray, BoolArray]:
    values, edges = evidence.motor[:, column], _edges(evidence.motor[:, column])
    code = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, CELLS - 1)
    return code, (values >= edges[0]) & (values <= edges[-1])


def _mean_map(evidence: Evidence, values: FloatArray, pair: tuple[int, int]) -> FloatArray:
    """Means `(CELLS, CELLS)`; NaN where there are too few rows."""
    (a, inside_a), (b, inside_b) = _cell(evidence, pair[0]), _cell(evidence, pair[1])
    good = inside_a & inside_b & np.isfinite(values)
    code = (a * CELLS + b)[good]
    count = np.bincount(code, minlength=CELLS**2)
    total = np.bincount(code, values[good], minlength=CELLS**2)
    mean: FloatArray = np.where(count >= FEWEST, total / np.maximum(count, 1), np.nan).reshape(CELLS, CELLS)
    return mean


def _pair(evidence: Evidence, index: int) -> tuple[int, int]:
    """Columns of the two joints whose cells explain most of the residual; a channel's own joint is one of them."""
    n, own = evidence.motor.shape[1], evidence.joint[index]
    pairs = [p for p in combinations(range(n), 2) if own < 0 or own in p]
    if not pairs:
        return 0, 0
    best = max(pairs, key=lambda p: _between(_mean_map(evidence, evidence.before[:, index], p)))
    return best if own < 0 or best[0] == own else (best[1], best[0])


def _between(image: FloatArray) -> float:
    return float(np.nanvar(image)) if np.isfinite(image).sum() > 1 else 0.0
