"""Whether a correction can be learned from a log at all."""

from __future__ import annotations

import numpy as np

from gpcorrect.corrector.training_pairs import TrainingPairs
from gpcorrect.rigid import register
from gpcorrect.types import CalibrationLog

__all__ = ["require_learnable"]


def require_learnable(log: CalibrationLog) -> None:
    """Refuse, before any work, a log from which no correction can be learned whatever the cleaning keeps.

    Raises
    ------
    LogError
        A signal is missing, or too few samples have both poses and a velocity.
    DegenerateError
        The motion does not determine a registration.
    """
    pairs = TrainingPairs.of(log, np.ones(len(log), dtype=np.bool_), None)
    register(pairs.observed, pairs.command, pairs.trajectory, "none")
