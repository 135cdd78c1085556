"""Which samples to trust: the fitted cleaning, and the registration that it started from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from gpcorrect.cleaning import CleaningReport, CleaningSettings, FittedCleaner, clean_with, fit_cleaner
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.packing import pack, unpack
from gpcorrect.rigid import MarkerOption
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["Screen"]


@dataclass(frozen=True, eq=False)
class Screen:
    """A fitted cleaner.

    Parameters
    ----------
    cleaner : FittedCleaner
        The training's thresholds.
    """

    cleaner: FittedCleaner

    @classmethod
    def fit(
        cls, log: CalibrationLog, marker: MarkerOption, settings: CleaningSettings, seed: int
    ) -> tuple[Self, CleaningReport]:
        """Learn from a log that holds faults what is normal, and find the faults.

        Raises
        ------
        LogError, DegenerateError
            Signals are missing, or the motion does not determine a registration.
        """
        pose_pair(log)
        cleaner, report = fit_cleaner(log, settings, rng=np.random.default_rng(seed), marker=marker)
        return cls(cleaner), report

    def judge(self, log: CalibrationLog) -> CleaningReport:
        """Label the samples of another log by the training's thresholds."""
        return clean_with(self.cleaner, log)

    def judge_afresh(self, log: CalibrationLog) -> CleaningReport:
        """Label the samples of another log by its own thresholds, through the training's registration.

        The training's thresholds take for faults what an arm does that has changed since; here only what does not fit
        the rest of the log is one.
        """
        cleaner = self.cleaner
        return fit_cleaner(log, cleaner.settings, rng=np.random.default_rng(0), rigid=cleaner.rigid)[1]

    def to_parts(self) -> tuple[Any, dict[str, FloatArray]]:
        """Return the screen as JSON-able data and arrays."""
        return pack(self, "screen")

    @classmethod
    def from_parts(cls, data: Any, arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild a screen from :meth:`to_parts`."""
        return unpack(cls, data, arrays)
