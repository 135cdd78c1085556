"""Which samples to trust: the cleaning, told of the registration, and remembered for judging other logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from gpcorrect.cleaning import CleaningReport, CleaningSettings, FittedCleaner, clean_with, fit_cleaner
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.packing import pack, unpack
from gpcorrect.rigid import MarkerOption, RigidModel, fit_pose, fit_position, register
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

__all__ = ["Screen"]

# m^2: orientation errors of ten degrees weigh as much as positions that are 5 mm off, as cable-driven arms have both.
ROTATION_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Screen:
    """A fitted cleaner, and the registration through which it looks at the tracker.

    The registration comes first, robustly, because a marker away from the tool tip moves by decimetres against it; the
    least median of squares then works around what that registration says.

    Parameters
    ----------
    rigid : RigidModel
        Registration of the recording as it came, faults included.
    cleaner : FittedCleaner
        The training's ruler.
    """

    rigid: RigidModel
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
        observed, command = pose_pair(log)
        rows = observed.finite & command.finite
        rigid = register(observed[rows], command[rows], log.trajectory[rows], marker).model
        cleaner, report = fit_cleaner(
            _through(rigid, log, observed), _registered, settings, rng=np.random.default_rng(seed)
        )
        return cls(rigid, cleaner), report

    def judge(self, log: CalibrationLog) -> CleaningReport:
        """Judge the samples of another log by the training's ruler."""
        observed, _ = pose_pair(log)
        return clean_with(self.cleaner, _through(self.rigid, log, observed))

    def judge_afresh(self, log: CalibrationLog) -> CleaningReport:
        """Judge the samples of another log by its own ruler, through the training's registration.

        The training's ruler takes for faults what an arm does that has changed since; here only what does not fit the
        rest of the log is one.
        """
        observed, _ = pose_pair(log)
        seen, settings = _through(self.rigid, log, observed), self.cleaner.settings
        return fit_cleaner(seen, _registered, settings, rng=np.random.default_rng(0))[1]

    def to_parts(self) -> tuple[Any, dict[str, FloatArray]]:
        """Return the screen as JSON-able data and arrays."""
        return pack(self, "screen")

    @classmethod
    def from_parts(cls, data: Any, arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild a screen from :meth:`to_parts`."""
        screen = unpack(cls, data, arrays)
        # The cleaner knows its registration as a protocol only; the type is ours to name.
        rigid = unpack(RigidModel, data["cleaner"]["rigid"], arrays)
        return replace(screen, cleaner=replace(screen.cleaner, rigid=rigid))


def _through(rigid: RigidModel, log: CalibrationLog, observed: PoseSignal) -> CalibrationLog:
    return replace(log, tracker_cp=rigid.apply(observed))


def _registered(observed: PoseSignal, command: PoseSignal) -> RigidModel:
    """Registration as the cleaner asks for it, many times: the closed form."""
    if observed.quaternion is None:
        return fit_position(observed, command)
    return fit_pose(observed, command, rotation_weight=ROTATION_WEIGHT)
