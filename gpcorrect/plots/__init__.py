"""Results in, figures out; the only place for matplotlib."""

from gpcorrect.plots.discrepancy_findings import gap_chart, nats_waterfall, posterior_bars, signature_correlation
from gpcorrect.plots.discrepancy_residuals import loop_plots, residual_over_joints
from gpcorrect.plots.held_out import (
    error_by_speed,
    error_distribution,
    overview,
    reliability,
    residual_maps,
    trajectory_errors,
    trajectory_paths,
    typical_trajectory,
    workspace_coverage,
)
from gpcorrect.plots.recordings import drift_history, dropped_samples, joint_trajectory, offset_curve
from gpcorrect.plots.style import png
from gpcorrect.plots.vision import marker_residuals, tracked_path, tracking_quality, view_states

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
