"""A log unlike the training: of an arm that changed, of another frame or robot, or by another clock.

A changed arm shows where none of a log's samples pass the training's cleaning: it is measured and learned from by
thresholds of its own, and another frame or robot is refused. They are told apart by what rejects the samples. A changed
load or slack moves errors away from the training's smooth model of them, and a large one from the registration too;
another frame puts the tool outside the workspace, or turns it further than an arm can err. An outside sensor whose
stamps lie otherwise has a clock of its own where that explains errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.calibration.settings import LIMITS
from gpcorrect.cleaning import CleaningReport
from gpcorrect.cleaning.report import Reason
from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs.sync import NAMES, Clocks, align
from gpcorrect.types import CalibrationLog

if TYPE_CHECKING:
    from gpcorrect.calibration.task import Corrector

OTHER_FRAME = (Reason.WORKSPACE, Reason.ROTATION)
OTHER_OR_MOVED = (*OTHER_FRAME, Reason.OUTLIER)
"""Of what is learned from: a tracker moved by 5 cm errs as a heavy load does, and the registration would stay."""
MOST = 0.5  # of the samples that can be read: where they are rejected for more, the log is refused; chosen by hand
# What `evaluate` says of such a log.
CAUTION = (
    "CHANGED: no sample passes cleaning by the training's thresholds, for all err otherwise than there, as with "
    "another load or tool, slack that grew, or frames that moved a little: cleaned by thresholds of the recording's own"
)


def clean_changed(
    corrector: Corrector, log: CalibrationLog, report: CleaningReport, refused: Sequence[Reason], hint: str
) -> CleaningReport:
    """Return a log's cleaning by thresholds of its own, for one none of whose samples pass by the training's.

    Parameters
    ----------
    corrector : Corrector, of the training
    log : CalibrationLog, on one clock
    report : CleaningReport, of this log by the training's thresholds, which passes none
    refused : sequence of Reason, by which most samples of another frame are rejected
    hint : str, what can be done where the log is refused

    Raises
    ------
    LogError
        Most samples are rejected for what is refused.
    """
    counts = report.counts
    if sum(counts.get(code, 0) for code in refused) > MOST * (len(log) - counts.get(Reason.INVALID, 0)):
        reasons = ", ".join(f"{count} {code}" for code, count in counts.items())
        raise LogError(
            f"cleaning rejects all {len(log)} samples ({reasons}): by the training's thresholds they are not of the"
            " same robot and frames, or the training is too short to tell.",
            hint=hint,
            path=log.name,
        )
    return corrector.clean_afresh(log)


def beside_training(corrector: Corrector, log: CalibrationLog, clocks: Clocks) -> Clocks:
    """Return what is said of a log's clock, where the training's lag is known: a lag that it had too is no news.

    Another load, pace or slack moves what is found by some milliseconds too; a clock is spoken of only where its shift
    takes away errors.

    Parameters
    ----------
    corrector : Corrector, of the training
    log : CalibrationLog, as it was stamped
    clocks : Clocks, what was found of it
    """
    lag, found = corrector.summary.get("fit", {}).get("tracker_lag", {}), clocks.offset
    if found is None or not found.observable or found.drift is not None or found.reference not in lag:
        return clocks
    later = found.offset - lag[found.reference]
    unlike = abs(later) > max(LIMITS.other_clock, found.ci95[1] - found.ci95[0])
    if not unlike or not _explains(corrector, log, found.observed, later):
        return replace(clocks, to_note=False)
    size = f"{1e3 * abs(later):.0f} ms {'later' if later > 0 else 'earlier'} than in the training"
    remark = (
        f"the stamps of {NAMES.get(found.observed, found.observed)} are {size}: left as they are, and errors hold "
        f"that time. If a clock or a camera's delay differs: --time-offset {later:.3g}"
    )
    return replace(clocks, remark=remark, to_note=True)


def _explains(corrector: Corrector, log: CalibrationLog, signal: str, later: float) -> bool:
    """Whether a shift takes away a good part of the median error of any part that is corrected."""
    everything = np.ones(len(log), dtype=bool)
    try:
        asis, moved = (corrector.measure(x, everything) for x in (log, align(log, later, signals=(signal,))))
    except GpCorrectError:  # evaluation says why it cannot be measured; the clock may be
        return True
    medians = [
        [np.nanmedian(part.sizes(measured.corrected)) for part in corrector.measured_parts(asis)]
        for measured in (asis, moved)
    ]
    return bool(np.any(np.array(medians[1]) <= (1.0 - LIMITS.clock_explains) * np.array(medians[0])))
