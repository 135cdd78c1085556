"""Which samples of a recording are faults of the outside sensor, and why."""

from gpcorrect.cleaning.cleaner import FittedCleaner, clean_with, fit_cleaner
from gpcorrect.cleaning.report import CleaningReport, Reason
from gpcorrect.cleaning.settings import CleaningSettings, Segment, require_segments
from gpcorrect.cleaning.signals import POSES, TOOL, Pair, joint_pair

__all__ = [
    "POSES",
    "TOOL",
    "CleaningReport",
    "CleaningSettings",
    "FittedCleaner",
    "Pair",
    "Reason",
    "Segment",
    "clean_with",
    "fit_cleaner",
    "joint_pair",
    "require_segments",
]
