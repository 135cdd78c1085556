"""Robot arms: kinematics, inverse kinematics, gravity and transmission of RAVEN-II and dVRK."""

from collections.abc import Callable
from functools import partial

from gpcorrect.arms.arm import Arm, Solutions, Transmission
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.dvrk_psm import dvrk_psm
from gpcorrect.arms.gravity import Link, gravity_torque, potential_energy
from gpcorrect.arms.raven2 import DA_VINCI_TOOL, RAVEN_TOOL, Raven2Tool, raven2
from gpcorrect.errors import DataError

__all__ = [
    "DA_VINCI_TOOL",
    "RAVEN_TOOL",
    "Arm",
    "Chain",
    "Joint",
    "Link",
    "Raven2Tool",
    "Solutions",
    "Transmission",
    "arm_named",
    "dvrk_psm",
    "gravity_torque",
    "potential_energy",
    "raven2",
]

_ARMS: dict[str, Callable[[], Arm]] = {
    "raven2_left": partial(raven2, "left"),
    "raven2_right": partial(raven2, "right"),
    "dvrk_psm": dvrk_psm,
}


def arm_named(name: str) -> Arm:
    """Return the arm of a name, as files and command lines give it.

    Parameters
    ----------
    name : str
        "raven2_left", "raven2_right" or "dvrk_psm".

    Raises
    ------
    DataError
        No arm has the name; the message lists those that are known.
    """
    if name not in _ARMS:
        raise DataError(f"no arm is named {name!r}.", hint=f"Known arms: {', '.join(sorted(_ARMS))}.")
    return _ARMS[name]()
