"""Charts of the vision pages: what markers leave over, the tracked path and its quality, which camera saw what."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.report.charts import Chart, Mark, Panel, Role, Series
from gpcorrect.types import FloatArray, IntArray

if TYPE_CHECKING:  # OpenCV is an extra of its own: reports of other things must not ask for it
    from gpcorrect.vision import Track
    from gpcorrect.vision.calibrate import CameraReport

MOST_FRAMES = 6000
"""Drawn on a page, so that it stays near a megabyte; chosen by hand."""
COASTING, LOST = 1, 2
STATE_ROLES = (Role.CORRECTED, Role.QUIET, Role.RIGID, Role.DROPPED, Role.RAW, Role.SKY, Role.GOOD, Role.INK)


def marker_chart(cameras: Sequence[CameraReport]) -> Chart:
    """Return where each camera sees the markers, less where they should be (px); crosses were left out.

    Parameters
    ----------
    cameras : sequence of CameraReport
        Those with markers.
    """
    panels = []
    kept = [r for c in cameras for n, r in c.marker_residuals.items() if n not in c.outliers]
    reach = 1.2 * float(np.abs(kept).max()) if kept else 1.0
    for report in cameras:
        names = list(report.marker_residuals)
        left = np.clip(list(report.marker_residuals.values()), -reach, reach)
        used = np.array([name not in report.outliers for name in names])
        series = [
            Series(
                label, mark, role, left[rows, 0], left[rows, 1], text=[n for n, r in zip(names, rows, strict=True) if r]
            )
            for label, mark, role, rows in (
                ("used", Mark.DOTS, Role.CORRECTED, used),
                ("left out", Mark.CROSSES, Role.RAW, ~used),
            )
            if rows.any()
        ]
        panels.append(
            Panel(
                "u [px]",
                "v [px]",
                series,
                title=report.camera.name,
                equal=True,
                height=260,
                x_range=(-reach, reach),
                y_range=(-reach, reach),
            )
        )
    caption = "Where each marker is seen, less where it should be. Crosses contradict the others and were left out."
    return Chart(caption, panels, columns=2)


def path_charts(track: Track) -> tuple[Chart, Chart]:
    """Return the tracked path in space, and over time with three standard deviations; gaps where the tool was lost.

    Parameters
    ----------
    track : Track
        n frames.
    """
    rows = _frames(len(track.time))
    position = np.where((track.status == LOST)[:, None], np.nan, 1e3 * track.T_tracker_tool[:, :3, 3])
    time, path = track.time[rows] - track.time[0], [position[rows, i] for i in range(3)]
    coasting = track.status[rows] == COASTING
    lost = _spans(track.time, track.status == LOST, "lost")
    panels = []
    for i, axis in enumerate("xyz"):
        spread = 3e3 * track.std[rows, i]
        series = [
            Series("three standard deviations", Mark.BAND, Role.CORRECTED, time, path[i] - spread, y2=path[i] + spread),
            Series("measured", Mark.LINE, Role.CORRECTED, time, path[i]),
        ]
        if coasting.any():
            series.append(Series("coasting", Mark.DOTS, Role.RIGID, time[coasting], path[i][coasting]))
        panels.append(Panel("time [s]", f"{axis} [mm]", series, spans=lost))
    space = [Series("tracked", Mark.LINE, Role.CORRECTED, path[0], path[1], z=path[2], value=time)]
    if coasting.any():
        place = [np.where(coasting, coordinate, np.nan) for coordinate in path]
        space.append(Series("coasting", Mark.LINE, Role.RIGID, place[0], place[1], z=place[2], value=time))
    step = rows[1] - rows[0] if len(rows) > 1 else 1
    thin = f" Every {step}th frame is drawn." if step > 1 else ""
    caption = "Coasting poses are predicted from the frames before; lost ones are not in the log."
    return (
        Chart(
            "The path in space. Drag to turn; dots mark the start.",
            [Panel("x [mm]", "y [mm]", space, "z [mm]", equal=True)],
            space=True,
        ),
        Chart(f"Position with three standard deviations. {caption}{thin} Drag to zoom.", panels, shared=True),
    )


def quality_chart(track: Track) -> Chart:
    """Return the uncertainty of the position, and the reprojection error, frame by frame.

    Parameters
    ----------
    track : Track
        n frames.
    """
    rows = _frames(len(track.time))
    time = track.time[rows] - track.time[0]
    spread = 1e3 * np.sqrt((track.std[rows, :3] ** 2).sum(axis=1))
    panels = [
        Panel(
            "time [s]", "position std [mm]", [Series("position", Mark.LINE, Role.CORRECTED, time, spread)], log_y=True
        ),
        Panel(
            "time [s]", "reprojection [px]", [Series("pixels", Mark.LINE, Role.INK, time, track.reprojection_px[rows])]
        ),
    ]
    return Chart("Standard deviation of the position, and how well the sightings agree.", panels, shared=True)


def views_chart(track: Track, cameras: Sequence[str], balls: Sequence[str], reasons: Sequence[str]) -> Chart:
    """Return which camera was trusted with which ball, frame by frame, and why not.

    Parameters
    ----------
    track : Track
        n frames.
    cameras, balls, reasons : sequences of str
        Names; `reasons[0]` stands for effective.
    """
    names = [f"{camera} {ball}" for camera in cameras for ball in balls]
    states = track.views.reshape(len(track.views), -1)
    time = track.time - track.time[0]
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    found: dict[int, list[tuple[float, float, int]]] = {}
    for row in range(states.shape[1]):
        for run in np.split(np.arange(len(time)), np.flatnonzero(np.diff(states[:, row])) + 1):
            found.setdefault(int(states[run[0], row]), []).append((time[run[0]], time[run[-1]] + step, row))
    series = []
    for code, runs in sorted(found.items()):
        first, last, row = np.array(runs).T
        word = "effective" if code == 0 else reasons[code]
        series.append(Series(word, Mark.BARS, STATE_ROLES[code % len(STATE_ROLES)], first, row, x2=last, size=0.9))
    panel = Panel("time [s]", "", series, rows=names, x_range=(0.0, float(time[-1]) + step), legend=True)
    return Chart("Trust, frame by frame.", [panel])


def _frames(count: int) -> IntArray:
    return np.arange(0, count, -(-count // MOST_FRAMES))


def _spans(time: FloatArray, inside: np.ndarray, why: str) -> list[tuple[float, float, str]]:
    """Return from when to when a mask holds, s from the start."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int))).reshape(-1, 2)
    half = float(np.median(np.diff(time))) / 2 if len(time) > 1 else 0.5
    return [(float(time[a] - time[0] - half), float(time[b - 1] - time[0] + half), why) for a, b in edges]
