"""What a message must hold to be shown: the door of the board, for whoever publishes may publish anything."""

from __future__ import annotations

import math
from typing import Any

from gpcorrect_service.crtk.messages import Heartbeat, JointState, OperatingState, Pose, Report, Text, checked_numbers
from gpcorrect_service.protocol.errors import bad_input
from gpcorrect_service.protocol.limits import checked_pose

AXES = 6
LONGEST = 1000  # characters of a text, chosen by hand


def require_readable(message: Any) -> None:
    """Refuse a message that cannot be shown or compared.

    Parameters
    ----------
    message : Struct

    Raises
    ------
    ServiceError
        BAD_INPUT: a pose is none, numbers are missing or not finite, a text is too long, or nothing is known of it.
    """
    match message:
        case Pose():
            checked_numbers([message.stamp], 1, "the stamp")
            _require_poses(message.pose)
            _require_short(message.frame)
        case Report():
            checked_numbers([message.stamp, message.seconds], 2, "stamp and seconds")
            _require_poses(
                message.desired, message.command, *([] if message.reference is None else [message.reference])
            )
            for what, row in (("std", message.std), ("interval95", message.interval95)):
                if len(row) != AXES or not all(width is None or width >= 0 for width in row):
                    raise bad_input(f"{what} must be {AXES} numbers from 0 on, got {list(row)}.", "Leave out null.")
            _require_short(message.status, message.reason, message.model_id, message.model_hash)
        case Heartbeat():
            checked_numbers([message.stamp, message.rate], 2, "stamp and rate")
        case OperatingState() | JointState():
            checked_numbers([message.stamp], 1, "the stamp")
        case Text():
            _require_short(message.string)
        case _:
            raise bad_input(f"{type(message).__name__} is not shown.", "Send what docs/crtk.md lists.")


def _require_poses(*poses: tuple[float, ...]) -> None:
    for pose in poses:
        checked_pose(checked_numbers(pose, 7, "a pose (x y z qw qx qy qz)"), math.inf)


def _require_short(*texts: str) -> None:
    if any(len(text) > LONGEST for text in texts):
        raise bad_input(f"a text has more than {LONGEST} characters.", "Send a sentence.")
