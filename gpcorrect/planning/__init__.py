"""Planning with a learned correction: corrected paths, confidence margins and replanning."""

from gpcorrect.planning.confidence import Doubt, Margins, Planned, first_trusted
from gpcorrect.planning.correction import CommandPath, Corrects, Mode, corrected
from gpcorrect.planning.paths import DesiredPath, circle, reach

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
