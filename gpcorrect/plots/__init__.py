"""Results in, figures out; the only place for matplotlib."""

from gpcorrect.plots.discrepancy_findings import gap_chart, nats_waterfall, posterior_bars, signature_correlation
from gpcorrect.plots.discrepancy_residuals import loop_plots, residual_over_joints
from gpcorrect.plots.held_out import overview, typical_trajectory
from gpcorrect.plots.recordings import drift_history, joint_trajectory
from gpcorrect.plots.style import png

__all__ = [
    "drift_history",
    "gap_chart",
    "joint_trajectory",
    "loop_plots",
    "nats_waterfall",
    "overview",
    "png",
    "posterior_bars",
    "residual_over_joints",
    "signature_correlation",
    "typical_trajectory",
]
