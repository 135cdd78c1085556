"""Which samples of a recording are faults of the tracker, and why."""

from gpcorrect.cleaning.cleaner import FittedCleaner, clean, clean_with, fit_cleaner
from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.report import CleaningReport
from gpcorrect.cleaning.segments import Segment, require_segments
from gpcorrect.cleaning.settings import CleaningSettings

__all__ = [
    "CleaningReport",
    "CleaningSettings",
    "FittedCleaner",
    "Reason",
    "Segment",
    "clean",
    "clean_with",
    "fit_cleaner",
    "require_segments",
]
