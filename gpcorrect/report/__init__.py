"""Reports for people: one self-contained page each."""

from gpcorrect.report.discrepancy_page import write_discrepancy_report
from gpcorrect.report.fit_page import write_fit_report
from gpcorrect.report.mahler_page import write_mahler_report
from gpcorrect.report.peng_page import write_peng_report

__all__ = ["write_discrepancy_report", "write_fit_report", "write_mahler_report", "write_peng_report"]
