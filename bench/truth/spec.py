"""What is asked for, and what comes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gpcorrect.types import CalibrationLog

Awkward = Literal["", "heavy_tails", "slow", "uneven", "fast_noisy", "dropouts", "coarse", "jitter"]
AWKWARD: tuple[Awkward, ...] = ("heavy_tails", "slow", "uneven", "fast_noisy", "dropouts", "coarse", "jitter")


@dataclass(frozen=True)
class Spec:
    """One recording to make.

    Parameters
    ----------
    suite : str, for the labels
    hidden : tuple of str, names of the hidden causes; none is a null case
    ratio : float, RMS of each cause's own trace over RMS of the noise
    signals : "joints", "tracker" or "bare"
        Outside joint sensors with motor side and efforts; poses from a tracker beside commanded poses; or joints only,
        with `arm = "joints"` and no controller in the nominal model.
    motion : "separating" or "zigzag", runs that tell look-alikes apart, or constant speed to and fro
    awkward : str, which law the noise breaks; empty for the usual one
    sessions, trajectories, seconds : int, int, float, size of the recording
    """

    suite: str
    hidden: tuple[str, ...] = ()
    ratio: float = 1.0
    signals: Literal["joints", "tracker", "bare"] = "joints"
    motion: Literal["separating", "zigzag"] = "separating"
    awkward: Awkward = ""
    sessions: int = 1
    trajectories: int = 24
    seconds: float = 20.0


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, what is known of the machine (the tables of nominal.toml), and what is hidden in it.

    `labels` holds `kind` ("null", "catalogue", "outside"), `effects` [{`name`, `joint`, `params`, `ratio`}],
    `nuisance`, `suite`, `seed`.
    """

    log: CalibrationLog
    nominal: Mapping[str, Any]
    labels: Mapping[str, Any]
