"""Checks of how a log is cut into trajectories."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding, examples

__all__ = ["Trajectories"]

SHORT = 10  # samples; a five-point derivative then rests on one-sided ends


@dataclass(frozen=True)
class Trajectories:
    """There should be several trajectories, each in one piece and long enough to differentiate."""

    short: int = SHORT

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield what is wrong with the cutting."""
        log = evidence.log
        if log.static:
            return
        numbers, sizes = np.unique(log.trajectory, return_counts=True)
        if len(numbers) == 1:
            what = "there is only one trajectory: none can be held out to measure errors on."
            yield Finding("warning", "one_trajectory", "trajectory", what, "Cut the log, or join several.", 1)
        short = numbers[sizes < self.short]
        if short.size:
            what = f"{short.size} of {len(numbers)} trajectories have fewer than {self.short} samples."
            yield Finding("warning", "short_trajectory", "trajectory", what, "", int(short.size), examples(short))
        starts = log.trajectory[np.flatnonzero(np.diff(log.trajectory)) + 1]
        torn = np.array([n for n in numbers if (starts == n).sum() + (log.trajectory[0] == n) > 1])
        if torn.size:
            yield Finding(
                "warning",
                "torn_trajectory",
                "trajectory",
                f"{torn.size} trajectories are interrupted by another one.",
                "Give each motion its own number: a number that comes back is taken for the same motion.",
                int(torn.size),
                examples(torn),
            )
