"""What a recording can be used for: the refusals of later commands, shown by the dry run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gpcorrect.calibration.joint_task import require_joints
from gpcorrect.calibration.poses import require_poses
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs import ValidationReport
from gpcorrect.logs.checks import Finding
from gpcorrect.types import CalibrationLog


@dataclass(frozen=True)
class Use:
    """A command that learns from recordings.

    Parameters
    ----------
    command : str, words after `gpcorrect`
    refusal, hint : str, why it would not take this recording, and what to do; empty where it would
    """

    command: str
    refusal: str = ""
    hint: str = ""


def with_uses(report: ValidationReport, log: CalibrationLog) -> tuple[ValidationReport, tuple[Use, ...]]:
    """Put an error into a report without any, where no command would take the recording; and return who would.

    Parameters
    ----------
    report : ValidationReport, of the same recording
    log : CalibrationLog
    """
    if not report.ok:
        return report, ()
    uses = tuple(Use(one.command, *_refusal(one, log)) for one in PURPOSES.values() if one.command)
    if not all(use.refusal for use in uses):
        return report, uses
    hint = uses[0].hint
    if log.signals == ("tracker_cp",):
        hint = "A tracker's own file goes beside the robot's (--tracker-log); look at it with validate --for tracker."
    what = f"no command can learn from it. {'; '.join(f'{use.command}: {use.refusal}' for use in uses)}"
    unusable = Finding("error", "unusable", "", what, hint)
    return replace(report, findings=(unusable, *report.findings)), uses


def for_purpose(report: ValidationReport, log: CalibrationLog, purpose: str) -> ValidationReport:
    """Judge a recording by one purpose: what it would be refused for is an error, what it does not use is none.

    Errors about signals that the purpose does not learn from become warnings; that there is no command, or nothing
    from outside, is left to the purpose.

    Parameters
    ----------
    report : ValidationReport, of the same recording
    log : CalibrationLog
    purpose : str, one of :data:`PURPOSES`
    """
    known = PURPOSES[purpose]
    findings = [f for f in report.findings if f.code not in ("no_command", "no_observation")]
    findings = [
        replace(f, severity="warning")
        if f.severity == "error" and f.signal in log.signals and f.signal not in known.uses
        else f
        for f in findings
    ]
    refusal, hint = _refusal(known, log)
    if refusal:
        findings.append(Finding("error", "unusable", "", f"not for {purpose}: {refusal}", hint))
    return replace(report, findings=tuple(findings))


def _refusal(purpose: Purpose, log: CalibrationLog) -> tuple[str, str]:
    """Return why a recording would be refused, and what to do; empty where it would not."""
    try:
        purpose.require(replace(log, remarks=()))  # which the dry run shows by themselves
    except GpCorrectError as error:
        return error.message.removeprefix(f"{log.name}: "), error.hint
    return "", ""


def _require_tracker(log: CalibrationLog) -> None:
    """Refuse what cannot go beside a robot's recording."""
    if log.tracker_cp is None:
        raise LogError("there is no tracker_cp.", hint="Say in a mapping file what the tracker saw.")
    if log.static:
        raise LogError(
            "there is no time to match with the robot's.", hint="Say the time, or a rate, in a mapping file."
        )
    seen = int(log.tracker_cp.finite.sum())
    if seen < LIMITS.fewest_samples:
        raise LogError(f"at least {LIMITS.fewest_samples} samples with a position are needed, got {seen}.")


def _require_motors(log: CalibrationLog) -> None:
    """Refuse what the discrepancy workflow cannot compare: motors on one side, the arm on the other."""
    if log.measured_jp is None and log.setpoint_jp is None:
        raise LogError("there is neither measured_jp nor setpoint_jp: nothing says where the motors were.")
    if log.external_jp is None and log.tracker_cp is None:
        raise LogError("there is neither external_jp nor tracker_cp: nothing says where the arm was.")
    if len(log) < LIMITS.fewest_samples:
        raise LogError(f"at least {LIMITS.fewest_samples} samples are needed, got {len(log)}.")


@dataclass(frozen=True)
class Purpose:
    """What a recording is for: which signals matter, and what refuses it."""

    uses: tuple[str, ...]  # signals that are learned from
    require: Callable[[CalibrationLog], object]  # raises where the recording would be refused
    command: str = ""  # that learns from it; empty for none


PURPOSES = {
    "fit": Purpose(("setpoint_cp", "measured_cp", "tracker_cp"), require_poses, "fit"),
    "joint": Purpose((*CalibrationLog.JOINTS, *CalibrationLog.SCALARS), require_joints, "joint fit"),
    "tracker": Purpose(("tracker_cp",), _require_tracker),
    "discrepancy": Purpose(
        (*CalibrationLog.JOINTS, *CalibrationLog.SCALARS, "tracker_cp", "measured_cp"), _require_motors, "discrepancy"
    ),
}
"""What `gpcorrect validate --for` takes."""
