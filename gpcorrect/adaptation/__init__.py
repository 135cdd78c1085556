"""A model in use: new observations, signs of age, and where to measure next."""

from gpcorrect.adaptation.ageing import Ageing, estimate_ageing
from gpcorrect.adaptation.drift import Detection, detect, trajectory_scores
from gpcorrect.adaptation.explore import Proposal, explore
from gpcorrect.adaptation.update import Update, update

__all__ = [
    "Ageing",
    "Detection",
    "Proposal",
    "Update",
    "detect",
    "estimate_ageing",
    "explore",
    "trajectory_scores",
    "update",
]
