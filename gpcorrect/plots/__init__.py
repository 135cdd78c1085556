"""Results in, figures out; the only place for matplotlib."""

from gpcorrect.plots.cleaning import dropped_samples
from gpcorrect.plots.clocks import offset_curve
from gpcorrect.plots.drift import drift_history
from gpcorrect.plots.errors import error_by_speed, error_distribution
from gpcorrect.plots.intervals import reliability
from gpcorrect.plots.landing import visits
from gpcorrect.plots.overview import overview
from gpcorrect.plots.style import png
from gpcorrect.plots.training_size import training_curves
from gpcorrect.plots.trajectory import trajectory_errors, trajectory_paths, typical_trajectory
from gpcorrect.plots.workspace import residual_maps, workspace_coverage
from gpcorrect.plots.zigzag import joint_trajectory

__all__ = [
    "drift_history",
    "dropped_samples",
    "error_by_speed",
    "error_distribution",
    "joint_trajectory",
    "offset_curve",
    "overview",
    "png",
    "reliability",
    "residual_maps",
    "training_curves",
    "trajectory_errors",
    "trajectory_paths",
    "typical_trajectory",
    "visits",
    "workspace_coverage",
]
