"""The dry run: what is in a log, and what is wrong with it, before anything is learned from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gpcorrect.logs.checks import CHECKS, Check, Evidence, Finding, Severity
from gpcorrect.logs.facts import facts_of
from gpcorrect.logs.sync import TimeOffset
from gpcorrect.types import CalibrationLog

__all__ = ["ValidationReport", "validate_log"]

ORDER: tuple[Severity, ...] = ("error", "warning", "info")


@dataclass(frozen=True)
class ValidationReport:
    """Facts about a log and findings, the gravest first.

    Parameters
    ----------
    facts : mapping
        Sizes, rates, signals: JSON-able.
    findings : tuple of Finding
        Errors, then warnings, then information.
    offsets : tuple of TimeOffset
        Time offsets of the observed signals, with their correlation curves.
    """

    facts: Mapping[str, Any]
    findings: tuple[Finding, ...] = ()
    offsets: tuple[TimeOffset, ...] = field(default=(), repr=False)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that make the log unfit to learn from."""
        return tuple(f for f in self.findings if f.severity == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings to look at first."""
        return tuple(f for f in self.findings if f.severity == "warning")

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not self.errors

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form."""
        return {
            "ok": self.ok,
            "facts": dict(self.facts),
            "findings": [f.to_dict() for f in self.findings],
            "time_offsets": [o.to_dict() for o in self.offsets],
        }


def validate_log(log: CalibrationLog, checks: Sequence[Check] = CHECKS) -> ValidationReport:
    """Look at a log with every check; nothing is changed and nothing raises on bad data.

    Parameters
    ----------
    log : CalibrationLog
        As it was read; with disordered stamps when it was read with disorder="keep".
    checks : sequence of Check
        Questions to ask.
    """
    if len(log) == 0:
        empty = Finding("error", "empty", "", "the log has no samples.")
        return ValidationReport(facts_of(log), (empty,))
    with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are what checks are there to find
        evidence = Evidence(log)
        findings = [finding for check in checks for finding in check.findings(evidence)]
        findings.sort(key=lambda f: ORDER.index(f.severity))
        return ValidationReport(facts_of(log), tuple(findings), evidence.offsets)
