"""Where the tracker sees the tool, against where it was meant to be at that moment: both by their stamps.

A tracked pose comes later than the report of its moment, or before it: reports are kept until then, and poses wait.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect_service.crtk.messages import Pose, Report
from gpcorrect_service.monitor.drift import DriftWatch, outside


@dataclass(frozen=True)
class ComparisonSettings:
    """What is compared; chosen by hand, each for the reason given."""

    # s by which a tracked pose may come after the report of its moment, or before it: cameras take 0.02 to 0.2 s to see
    # a pose. Stamps further apart are of two clocks, or of a planner that rests
    apart: float = 1.0
    kept: int = 1000  # reports and waiting poses: as many as come in that time at the highest rate, 1000 Hz
    # s between two reports that a pose is compared between: the straight line leaves a hand's motion (0.1 m/s2) by
    # 0.3 mm; after more, what the tool was meant to do meanwhile is not known, as after `move_cp`
    between: float = 0.15
    old: float = 2.0  # s after the last comparison from which the page says that there are none, and why


SETTINGS = ComparisonSettings()


class Comparison:
    """Compares the tracked poses of one arm with its reports, and watches for drift; one for each model."""

    def __init__(self) -> None:
        self.miss: dict[str, float] | None = None  # mm and deg of the last pose that was compared
        self.missed_at = self._counted_at = -math.inf
        self._drift = DriftWatch()
        self._reports: deque[Report] = deque(maxlen=SETTINGS.kept)
        self._waiting: deque[Pose] = deque(maxlen=SETTINGS.kept)

    def reported(self, report: Report, now: float) -> None:
        """Take note of a report, and compare the poses that waited for it.

        Parameters
        ----------
        report : Report
        now : float, clock of this machine, s
        """
        if self._reports and report.stamp < self._reports[-1].stamp:
            self._reports.clear()  # the robot's clock was set back: what was kept is of other moments
            self._waiting.clear()
        self._reports.append(report)
        while self._waiting and self._waiting[0].stamp <= report.stamp:
            self.tracked(self._waiting.popleft(), now)

    def tracked(self, pose: Pose, now: float) -> None:
        """Compare a tracked pose with the reports before and after it, or let it wait for the one after.

        Parameters
        ----------
        pose : Pose
        now : float, clock of this machine, s
        """
        ahead = pose.stamp - self._reports[-1].stamp if self._reports else math.inf
        if 0 < ahead <= SETTINGS.apart:
            self._waiting.append(pose)
        if not -SETTINGS.apart <= ahead <= 0:
            return
        k = bisect_left(self._reports, pose.stamp, key=lambda report: report.stamp)
        before, after = self._reports[max(k - 1, 0)], self._reports[k]
        if not before.stamp < pose.stamp <= after.stamp <= before.stamp + SETTINGS.between:
            return
        miss = difference(pose.pose, _desired(before, after, pose.stamp))
        self.miss, self.missed_at = sizes(miss), now
        if before.in_domain and after.in_domain:
            self._drift.see(pose.stamp, outside(miss.tolist(), after.interval95))
            self._counted_at = now

    def state(self, now: float, apart: float | None) -> dict[str, Any]:
        """Return the evidence for drift; since when nothing was compared, s, and why where that is long.

        Parameters
        ----------
        now : float, clock of this machine, s
        apart : float or None, stamp of the last tracked pose less that of the last report, s; None where one is missing
        """
        idle = now - self._counted_at
        why = self._why(now, apart) if idle > SETTINGS.old else ""
        return {**self._drift.state, "idle_seconds": idle if math.isfinite(idle) else None, "why": why}

    def _why(self, now: float, apart: float | None) -> str:
        if now - self.missed_at <= SETTINGS.old:
            return "the model does not know these poses"
        if apart is None:
            return "tracked poses and reports of the pre-filter do not both come"
        if abs(apart) <= SETTINGS.apart:
            return f"reports come more than {SETTINGS.between:g} s apart"
        where = "behind" if apart < 0 else "ahead of"
        return f"tracked poses are stamped {abs(apart):.2f} s {where} the reports: by another clock, or too late"


def difference(one: tuple[float, ...], other: tuple[float, ...]) -> Any:
    """Return (6,) `one` less `other`: m, then the rotation vector between them, rad.

    Parameters
    ----------
    one, other : (7,) tuples of float
    """
    a, b = np.array(one), np.array(other)
    R = se3.matrix_from_quaternion(np.stack([a[3:], b[3:]]))
    return np.concatenate([a[:3] - b[:3], se3.rotvec_from_matrix((R[0] @ R[1].T)[None])[0]])


def sizes(apart: Any) -> dict[str, float]:
    """Return a difference as one distance and one angle, mm and deg.

    Parameters
    ----------
    apart : (6,) array, m and rad
    """
    return {"mm": 1e3 * float(np.linalg.norm(apart[:3])), "deg": math.degrees(float(np.linalg.norm(apart[3:])))}


def _desired(before: Report, after: Report, stamp: float) -> tuple[float, ...]:
    """Return the desired pose at a moment between two reports."""
    poses, stamps = np.array([before.desired, after.desired]), np.array([before.stamp, after.stamp])
    along = (stamp - before.stamp) / (after.stamp - before.stamp)
    R = se3.interpolate_rotations(stamps, se3.matrix_from_quaternion(poses[:, 3:]), np.array([stamp]))
    position = poses[0, :3] + along * (poses[1, :3] - poses[0, :3])
    return (*position.tolist(), *se3.quaternion_from_matrix(R)[0].tolist())
