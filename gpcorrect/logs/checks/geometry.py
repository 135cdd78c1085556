"""Checks that signals belong together: the same arm, the same handedness, the same point of the tool."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.arms import Arm, arm_named
from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding
from gpcorrect.logs.checks.measure import mirrored, rigid_misfit
from gpcorrect.logs.sync import TimeOffset
from gpcorrect.types import FloatArray

__all__ = ["Handedness", "Kinematics", "Unrelated"]

PAIRS = (("setpoint_cp", "setpoint_jp"), ("measured_cp", "measured_jp"), ("tracker_cp", "external_jp"))
ARM_NAMES = ("raven2_left", "raven2_right", "dvrk_psm")
MIN_MISFIT = 5e-3  # m; another tool on the same arm shifts the tip by less over a workspace
BETTER = 0.3  # another arm must fit this much better
FOLLOWING = 0.5  # of the spread of the positions: what is left of it where one signal follows the other
WRIST_MISFIT, CLEARLY = (
    5e-4,
    0.1,
)  # m; the wrist point must fit ten times better than a tip half a millimetre off


@dataclass(frozen=True)
class Kinematics:
    """Poses follow from the joints through the arm that the sidecar names, up to where the base frame is."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield whether another arm fits, or the wrist point in place of the tip."""
        arm = evidence.arm
        if arm is None:
            return
        for pose, joints in PAIRS:
            if not (evidence.has(pose) and evidence.has(joints)) or evidence.table(joints).shape[1] < arm.dof:
                continue
            position, q = evidence.position(pose), evidence.table(joints)[:, : arm.dof]
            misfit = rigid_misfit(_tip(arm, q), position)
            if misfit > WRIST_MISFIT and rigid_misfit(_wrist(arm, q), position) < CLEARLY * misfit:
                yield _wrist_point(pose, misfit)
            elif misfit > MIN_MISFIT:
                yield _other_arm(arm, pose, joints, misfit, position, q)


def _tip(arm: Arm, q: FloatArray) -> FloatArray:
    tip = np.full((len(q), 3), np.nan)
    known = np.isfinite(q).all(axis=1)
    tip[known] = arm.forward(q[known])[:, :3, 3]
    return tip


def _wrist(arm: Arm, q: FloatArray) -> FloatArray:
    wrist = np.full((len(q), 3), np.nan)
    known = np.isfinite(q).all(axis=1)
    wrist[known] = arm.wrist(q[known])
    return wrist


def _wrist_point(pose: str, misfit: float) -> Finding:
    size = f"{1e3 * misfit:.1f} mm"
    what = f"it holds the wrist point, {size} off the tip: no one rigid body with its orientations."
    return Finding("warning", "wrist_point", pose, what, "Register position and orientation separately.")


def _other_arm(arm: Arm, pose: str, joints: str, misfit: float, position: FloatArray, q: FloatArray) -> Finding:
    """Say which arm fits better than the named one."""
    size = f"{1e3 * misfit:.1f} mm"
    for other in (arm_named(n) for n in ARM_NAMES if n != arm.name):
        if other.dof == arm.dof and rigid_misfit(_tip(other, q), position) < BETTER * misfit:
            what = f"it follows from {joints} by the kinematics of {other.name}, not of {arm.name} ({size} off)."
            return Finding("error", "swapped_arm", pose, what, "Correct the arm in the sidecar, or the log's source.")
    what = f"it is {size} off from where {joints} puts the tip of {arm.name}, after the best base registration."
    return Finding("warning", "kinematics", pose, what, "Another tool, joint offsets, or signals of two arms.")


@dataclass(frozen=True)
class Handedness:
    """Tracker and robot frames are both right-handed."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding where the tracker shows the motion as in a mirror."""
        for reference in ("setpoint_cp", "measured_cp"):
            if not (evidence.has("tracker_cp") and evidence.has(reference)):
                continue
            if mirrored(evidence.position(reference), evidence.position("tracker_cp")):
                what = f"it is a mirror image of {reference}: an axis is reversed, or two are exchanged."
                yield Finding("error", "mirrored", "tracker_cp", what, "Use a right-handed frame for the tracker.")
            return


@dataclass(frozen=True)
class Unrelated:
    """What was observed is the motion that was commanded."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield observed signals that do not follow the command at any shift in time."""
        for offset in evidence.offsets:
            if offset.verdict != "unrelated":
                continue
            if _follows(evidence, offset):
                what = "its time offset is not observable: its speed is not that of the command, though its place is."
                hint = "Faults of the tracker hide the speed; cleaning drops them."
                yield Finding("warning", "time_offset_unknown", offset.observed, what, hint)
            else:
                hint = "Is it the log of the other arm, or are the clocks seconds apart?"
                yield Finding("error", "unrelated", offset.observed, offset.reason, hint, len(evidence.log))


def _follows(evidence: Evidence, offset: TimeOffset) -> bool:
    """Whether most observed positions lie where the command puts them, as they stand in the table."""
    if offset.observed not in evidence.log.POSES or offset.reference not in evidence.log.POSES:
        return False
    observed = evidence.position(offset.observed)
    known = observed[np.isfinite(observed).all(axis=1)]
    spread = float(np.median(np.linalg.norm(known - np.median(known, axis=0), axis=1)))
    return rigid_misfit(evidence.position(offset.reference), observed) < FOLLOWING * spread
