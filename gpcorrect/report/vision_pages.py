"""Quality pages of `gpcorrect vision`: of a calibration, and of a tracked recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gpcorrect.report.page import (
    Chart,
    Mark,
    Page,
    Panel,
    Role,
    Section,
    Series,
    TableData,
    runs,
    stretches,
    write_page,
)
from gpcorrect.types import IntArray

if TYPE_CHECKING:  # OpenCV is an extra of its own: reports of other things must not ask for it
    from gpcorrect.vision import CalibrationReport, Camera, Target, Track, TrackResult
    from gpcorrect.vision.calibrate import CameraReport

MOST_FRAMES = 6000  # drawn on a page, so that it stays near a megabyte; chosen by hand
COASTING, LOST = 1, 2  # of a track's status
STATE_ROLES = (Role.CORRECTED, Role.QUIET, Role.RIGID, Role.DROPPED, Role.RAW, Role.SKY, Role.GOOD, Role.INK)


def write_calibration_page(report: CalibrationReport, path: Path, sources: Sequence[tuple[str, str]] = ()) -> None:
    """Write the page of a calibration; raises as :func:`write_page`.

    Parameters
    ----------
    report : CalibrationReport, the calibration
    path : Path, HTML file to write
    sources : sequence of (str, str), files that it was made from, and their digests
    """
    figures = report.to_dict()["cameras"]
    rows = [
        [
            row["name"],
            f"{row['boards_used']} of {row['boards_given']}",
            _number(row["corner_rms_px"], 3),
            str(row["markers"]),
            ", ".join(row["marker_outliers"]) or "none",
            _number(row["marker_rms_px"], 3),
            f"{row['focal_px']:.1f}",
            " ".join(f"{1e3 * v:.1f}" for v in row["position_m"]),
            _number(row["position_std_mm"], 2),
            _number(row["moved_from_rough_mm"], 1),
        ]
        for row in figures
    ]
    head = ["camera", "boards", "corners [px]", "markers", "left out", "markers [px]", "focal [px]"]
    head += ["position [mm]", "± [mm]", "from rough [mm]"]
    note = "± is one standard deviation, the length of three axes, with what the optics leave open."
    placed = [camera for camera in report.cameras if camera.marker_residuals]
    sections = [Section("Cameras", (), (TableData(head, rows, note, text=(4,)),))]
    if placed:
        sections.append(Section("What is left", (), (), (_marker_chart(placed),)))
    stds = [row["position_std_mm"] for row in figures if row["position_std_mm"] is not None]
    verdict = (
        f"{len(figures)} cameras placed to ± {max(stds):.2f} mm or better."
        if len(stds) == len(figures)
        else f"{len(figures) - len(stds)} of {len(figures)} cameras are placed roughly, by their board alone."
    )
    board = report.board
    facts = [("chessboard", f"{board.columns} x {board.rows} inner corners, {1e3 * board.square:g} mm squares")]
    write_page(Page("gpcorrect vision calibrate", verdict, facts, sections, sources), path)


def write_tracking_page(
    result: TrackResult, cameras: Sequence[Camera], target: Target, path: Path, sources: Sequence[tuple[str, str]] = ()
) -> None:
    """Write the page of a tracked recording; raises as :func:`write_page`.

    Parameters
    ----------
    result : TrackResult, the track and its log
    cameras : sequence of Camera, in the order of the recordings
    target : Target, what was tracked
    path : Path, HTML file to write
    sources : sequence of (str, str), files that it was made from, and their digests
    """
    figures, fractions = result.to_dict(), result.track.fractions()
    facts = [
        ("recordings", result.log.name),
        ("frames", f"{figures['frames']}, {float(np.ptp(result.track.time)):.1f} s"),
        ("speed", f"{result.frames_a_second:.1f} frames a second, reading included"),
        ("balls", ", ".join(target.names)),
    ]
    verdict = (
        f"{100 * fractions['measured']:.1f} % of the frames measured, {100 * fractions['coasting']:.1f} % bridged, "
        f"{100 * fractions['lost']:.1f} % lost; reprojection {_number(figures['reprojection_px'], 2)} px."
    )
    sections = [
        Section("What was noticed", result.remarks or ("Nothing.",)),
        Section("Position and its uncertainty", (), (), (*_path_charts(result.track), _quality_chart(result.track))),
        _trust(result, cameras, target),
    ]
    write_page(Page("gpcorrect vision track", verdict, facts, sections, sources), path)


def _trust(result: TrackResult, cameras: Sequence[Camera], target: Target) -> Section:
    from gpcorrect.vision import REASONS

    views = result.track.views
    rows = [
        [
            camera.name,
            *(f"{100 * float((views[:, c, b] == 0).mean()):.1f} %" for b in range(len(target.names))),
            REASONS[int(np.bincount(codes).argmax())] if (codes := views[:, c][views[:, c] > 0]).size else "-",
        ]
        for c, camera in enumerate(cameras)
    ]
    table = TableData(
        ["camera", *target.names, "when not, mostly"],
        rows,
        "Fraction of the frames in which a camera was trusted with a ball.",
        text=(len(target.names) + 1,),
    )
    names = [camera.name for camera in cameras]
    chart = _views_chart(result.track, names, target.names, REASONS)
    return Section("Which camera saw what", (), (table,), (chart,))


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _marker_chart(cameras: Sequence[CameraReport]) -> Chart:
    """Return where each camera sees the markers, less where they should be (px); crosses were left out."""
    panels = []
    near = [r for c in cameras for n, r in c.marker_residuals.items() if n not in c.outliers]
    reach = 1.2 * float(np.abs(near).max()) if near else 1.0
    for report in cameras:
        names = list(report.marker_residuals)
        left = np.clip(list(report.marker_residuals.values()), -reach, reach)
        used = np.array([name not in report.outliers for name in names])
        series = []
        groups = (("used", Mark.DOTS, Role.CORRECTED, used), ("left out", Mark.CROSSES, Role.RAW, ~used))
        for label, mark, role, rows in groups:
            if rows.any():
                text = [name for name, here in zip(names, rows, strict=True) if here]
                series.append(Series(label, mark, role, left[rows, 0], left[rows, 1], text=text))
        whole: dict[str, Any] = {"x_range": (-reach, reach), "y_range": (-reach, reach), "equal": True, "height": 260}
        panels.append(Panel("u [px]", "v [px]", series, title=report.camera.name, **whole))
    caption = "Where each marker is seen, less where it should be. Crosses contradict the others and were left out."
    return Chart(caption, panels, columns=2)


def _path_charts(track: Track) -> tuple[Chart, Chart]:
    """Return the tracked path in space, and over time with three standard deviations; gaps where the tool was lost."""
    rows = _frames(len(track.time))
    position = np.where((track.status == LOST)[:, None], np.nan, 1e3 * track.T_tracker_tool[:, :3, 3])
    time, path = track.time[rows] - track.time[0], [position[rows, i] for i in range(3)]
    coasting = track.status[rows] == COASTING
    lost = stretches(track.time - track.time[0], np.where(track.status == LOST, "lost", ""))
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
    in_space = Panel("x [mm]", "y [mm]", space, "z [mm]", equal=True)
    return (
        Chart("The path in space. Drag to turn; dots mark the start.", [in_space], space=True),
        Chart(f"Position with three standard deviations. {caption}{thin} Drag to zoom.", panels, shared=True),
    )


def _quality_chart(track: Track) -> Chart:
    """Return the uncertainty of the position, and the reprojection error, frame by frame."""
    rows = _frames(len(track.time))
    time = track.time[rows] - track.time[0]
    spread = 1e3 * np.sqrt((track.std[rows, :3] ** 2).sum(axis=1))
    position = Series("position", Mark.LINE, Role.CORRECTED, time, spread)
    pixels = Series("pixels", Mark.LINE, Role.INK, time, track.reprojection_px[rows])
    panels = [
        Panel("time [s]", "position std [mm]", [position], log_y=True),
        Panel("time [s]", "reprojection [px]", [pixels]),
    ]
    return Chart("Standard deviation of the position, and how well the sightings agree.", panels, shared=True)


def _views_chart(track: Track, cameras: Sequence[str], balls: Sequence[str], reasons: Sequence[str]) -> Chart:
    """Return which camera was trusted with which ball, frame by frame, and why not; `reasons[0]` is effective."""
    names = [f"{camera} {ball}" for camera in cameras for ball in balls]
    states = track.views.reshape(len(track.views), -1)
    time = track.time - track.time[0]
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    found: dict[int, list[tuple[float, float, int]]] = {}
    for row in range(states.shape[1]):
        for run in runs(states[:, row]):
            found.setdefault(int(states[run[0], row]), []).append((time[run[0]], time[run[-1]] + step, row))
    series = []
    for code, bars in sorted(found.items()):
        first, last, row = np.array(bars).T
        word = "effective" if code == 0 else reasons[code]
        series.append(Series(word, Mark.BARS, STATE_ROLES[code % len(STATE_ROLES)], first, row, x2=last, size=0.9))
    panel = Panel("time [s]", "", series, rows=names, x_range=(0.0, float(time[-1]) + step), legend=True)
    return Chart("Trust, frame by frame.", [panel])


def _frames(count: int) -> IntArray:
    return np.arange(0, count, -(-count // MOST_FRAMES))
