"""The page of `gpcorrect drift`: scores of trajectory after trajectory, and the evidence that they grew."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gpcorrect.calibration import Ageing, Detection
from gpcorrect.report.charts import Chart, Mark, Panel, Role, Series
from gpcorrect.report.page import Page, Section, write_page
from gpcorrect.types import FloatArray

BAND = (2.5, 97.5)  # percentiles of the training's scores that are shaded: 95 % of them


def write_drift_report(
    baseline: FloatArray, found: Detection, ageing: Ageing, names: Sequence[str], words: Sequence[str], path: Path
) -> None:
    """Write the self-contained page.

    Parameters
    ----------
    baseline : (m,) array
        Scores of left-out training trajectories.
    found : Detection
        Scores and evidence of n trajectories, oldest first.
    ageing : Ageing
        With the score at which a model is worn out.
    names : sequence of str
        Of each trajectory's recording.
    words : sequence of str
        What was found, the verdict first.
    path : Path
    """
    number = np.arange(1, len(found.scores) + 1)
    ends = np.array([0.5, len(number) + 0.5])
    low, high = (np.full(2, np.percentile(baseline, end)) for end in BAND)
    spans = [] if found.alarm is None else [(found.alarm + 0.5, len(number) + 0.5, "after the alarm")]
    scores = [
        Series("95 % of left-out training", Mark.BAND, Role.QUIET, ends, low, y2=high),
        Series("worn out", Mark.DASH, Role.RAW, ends, np.full(2, ageing.limit)),
        Series("trajectories", Mark.DOTS, Role.CORRECTED, number, found.scores, size=8.0, text=names),
    ]
    evidence = [
        Series("alarm", Mark.DASH, Role.RAW, ends, np.full(2, found.threshold)),
        Series("evidence", Mark.LINE, Role.CORRECTED, number, found.evidence),
    ]
    order, whole = "trajectory, in order of recording", (0.0, len(number) + 1.0)
    panels = [
        Panel(order, "error over its standard deviation", scores, spans=spans, x_range=whole, height=240),
        Panel(order, "evidence of drift", evidence, spans=spans, x_range=whole, log_y=True, height=200),
    ]
    chart = Chart("Scores, about 1 while the model holds, and the evidence that they grew.", panels, shared=True)
    write_page(Page("gpcorrect drift", words[0], (), [Section("Over time", words[1:], (), (chart,))]), path)
