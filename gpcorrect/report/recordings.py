"""What was done to a recording before anything was learned: registration, clocks, rejected samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.calibration import FitResult
from gpcorrect.calibration.dataset import evenly_spread
from gpcorrect.cleaning import CleaningReport, Reason
from gpcorrect.logs.sync import Clocks
from gpcorrect.report.charts import Chart, Mark, Panel, Role, Series, runs
from gpcorrect.report.page import Section, TableData
from gpcorrect.types import CalibrationLog

MOST_POINTS = 2500  # of a path that stands above the rejected samples; chosen by hand


def registration_sections(fit: FitResult) -> list[Section]:
    """Return how the rigid model was chosen; nothing for a task without one.

    Parameters
    ----------
    fit : FitResult
    """
    chosen = fit.registration
    if chosen is None:
        return []
    rows = []
    for c in chosen.candidates:
        note = c.refused or ("chosen" if c.kind == chosen.model.kind else "")
        rows.append([c.kind, f"{c.position_mm:.3f}", f"{c.rotation_deg:.3f}", note])
    note = "Median errors on left-out training trajectories."
    table = TableData(["model", "position [mm]", "rotation [deg]", ""], rows, note, text=(3,))
    words = [f"{chosen.reason[:1].upper()}{chosen.reason[1:].rstrip('.')}."]
    return [Section("Registration of the frames", words, (table,) if rows else ())]


def clocks_section(clocks: Clocks) -> Section:
    """Return what was found of the outside sensor's clock.

    Parameters
    ----------
    clocks : Clocks
    """
    offset, words = clocks.offset, [f"{clocks.remark[:1].upper()}{clocks.remark[1:].rstrip('.')}."]
    if offset is None or offset.lags.size == 0:
        return Section("Clocks", words)
    series = [Series("correlation", Mark.LINE, Role.INK, offset.lags, offset.correlation)]
    spans = []
    if offset.observable and np.isfinite(offset.ci95).all():
        spans = [(float(offset.ci95[0]), float(offset.ci95[1]), f"estimate {offset.offset:.4f} s, 95 % interval")]
    panel = Panel("time offset of the outside sensor [s]", "correlation of speeds", series, spans=spans, height=240)
    caption = "Agreement of the speeds of outside sensor and command over time offsets; shaded: the estimate."
    return Section("Clocks", words, (), (Chart(caption, [panel]),))


def dropped_section(title: str, log: CalibrationLog, report: CleaningReport) -> Section:
    """Return which samples of a recording were rejected, over the recording, a row a reason.

    Parameters
    ----------
    title : str
    log : CalibrationLog
    report : CleaningReport
    """
    reasons: Sequence[str] = [reason for reason, count in report.counts.items() if count]
    words = [f"{int(report.keep.sum())} of {len(log)} samples passed cleaning."]
    if not reasons:
        return Section(title, words)
    table = TableData(
        ["reason", "samples", "what it means"],
        [[reason, str(report.counts[reason]), Reason(reason).sentence] for reason in reasons],
        text=(2,),
    )
    marks = Panel("sample", "", [_rejected(report, reasons)], rows=reasons, x_range=(0, len(log)))
    caption = "Rejected samples by reason, in the order of the recording."
    return Section(title, words, (table,), (Chart(caption, [*_path(log), marks], shared=True),))


def _rejected(report: CleaningReport, reasons: Sequence[str]) -> Series:
    label = np.asarray(report.reason)
    found = [run for run in runs(label) if label[run[0]]]
    text = [f"samples {run[0]} to {run[-1]}: {label[run[0]]}" for run in found]
    row = [reasons.index(str(label[run[0]])) for run in found]
    first, last = [run[0] for run in found], [run[-1] + 1 for run in found]
    return Series("rejected", Mark.BARS, Role.DROPPED, first, row, x2=last, text=text)


def _path(log: CalibrationLog) -> list[Panel]:
    """Return the outside sensor's positions over the samples; nothing for recordings without any."""
    if log.tracker_cp is None:
        return []
    shown = evenly_spread(len(log), MOST_POINTS)
    series = [
        Series(axis, Mark.LINE, role, shown, 100 * log.tracker_cp.position[shown, i])
        for i, (axis, role) in enumerate(zip("xyz", (Role.CORRECTED, Role.GOOD, Role.RIGID), strict=True))
    ]
    return [Panel("sample", "observed [cm]", series, x_range=(0, len(log)))]
