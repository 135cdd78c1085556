"""The recipe clean -> rigid -> residual -> GP, and the corrector it makes."""

from gpcorrect.corrector.answer import PathCorrection
from gpcorrect.corrector.clocks import on_one_clock
from gpcorrect.corrector.command import CommandCorrector
from gpcorrect.corrector.fit import fit_command_corrector, fit_corrector
from gpcorrect.corrector.fit_result import FitResult
from gpcorrect.corrector.pairs import pose_pair
from gpcorrect.corrector.reference import observed_twists
from gpcorrect.corrector.residual_model import trajectory_folds
from gpcorrect.corrector.samples import LogSamples, log_samples
from gpcorrect.corrector.scores import normalised, scores_by_trajectory
from gpcorrect.corrector.settings import FitSettings
from gpcorrect.corrector.stream import CorrectionStream
from gpcorrect.corrector.usable import require_learnable

__all__ = [
    "CommandCorrector",
    "CorrectionStream",
    "FitResult",
    "FitSettings",
    "LogSamples",
    "PathCorrection",
    "fit_command_corrector",
    "fit_corrector",
    "log_samples",
    "normalised",
    "observed_twists",
    "on_one_clock",
    "pose_pair",
    "require_learnable",
    "scores_by_trajectory",
    "trajectory_folds",
]
