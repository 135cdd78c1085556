"""Which arm made the log, by what its sidecar says."""

from __future__ import annotations

import re

from gpcorrect.arms import Arm, arm_named
from gpcorrect.errors import DataError
from gpcorrect.types import LogMeta

__all__ = ["arm_of"]


def arm_of(meta: LogMeta) -> Arm | None:
    """Return the arm that robot and arm name together, such as RAVEN-II and left; None when none is known."""
    words = set(re.findall(r"[a-z]+", f"{meta.robot} {meta.arm}".lower()))
    side = words & {"left", "right"}
    if "raven" in words and len(side) == 1:
        return arm_named(f"raven2_{side.pop()}")
    if "psm" in words and "si" not in words:  # the Si arm has other links than the classic one
        return arm_named("dvrk_psm")
    return _exactly(meta.arm) or _exactly(meta.robot)


def _exactly(name: str) -> Arm | None:
    try:
        return arm_named(name)
    except DataError:
        return None
