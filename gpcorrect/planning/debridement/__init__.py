"""Debridement on two simulated arms: fragments are found, grasped, lifted, carried and dropped."""

from gpcorrect.planning.debridement.campaign import PAPER, Condition, compare
from gpcorrect.planning.debridement.mission import ArmRecord, Mission, Outcome, debride
from gpcorrect.planning.debridement.rehearsal import rehearsal_log, rehearsal_seconds
from gpcorrect.planning.debridement.scene import Scene, Station, stations
from gpcorrect.planning.debridement.strategies import LookAndMove, OpenLoop

__all__ = [
    "PAPER",
    "ArmRecord",
    "Condition",
    "LookAndMove",
    "Mission",
    "OpenLoop",
    "Outcome",
    "Scene",
    "Station",
    "compare",
    "debride",
    "rehearsal_log",
    "rehearsal_seconds",
    "stations",
]
