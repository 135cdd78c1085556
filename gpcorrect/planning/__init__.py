"""Planning with a learned correction: corrected paths, confidence margins and replanning."""

from gpcorrect.planning.confidence import Doubt, Margins, Planned, first_trusted
from gpcorrect.planning.paths import CommandPath, Corrects, DesiredPath, Mode, circle, corrected, reach

__all__ = [
    "CommandPath",
    "Corrects",
    "DesiredPath",
    "Doubt",
    "Margins",
    "Mode",
    "Planned",
    "circle",
    "corrected",
    "first_trusted",
    "reach",
]
