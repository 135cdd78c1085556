"""Quality pages of `gpcorrect vision`: of a calibration, and of a tracked recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.report.page import Page, Section, TableData, write_page
from gpcorrect.report.vision_charts import marker_chart, path_charts, quality_chart, views_chart

if TYPE_CHECKING:  # OpenCV is an extra of its own: reports of other things must not ask for it
    from gpcorrect.vision import CalibrationReport, Camera, Target, TrackResult


def write_calibration_page(report: CalibrationReport, path: Path, sources: Sequence[tuple[str, str]] = ()) -> None:
    """Write the page of a calibration.

    Parameters
    ----------
    report : CalibrationReport
        The calibration.
    path : Path
        HTML file to write.
    sources : sequence of (str, str)
        Files that it was made from, and their digests.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
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
    note = "± is one standard deviation, the length of three axes, with what the lens leaves open."
    placed = [camera for camera in report.cameras if camera.marker_residuals]
    sections = [Section("Cameras", (), (TableData(head, rows, note, text=(4,)),))]
    if placed:
        sections.append(Section("What is left", (), (), (marker_chart(placed),)))
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
    """Write the page of a tracked recording.

    Parameters
    ----------
    result : TrackResult
        The track and its log.
    cameras : sequence of Camera
        In the order of the recordings.
    target : Target
        What was tracked.
    path : Path
        HTML file to write.
    sources : sequence of (str, str)
        Files that it was made from, and their digests.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
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
        _path(result),
        _trust(result, cameras, target),
    ]
    write_page(Page("gpcorrect vision track", verdict, facts, sections, sources), path)


def _path(result: TrackResult) -> Section:
    charts = (*path_charts(result.track), quality_chart(result.track))
    return Section("Position and its uncertainty", (), (), charts)


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
    chart = views_chart(result.track, names, target.names, REASONS)
    return Section("Which camera saw what", (), (table,), (chart,))


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
