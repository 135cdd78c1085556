"""What is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Signals = Literal["joints", "tracker", "both", "bare"]


@dataclass(frozen=True)
class Spec:
    """One recording to make.

    Parameters
    ----------
    suite : str, for the labels
    arm : str, name in :data:`truth_mujoco.arms.ARMS`
    hidden : tuple of str, names of the hidden causes; none is a null case
    ratio : float, RMS of each cause's own trace over RMS of the noise
    signals : "joints", "tracker", "both" or "bare"
        Outside joint sensors; a tracker beside motor encoders; both of them; or joints only, with `arm = "joints"` and
        no controller in the nominal model.
    sessions, trajectories, seconds : int, int, float, size of the recording
    """

    suite: str
    arm: str
    hidden: tuple[str, ...] = ()
    ratio: float = 1.0
    signals: Signals = "joints"
    sessions: int = 1
    trajectories: int = 24
    seconds: float = 20.0
