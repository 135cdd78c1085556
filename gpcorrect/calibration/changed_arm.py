"""A log none of whose samples pass the training's cleaning: of an arm that changed, or of another frame or robot.

The first is measured and learned from by thresholds of its own; the second is refused. They are told apart by what
rejects the samples. A changed load or slack moves errors away from the training's smooth model of them, and a large one
from the registration too; another frame puts the tool outside the workspace, or turns it further than an arm can err.
"""

from __future__ import annotations

from collections.abc import Sequence

from gpcorrect.calibration.task import Corrector
from gpcorrect.cleaning import CleaningReport
from gpcorrect.cleaning.report import Reason
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog

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
