"""Reports for people: one self-contained page each."""

from gpcorrect.report.fit_page import write_fit_report

__all__ = ["write_fit_report"]
