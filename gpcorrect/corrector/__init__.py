"""The recipe clean -> rigid -> residual -> GP, and the corrector it makes."""

from gpcorrect.corrector.command import CommandCorrector, PathCorrection
from gpcorrect.corrector.fit import FitResult, FitSettings, fit_command_corrector, fit_corrector
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.corrector.reference import observed_twists

__all__ = [
    "CommandCorrector",
    "FitResult",
    "FitSettings",
    "PathCorrection",
    "fit_command_corrector",
    "fit_corrector",
    "observed_twists",
    "pose_pair",
]
