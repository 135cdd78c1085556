"""Results in, figures out; the only place for matplotlib."""

from gpcorrect.plots.held_out import overview, typical_trajectory
from gpcorrect.plots.recordings import drift_history, joint_trajectory
from gpcorrect.plots.style import png

__all__ = [
    "drift_history",
    "joint_trajectory",
    "overview",
    "png",
    "typical_trajectory",
]
