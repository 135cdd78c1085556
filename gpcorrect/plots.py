"""The chessboard that cameras are calibrated with, to be printed; the only place for matplotlib."""

from __future__ import annotations

from pathlib import Path

from gpcorrect.atomic import atomic_path
from gpcorrect.errors import DataError, MissingExtraError

try:
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle
except ImportError as error:
    raise MissingExtraError("matplotlib", extra="report", purpose="Drawing a board") from error

PAPERS = {"a4": (0.297, 0.210), "a3": (0.420, 0.297), "letter": (0.2794, 0.2159)}  # m, lying on the long side
INCH = 0.0254  # m
MARGIN = 0.008  # m: what printers leave white
SCALE = 0.100  # m, of the printed line of known length


def write_board(path: str | Path, columns: int, rows: int, square: float, paper: str = "a4") -> None:
    """Write a chessboard as a PDF of true size, with a line of known length to check what the printer made of it.

    Parameters
    ----------
    path : str or Path, ends in .pdf
    columns, rows : int, inner corners
    square : float, side of a square, m
    paper : str, one of `PAPERS`

    Raises
    ------
    DataError
        The board does not fit on the paper with a white border, or looks the same turned by half.
    """
    if Path(path).suffix != ".pdf" or paper not in PAPERS:
        raise DataError(f"a board is a .pdf on {', '.join(PAPERS)}; got {Path(path).name} on {paper}.")
    if (columns + rows) % 2 == 0:
        hint = "Take one even and one odd number, as 9 and 6."
        raise DataError(f"a board of {columns} x {rows} inner corners looks the same turned by half.", hint=hint)
    width, height = PAPERS[paper]
    wide, high = (columns + 1) * square, (rows + 1) * square
    if wide > width - 2 * (MARGIN + square / 2) or high > height - 2 * (MARGIN + square / 2):
        most = min((width - 2 * MARGIN) / (columns + 2), (height - 2 * MARGIN) / (rows + 2))
        raise DataError(
            f"a board of {1e3 * wide:.0f} x {1e3 * high:.0f} mm with a white border does not fit on {paper}.",
            hint=f"Take squares of up to {int(1e3 * most)} mm, or larger paper.",
        )
    figure = Figure(figsize=(width / INCH, height / INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    axes.axis("off")
    left, top = 0.5 * (width - wide), 0.5 * (height - high)
    for i in range(columns + 1):
        for j in range(rows + 1):
            if (i + j) % 2 == 0:
                axes.add_patch(Rectangle((left + i * square, top + j * square), square, square, color="k", lw=0))
    bottom = height - MARGIN
    axes.plot([left, left + SCALE], [bottom, bottom], color="k", lw=0.6)
    for end in (left, left + SCALE):
        axes.plot([end, end], [bottom - 0.002, bottom], color="k", lw=0.6)
    words = f"{columns} x {rows} inner corners, squares of {1e3 * square:g} mm. Print at 100 %: this line is 100 mm."
    axes.text(left + SCALE + 0.004, bottom, words, fontsize=7, va="bottom")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="pdf")
