"""The recipe clean -> rigid -> residual -> GP, and the corrector it makes."""

from gpcorrect.corrector.clocks import on_one_clock
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
    "on_one_clock",
    "pose_pair",
]
