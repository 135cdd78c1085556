"""Reports for people: one self-contained page each."""

from gpcorrect.report.discrepancy_page import write_discrepancy_report
from gpcorrect.report.model_pages import (
    write_compare_report,
    write_drift_report,
    write_evaluation_report,
    write_fit_report,
)
from gpcorrect.report.vision_pages import write_calibration_page, write_tracking_page

__all__ = [
    "write_calibration_page",
    "write_compare_report",
    "write_discrepancy_report",
    "write_drift_report",
    "write_evaluation_report",
    "write_fit_report",
    "write_tracking_page",
]
