"""A fitted corrector and how it came about: in figures for the model file, in sentences for a person."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.cleaning import CleaningReport
from gpcorrect.corrector.clocks import Clocks
from gpcorrect.corrector.command import CommandCorrector
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.corrector.settings import FitSettings
from gpcorrect.corrector.training_pairs import TrainingPairs
from gpcorrect.rigid import Registration
from gpcorrect.types import CalibrationLog

__all__ = ["FitResult", "fit_remarks", "fit_summary"]


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted corrector and how it came about.

    Parameters
    ----------
    corrector : CommandCorrector
        What was fitted.
    log : CalibrationLog
        What it was fitted to: the training log, on one clock.
    clocks : Clocks
        What was found of the tracker's clock.
    cleaning : CleaningReport
        What was dropped from the training log, and why.
    registration : Registration
        Which rigid model was chosen, and why.
    n_train : int
        Samples that the regression learned from.
    summary : mapping
        The same in figures, JSON-able; also in the model file.
    remarks : tuple of str
        What a person should know, in sentences.
    """

    corrector: CommandCorrector
    log: CalibrationLog
    clocks: Clocks
    cleaning: CleaningReport
    registration: Registration
    n_train: int
    summary: Mapping[str, Any]
    remarks: tuple[str, ...]


def fit_summary(
    log: CalibrationLog,
    pairs: TrainingPairs,
    registration: Registration,
    clocks: Clocks,
    cleaning: CleaningReport,
    settings: FitSettings,
    seconds: float,
) -> dict[str, Any]:
    """Collect what the model file says of itself."""
    low, high = pairs.observed.position.min(axis=0), pairs.observed.position.max(axis=0)
    return {
        "robot": log.meta.robot,
        "arm": log.meta.arm,
        "frames": {"input": "tracker", "output": "base"},
        "units": {"position": "m", "rotation": "rad", "quaternion": "wxyz"},
        "features": list(settings.features),
        "orientation": pairs.observed.quaternion is not None,
        "training_region": {"position_min": low.tolist(), "position_max": high.tolist()},
        "data": {"source": log.name, "sha256": log.digest},
        "fit": {
            "n_train": len(pairs.observed),
            "n_trajectories": len(np.unique(pairs.trajectory)),
            "dropped": dict(cleaning.counts),
            "registration": registration.to_dict(),
            "tracker_shift": clocks.applied,
            "seed": settings.seed,
            "seconds": seconds,
        },
    }


def fit_remarks(log: CalibrationLog, clocks: Clocks, registration: Registration) -> tuple[str, ...]:
    """Say what a person should know of a fit."""
    said = [*log.remarks, f"registration: {registration.reason}"]
    if clocks.applied:
        said.append(clocks.remark)
    observed, _ = pose_pair(log)
    if observed.quaternion is None:
        said.append("the log holds positions only: orientations are turned into the base frame and left uncorrected")
    return tuple(said)
