"""Robot arms: kinematics, gravity and transmission of RAVEN-II, dVRK, and any arm of a robot file."""

from collections.abc import Callable
from functools import partial

from gpcorrect.arms.arm import Arm, Link, Transmission
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.identify import identify_chain, workspace
from gpcorrect.arms.machines import DA_VINCI_TOOL, RAVEN_TOOL, Raven2Tool, dvrk_psm, raven2
from gpcorrect.arms.remote_centre import RemoteCentreArm, Solutions
from gpcorrect.arms.robot_drives import JointDrives
from gpcorrect.arms.robot_edit import RobotEdit
from gpcorrect.arms.robot_file import Robot, is_robot_file, read_robot
from gpcorrect.errors import DataError

__all__ = [
    "DA_VINCI_TOOL",
    "RAVEN_TOOL",
    "Arm",
    "Chain",
    "Joint",
    "JointDrives",
    "Link",
    "Raven2Tool",
    "RemoteCentreArm",
    "Robot",
    "RobotEdit",
    "Solutions",
    "Transmission",
    "arm_named",
    "dvrk_psm",
    "identify_chain",
    "is_robot_file",
    "raven2",
    "read_robot",
    "workspace",
]

_ARMS: dict[str, Callable[[], RemoteCentreArm]] = {
    "raven2_left": partial(raven2, "left"),
    "raven2_right": partial(raven2, "right"),
    "dvrk_psm": dvrk_psm,
}


def arm_named(name: str) -> RemoteCentreArm:
    """Return the arm of a name, as files and command lines give it.

    Parameters
    ----------
    name : str, "raven2_left", "raven2_right" or "dvrk_psm"

    Raises
    ------
    DataError
        No arm has the name; the message lists those that are known.
    """
    if name not in _ARMS:
        raise DataError(f"no arm is named {name!r}.", hint=f"Known arms: {', '.join(sorted(_ARMS))}.")
    return _ARMS[name]()
