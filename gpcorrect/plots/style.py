"""Style of every figure: plain axes, and colours that stay apart for colour-blind readers."""

from __future__ import annotations

import io

from gpcorrect.errors import MissingExtraError

try:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
except ImportError as error:
    raise MissingExtraError("matplotlib", extra="report", purpose="Drawing figures") from error

# Okabe and Ito's palette for colour-blind readers: before, after the rigid part, corrected.
COLOURS = {
    "raw": "#d55e00",
    "rigid": "#e69f00",
    "corrected": "#0072b2",
    "dropped": "#cc79a7",
    "quiet": "#8a8f98",
    "ink": "#22262b",
}
LABELS = {"raw": "before", "rigid": "after rigid registration", "corrected": "corrected"}
DPI = 110  # chosen by hand: sharp on a page of 1040 px


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1, *, share_x: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its axes, row by row, without any global state.

    Parameters
    ----------
    width, height : float
        Inches.
    rows, columns : int
        Of the grid of axes.
    share_x : bool
        Whether axes above each other have one x axis.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share_x).ravel().tolist()
    for ax in axes:
        tidy(ax)
    return figure, axes


def tidy(ax: Axes) -> None:
    """Remove what carries no data.

    Parameters
    ----------
    ax : matplotlib Axes
    """
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color(COLOURS["quiet"])
    ax.tick_params(colors=COLOURS["ink"], labelsize=8)
    ax.grid(visible=True, color="#e6e8eb", linewidth=0.6)
    ax.set_axisbelow(True)


def png(figure: Figure) -> bytes:
    """Return the figure as PNG.

    Parameters
    ----------
    figure : matplotlib Figure
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
