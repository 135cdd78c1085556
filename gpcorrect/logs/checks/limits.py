"""Check of joint positions against the limits of the arm that the sidecar names."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.arms import Arm
from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding, Severity, examples
from gpcorrect.logs.checks.units import POSITIONS_OF_JOINTS, misread_joints
from gpcorrect.types import FloatArray

__all__ = ["JointLimits"]

TOLERANCE = {"R": np.deg2rad(1.0), "P": 1e-3}  # encoders and servo overshoot pass soft limits by less
UNIT = {"R": (np.rad2deg(1.0), "deg"), "P": (1e3, "mm")}


@dataclass(frozen=True)
class JointLimits:
    """Joints stay within the arm's limits."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding for each joint that leaves them; those with a wrong unit are left to that check."""
        if evidence.arm is None:
            return
        misread = misread_joints(evidence)
        for name in POSITIONS_OF_JOINTS:
            if not evidence.has(name):
                continue
            for joint in range(min(evidence.arm.dof, evidence.table(name).shape[1])):
                if (name, joint) not in misread:
                    yield from _joint(evidence.arm, evidence.table(name)[:, joint], name, joint)


def _joint(arm: Arm, q: FloatArray, name: str, joint: int) -> Iterator[Finding]:
    kind = arm.joint_types[joint]
    low, high = arm.limits[joint]
    beyond = np.maximum(np.maximum(low - q, q - high), 0.0)
    rows = np.flatnonzero(beyond > TOLERANCE[kind])
    if not rows.size:
        return
    share = rows.size / max(int(np.isfinite(q).sum()), 1)
    severity: Severity = "error" if share > 0.5 else "warning"
    scale, unit = UNIT[kind]
    what = (
        f"joint {joint + 1} leaves {scale * low:.4g} to {scale * high:.4g} {unit}, the limits of {arm.name}, "
        f"in {rows.size} samples ({share:.2%}), by up to {scale * float(np.nanmax(beyond)):.3g} {unit}."
    )
    hint = "Check the arm's name in the sidecar, the joint order and the joint offsets."
    yield Finding(severity, "joint_limit", name, what, hint, int(rows.size), examples(rows))
