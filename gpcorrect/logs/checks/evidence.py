"""The evidence that all checks share, and what a check is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from gpcorrect.arms import Arm
from gpcorrect.logs.checks.finding import Finding
from gpcorrect.logs.checks.machine import arm_of
from gpcorrect.logs.sync import TimeOffset, log_offset
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, PoseSignal

__all__ = ["Check", "Evidence"]

OFFSET_PAIRS = (
    ("tracker_cp", ("measured_cp", "setpoint_cp")),
    ("external_jp", ("measured_jp", "setpoint_jp")),
    ("measured_cp", ("setpoint_cp",)),
    ("measured_jp", ("setpoint_jp",)),
)


@dataclass(frozen=True, eq=False)
class Evidence:
    """A log and what several checks derive from it, computed once.

    Parameters
    ----------
    log : CalibrationLog
        Any; nothing about it is taken for granted.
    """

    log: CalibrationLog

    @cached_property
    def arm(self) -> Arm | None:
        """The arm that the log's meta data name, None when they name none that is known."""
        return arm_of(self.log.meta)

    @cached_property
    def joint_types(self) -> str:
        """Joint kinds by the meta data, else by the arm; empty when neither says."""
        return self.log.meta.joint_types or (self.arm.joint_types if self.arm else "")

    @cached_property
    def offsets(self) -> tuple[TimeOffset, ...]:
        """Time offset of every observed signal against the best reference there is for it; none without a clock."""
        found: list[TimeOffset] = []
        for observed, references in () if self.log.static else OFFSET_PAIRS:
            reference = next((r for r in references if self.has(observed) and self.has(r)), None)
            if reference is not None:
                found.append(log_offset(self.log, observed, reference))
        return tuple(found)

    @cached_property
    def steps(self) -> FloatArray:
        """(n,) time since the row before, s; NaN for the first row of a trajectory."""
        step = np.full(len(self.log), np.nan)
        for _, rows in self.log.trajectories():
            step[rows[1:]] = np.diff(self.log.time[rows])
        return step

    def has(self, name: str) -> bool:
        """Whether the log has this signal, with at least one sample."""
        return name in self.log.signals and bool(self.known(name).any())

    def table(self, name: str) -> FloatArray:
        """Return a signal as an array `(n, k)`: positions and quaternions side by side, or joints."""
        value: PoseSignal | FloatArray = getattr(self.log, name)
        if not isinstance(value, PoseSignal):
            return value[:, None] if value.ndim == 1 else value
        return value.position if value.quaternion is None else np.hstack([value.position, value.quaternion])

    def known(self, name: str) -> BoolArray:
        """(n,) mask of rows in which every number of a signal is present."""
        finite = np.isfinite(self.table(name))
        known: BoolArray = np.asarray(finite.all(axis=1), dtype=np.bool_)
        return known

    def position(self, name: str) -> FloatArray:
        """Positions `(n, 3)` of a pose signal."""
        signal: PoseSignal = getattr(self.log, name)
        return signal.position


class Check(Protocol):
    """One question to a log. A new check is a new class with this method, and a line in the registry."""

    def findings(self, evidence: Evidence) -> Iterable[Finding]:
        """Yield what there is to say; nothing when all is well."""
        ...
