"""Checks that signals belong together: the same arm, the same handedness, the same point of the tool."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.arms import Arm, arm_named
from gpcorrect.logs.checks.finding import Evidence, Finding
from gpcorrect.logs.checks.measure import MIN_PAIRED, rigid_misfit
from gpcorrect.types import FloatArray

__all__ = ["Handedness", "Kinematics", "Unrelated"]

PAIRS = (("setpoint_cp", "setpoint_jp"), ("measured_cp", "measured_jp"), ("tracker_cp", "external_jp"))
ARM_NAMES = ("raven2_left", "raven2_right", "dvrk_psm")
MIN_MISFIT = 5e-3  # m; another tool on the same arm shifts the tip by less over a workspace
BETTER = 0.3  # another arm, or another point, must fit this much better
MIN_EXPLAINED = 0.9  # of the spread; below it the handedness is not clear
MIN_THICKNESS = 0.05  # of the widest direction: flat motions have no handedness


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
            if np.isfinite(misfit) and misfit > MIN_MISFIT:
                yield _misfit(arm, pose, joints, misfit, position, q)


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


def _misfit(arm: Arm, pose: str, joints: str, misfit: float, position: FloatArray, q: FloatArray) -> Finding:
    """Say what fits better than the tip of the named arm."""
    size = f"{1e3 * misfit:.1f} mm"
    if rigid_misfit(_wrist(arm, q), position) < BETTER * misfit:
        what = f"its positions are the wrist point, not the tip ({size} off): not one rigid body with its orientations."
        return Finding("warning", "wrist_point", pose, what, "Register position and orientation separately.")
    for other in (arm_named(n) for n in ARM_NAMES if n != arm.name):
        if other.dof == arm.dof and rigid_misfit(_tip(other, q), position) < BETTER * misfit:
            what = (
                f"it follows from {joints} by the kinematics of {other.name}, not of {arm.name} ({size} off)."
            )
            return Finding(
                "error", "swapped_arm", pose, what, "Correct the arm in the sidecar, or the log's source."
            )
    what = (
        f"it is {size} off from where {joints} puts the tip of {arm.name}, after the best base registration."
    )
    return Finding(
        "warning", "kinematics", pose, what, "Another tool, joint offsets, or signals of two arms."
    )


@dataclass(frozen=True)
class Handedness:
    """Tracker and robot frames are both right-handed."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding where the tracker shows the motion as in a mirror."""
        for reference in ("setpoint_cp", "measured_cp"):
            if not (evidence.has("tracker_cp") and evidence.has(reference)):
                continue
            if _mirrored(evidence.position(reference), evidence.position("tracker_cp")):
                what = f"it is a mirror image of {reference}: an axis is reversed, or two are exchanged."
                yield Finding(
                    "error", "mirrored", "tracker_cp", what, "Use a right-handed frame for the tracker."
                )
            return


def _mirrored(reference: FloatArray, observed: FloatArray) -> bool:
    """Whether the best affine map between two motions in space turns them inside out."""
    known = np.isfinite(reference).all(axis=1) & np.isfinite(observed).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return False
    x, y = reference[known], observed[known]
    x, y = x - np.median(x, axis=0), y - np.median(y, axis=0)
    extents = np.linalg.svd(x, compute_uv=False)
    if extents[2] < MIN_THICKNESS * extents[0]:
        return False
    matrix = np.linalg.lstsq(x, y, rcond=None)[0]
    left, total = np.median(np.sum((y - x @ matrix) ** 2, axis=1)), np.median(np.sum(y**2, axis=1))
    return bool(left < (1 - MIN_EXPLAINED) * total and np.linalg.det(matrix) < 0)


@dataclass(frozen=True)
class Unrelated:
    """What was observed is the motion that was commanded."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield observed signals that do not follow the command at any shift in time."""
        for offset in evidence.offsets:
            if offset.verdict == "unrelated":
                hint = "Is it the log of the other arm, or are the clocks seconds apart?"
                yield Finding("error", "unrelated", offset.observed, offset.reason, hint, len(evidence.log))
