"""What cleaning dropped, when, and why."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gpcorrect.cleaning import CleaningReport
from gpcorrect.plots.style import COLOURS, new_figure
from gpcorrect.types import CalibrationLog

__all__ = ["dropped_samples"]


def dropped_samples(log: CalibrationLog, report: CleaningReport) -> Figure:
    """Observed positions over the samples of a log, those dropped marked by the reason on a line of their own."""
    reasons = [reason for reason, count in report.counts.items() if count]
    figure, (path, marks) = new_figure(9.0, 2.6 + 0.25 * len(reasons), 2, 1, share_x=True)
    assert log.tracker_cp is not None
    sample = np.arange(len(log))
    for i, axis in enumerate("xyz"):
        path.plot(sample, 100 * log.tracker_cp.position[:, i], linewidth=0.6, label=axis)
    path.set_ylabel("observed [cm]")
    path.legend(frameon=False, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    for line, reason in enumerate(reasons):
        rows = sample[np.asarray(report.reason) == reason]
        marks.plot(rows, np.full(rows.size, line), "|", color=COLOURS["dropped"], markersize=8)
    marks.set_yticks(range(len(reasons)), [f"{r} ({report.counts[r]})" for r in reasons])
    marks.set(xlabel="sample", ylim=(-0.7, max(len(reasons), 1) - 0.3))
    return figure
