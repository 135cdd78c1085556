"""The dry run: what is in a log, and what is wrong with it, before anything is learned from it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.checks import CHECKS, Evidence, Finding, Severity
from gpcorrect.logs.sync import TimeOffset
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

MISREAD = (
    "rows_apart",
    "time_unit",
    "position_unit",
    "joint_unit",
    "joint_sense",
    "joint_turn",
    "joint_dead",
    "mirrored",
    "orientation_inverted",
    "unrelated",
    "twice",
    "exchanged",
)
POSES = ("setpoint_cp", "tracker_cp")


@dataclass(frozen=True)
class ValidationReport:
    """Facts about a log and findings, the gravest first.

    Parameters
    ----------
    facts : mapping, sizes, rates, signals: JSON-able
    findings : tuple of Finding, in any order; errors come first, then warnings, then information
    offsets : tuple of TimeOffset, time offsets of the observed signals, with their correlation curves
    """

    facts: Mapping[str, Any]
    findings: tuple[Finding, ...] = ()
    offsets: tuple[TimeOffset, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        gravest_first = sorted(self.findings, key=lambda f: get_args(Severity).index(f.severity))
        object.__setattr__(self, "findings", tuple(gravest_first))

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


def validate_log(
    log: CalibrationLog, checks: Iterable[str] | None = None, *, compared: Collection[str] | None = None
) -> ValidationReport:
    """Look at a log with every check; nothing is changed and nothing raises on bad data.

    Parameters
    ----------
    log : CalibrationLog, as it was read; with disordered stamps when it was read with disorder="keep"
    checks : iterable of str, optional
        Names of the checks to ask, as in :data:`gpcorrect.logs.checks.CHECKS`; all by default. Time offsets are
        estimated only for all.
    compared : collection of str, optional
        Signals whose motion is compared with the robot's, which takes most of the time; all by default.
    """
    if len(log) == 0:
        empty = Finding("error", "empty", "", "the log has no samples.")
        return ValidationReport(_facts(log), (empty,))
    with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are what checks are there to find
        evidence = Evidence(log, compared)
        asked = CHECKS if checks is None else checks
        findings = tuple(finding for name in asked for finding in CHECKS[name](evidence))
        return ValidationReport(_facts(log), findings, evidence.offsets if checks is None else ())


def refuse_misread(
    log: CalibrationLog, learned: Collection[str] = POSES, *, as_is: bool = False
) -> tuple[Finding, ...]:
    """Refuse a log that cannot be what it is taken for (LogError); return what else is wrong, to be said.

    Refused are errors after which a fit would still run, and report figures that mean nothing: milliseconds,
    millimetres, a left-handed tracker frame, quaternions in another order, the tracker of another motion, copies.

    Parameters
    ----------
    log : CalibrationLog, to learn from or measure on
    learned : collection of str, signals that matter, beside time
    as_is : bool, refuse nothing; return all errors
    """
    checks = [name for name in CHECKS if name != "clock_offset"]  # which finds no errors, and takes long
    errors = validate_log(log, checks, compared=learned).errors
    for found in () if as_is else errors:
        if found.code in MISREAD and found.signal in ("time", *learned):
            message = found.message if found.signal == "time" else f"{found.signal}: {found.message}"
            raise LogError(message, hint=found.hint, path=log.name)
    return errors


def _facts(log: CalibrationLog) -> dict[str, Any]:
    """Sizes, rates and signals of a log, JSON-able; what is not known is None."""
    steps = [] if log.static else [np.diff(log.time[rows]) for _, rows in log.trajectories()]
    step = np.concatenate([np.empty(0), *steps])
    step = step[np.isfinite(step)]
    forward = step[step > 0]
    sizes = np.unique(log.trajectory, return_counts=True)[1]
    percent = {"min": 0, "p5": 5, "median": 50, "p95": 95, "max": 100}
    lengths = {"shortest": 0, "median": 50, "longest": 100}
    return {
        "name": log.name,
        "digest": log.digest,
        "robot": log.meta.robot,
        "arm": log.meta.arm,
        "tracker": log.meta.tracker,
        "samples": len(log),
        "trajectories": {"count": sizes.size}
        | {name: int(np.percentile(sizes, q)) if sizes.size else 0 for name, q in lengths.items()},
        "static": log.static,
        "sessions": len(np.unique(log.session)),
        "seconds": float(forward.sum()),
        "rate_hz": float(1.0 / np.median(forward)) if forward.size else None,
        "step_s": {name: float(np.percentile(step, q)) for name, q in percent.items()} if step.size else None,
        "signals": {name: _signal(getattr(log, name)) for name in log.signals},
        "extra_columns": sorted(log.extra),
        "remarks": list(log.remarks),
    }


def _signal(value: PoseSignal | FloatArray) -> dict[str, Any]:
    table = value.position if isinstance(value, PoseSignal) else value.reshape(len(value), *value.shape[1:] or (1,))
    known = value.finite if isinstance(value, PoseSignal) else np.asarray(np.isfinite(table).all(axis=1))
    found = table[known]
    return {
        "columns": table.shape[1],
        "orientation": value.quaternion is not None if isinstance(value, PoseSignal) else None,
        "missing": float(1.0 - known.mean()) if len(known) else 0.0,
        "min": found.min(axis=0).tolist() if len(found) else None,
        "max": found.max(axis=0).tolist() if len(found) else None,
    }
