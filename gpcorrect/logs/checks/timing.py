"""Check of the clocks: how far is what was observed behind the command."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding, Severity
from gpcorrect.logs.sync import TimeOffset

__all__ = ["ClockOffset"]

SAME_CLOCK = ("measured_cp", "measured_jp")  # stamped by the robot, as its commands are
MAX_SAMPLES = 1.0  # median steps; a larger offset moves a sample to its neighbour's place


@dataclass(frozen=True)
class ClockOffset:
    """Command and observation should be on one clock."""

    most: float = MAX_SAMPLES

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield the offset of every observed signal; a warning where an outside clock is off by a sample."""
        for offset in evidence.offsets:
            if offset.observable:
                yield self._found(evidence, offset)
            elif offset.verdict != "unrelated":
                what = f"its time offset is not observable: {offset.reason}"
                severity: Severity = "warning" if offset.verdict == "edge" else "info"
                yield Finding(severity, "time_offset_unknown", offset.observed, what)
            if offset.drift is not None:
                what = f"its clock runs {offset.drift.ppm:+.1f} ppm against that of {offset.reference}."
                yield Finding("warning", "clock_drift", offset.observed, what, "Align the log before learning.")

    def _found(self, evidence: Evidence, offset: TimeOffset) -> Finding:
        forward = evidence.steps[evidence.steps > 0]
        step = float(np.median(forward)) if forward.size else np.inf
        half = 500 * (offset.ci95[1] - offset.ci95[0])
        side = "behind" if offset.offset >= 0 else "ahead of"
        what = (
            f"it is {1e3 * abs(offset.offset):.1f} ms {side} {offset.reference} (95 %: +-{half:.2g} ms, "
            f"{abs(offset.offset) / step:.2g} samples)"
        )
        if offset.observed in SAME_CLOCK:
            return Finding("info", "servo_lag", offset.observed, f"{what}: the lag of the robot, on one clock.")
        severity: Severity = "warning" if abs(offset.offset) > self.most * step else "info"
        hint = "Align it if this is the clocks; a lag of the robot or backlash looks the same from motion alone."
        return Finding(severity, "time_offset", offset.observed, f"{what}.", hint)
