"""Planning with a learned correction: corrected paths, confidence margins, replanning, and the debridement task."""

from gpcorrect.planning.correction import CommandPath, Corrects, Mode, corrected
from gpcorrect.planning.margins import Doubt, Margins
from gpcorrect.planning.paths import DesiredPath, circle, reach
from gpcorrect.planning.replanning import Planned, first_trusted

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
