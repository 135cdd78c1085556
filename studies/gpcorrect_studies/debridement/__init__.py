"""Debridement on two simulated arms: fragments are found, grasped, lifted, carried and dropped."""

from gpcorrect_studies.debridement.mission import PAPER, Condition, Mission, Outcome, compare, debride
from gpcorrect_studies.debridement.rehearsal import rehearsal_log
from gpcorrect_studies.debridement.scene import Scene, Station, stations
from gpcorrect_studies.debridement.strategies import LookAndMove, OpenLoop

__all__ = [
    "PAPER",
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
    "stations",
]
