"""Results in, figures out; the only place for matplotlib."""

from gpcorrect.plots.cleaning import dropped_samples
from gpcorrect.plots.clocks import offset_curve
from gpcorrect.plots.discrepancy_evidence import nats_waterfall, posterior_bars, signature_correlation
from gpcorrect.plots.discrepancy_gap import gap_chart
from gpcorrect.plots.discrepancy_loops import loop_plots
from gpcorrect.plots.discrepancy_maps import residual_over_joints
from gpcorrect.plots.drift import drift_history
from gpcorrect.plots.errors import error_by_speed, error_distribution
from gpcorrect.plots.intervals import reliability
from gpcorrect.plots.overview import overview
from gpcorrect.plots.style import png
from gpcorrect.plots.trajectory import trajectory_errors, trajectory_paths, typical_trajectory
from gpcorrect.plots.vision import marker_residuals, tracked_path, tracking_quality, view_states
from gpcorrect.plots.workspace import residual_maps, workspace_coverage
from gpcorrect.plots.zigzag import joint_trajectory

__all__ = [
    "drift_history",
    "dropped_samples",
    "error_by_speed",
    "error_distribution",
    "gap_chart",
    "joint_trajectory",
    "loop_plots",
    "marker_residuals",
    "nats_waterfall",
    "offset_curve",
    "overview",
    "png",
    "posterior_bars",
    "reliability",
    "residual_maps",
    "residual_over_joints",
    "signature_correlation",
    "tracked_path",
    "tracking_quality",
    "trajectory_errors",
    "trajectory_paths",
    "typical_trajectory",
    "view_states",
    "workspace_coverage",
]
