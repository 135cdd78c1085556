"""Arms by name, for files and command lines."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from gpcorrect.arms.arm import Arm
from gpcorrect.arms.dvrk_psm import dvrk_psm
from gpcorrect.arms.raven2 import raven2
from gpcorrect.errors import DataError

__all__ = ["ARMS", "arm_named"]

ARMS: dict[str, Callable[[], Arm]] = {
    "raven2_left": partial(raven2, "left"),
    "raven2_right": partial(raven2, "right"),
    "dvrk_psm": dvrk_psm,
}


def arm_named(name: str) -> Arm:
    """Return the arm of that name.

    Raises
    ------
    DataError
        No arm has the name; the message lists those that are known.
    """
    if name not in ARMS:
        raise DataError(f"no arm is named {name!r}.", hint=f"Known arms: {', '.join(sorted(ARMS))}.")
    return ARMS[name]()
