"""An outside sensor whose stamps lie otherwise than in the training: a clock of its own, where that explains errors."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import GpCorrectError
from gpcorrect.logs.sync import NAMES, Clocks, align
from gpcorrect.types import CalibrationLog

if TYPE_CHECKING:
    from gpcorrect.calibration.task import Corrector


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
