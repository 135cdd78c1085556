"""What a recording can be used for: the refusals of later commands, shown by the dry run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gpcorrect.calibration.joints import require_joints
from gpcorrect.calibration.pose_samples import require_poses
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs import ValidationReport
from gpcorrect.logs.checks import Finding
from gpcorrect.types import CalibrationLog

__all__ = ["Use", "uses_of", "with_uses"]


@dataclass(frozen=True)
class Use:
    """A command that learns from recordings.

    Parameters
    ----------
    command : str
        Words after `gpcorrect`.
    refusal, hint : str
        Why it would not take this recording, and what to do; empty where it would.
    """

    command: str
    refusal: str = ""
    hint: str = ""


def uses_of(log: CalibrationLog) -> tuple[Use, ...]:
    """Ask each command that learns from recordings whether it would begin.

    Parameters
    ----------
    log : CalibrationLog
        A recording.
    """
    uses = []
    for command, require in _REQUIRE.items():
        try:
            require(log)
        except GpCorrectError as error:
            uses.append(Use(command, error.message.removeprefix(f"{log.name}: "), error.hint))
        else:
            uses.append(Use(command))
    return tuple(uses)


def with_uses(report: ValidationReport, log: CalibrationLog) -> tuple[ValidationReport, tuple[Use, ...]]:
    """Put an error into a report without any, where no command would take the recording; and return who would.

    Parameters
    ----------
    report : ValidationReport
        Of the same recording.
    log : CalibrationLog
        A recording.
    """
    if not report.ok:
        return report, ()
    uses = uses_of(log)
    if not all(use.refusal for use in uses):
        return report, uses
    first = uses[0]
    what = f"no command can learn from it. {'; '.join(f'{use.command}: {use.refusal}' for use in uses)}"
    unusable = Finding("error", "unusable", "", what, first.hint)
    return replace(report, findings=(unusable, *report.findings)), uses


def _require_motors(log: CalibrationLog) -> None:
    """Refuse what the discrepancy workflow cannot compare: motors on one side, the arm on the other."""
    if log.measured_jp is None and log.setpoint_jp is None:
        raise LogError("there is neither measured_jp nor setpoint_jp: nothing says where the motors were.")
    if log.external_jp is None and log.tracker_cp is None:
        raise LogError("there is neither external_jp nor tracker_cp: nothing says where the arm was.")
    if len(log) < LIMITS.fewest_samples:
        raise LogError(f"at least {LIMITS.fewest_samples} samples are needed, got {len(log)}.")


_REQUIRE: dict[str, Callable[[CalibrationLog], object]] = {
    "fit": require_poses,
    "joint fit": require_joints,
    "discrepancy": _require_motors,
}
