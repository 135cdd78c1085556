"""Check what came over the wire before a corrector sees it, and its answer before a robot does."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gpcorrect.types import FloatArray
from gpcorrect_service.protocol.errors import ServiceError

__all__ = [
    "MAX_PATH_POSES",
    "bad_input",
    "check_answer",
    "check_times",
    "checked_path",
    "checked_pose",
    "checked_twist",
    "position_limit",
]

POSITION, POSE, TWIST = 3, 7, 6
QUATERNION_TOLERANCE = 1e-3  # as for recorded samples: further from one is a mistake, not rounding
ANSWER_TOLERANCE = 1e-6  # a corrector's own quaternion is normalised
ROOM = 5.0  # m: no tabletop robot or tracker of its workspace sees further, and 5 mm sent as metres is 5
# Beyond ten times the reach of the training data a position is a wrong unit; mm for m is a thousand times.
REACH_FACTOR = 10.0
MAX_SPEED = 20.0  # m/s
SHORTEST_STEP = 1e-6  # s: no robot is asked more often, and velocities over less are rounding
LATEST = 1e11  # s: three thousand years; nanoseconds since 1970 are ten million times more
MAX_TURNING = 200.0  # rad/s
MAX_PATH_POSES = 5000  # about a minute at 100 Hz; keeps request and reply under the message limit in JSON too


def position_limit(info: Mapping[str, Any]) -> float:
    """Return the distance from the origin, m, beyond which a position is taken for a mistake of units.

    Parameters
    ----------
    info : mapping
        What the model says of itself; where present, `info["training_region"]` with `position_min` and
        `position_max` `(3,)`, m.
    """
    region = info.get("training_region")
    if not region:
        return ROOM
    corners = np.array([region["position_min"], region["position_max"]], dtype=np.float64)
    return max(ROOM, REACH_FACTOR * float(np.linalg.norm(np.abs(corners).max(axis=0))))


def checked_pose(pose: Sequence[float], limit: float) -> FloatArray:
    """Return one pose `(7,)` or `(3,)` that is worth correcting.

    Parameters
    ----------
    pose : sequence of 7 or 3 float
        x y z in m, then the quaternion w x y z.
    limit : float
        Largest believed distance from the origin, m.

    Raises
    ------
    ServiceError
        BAD_INPUT: wrong length, not finite, no unit quaternion, or too far away.
    """
    if len(pose) not in (POSE, POSITION):
        raise bad_input(
            f"a pose is 7 numbers (x y z qw qx qy qz) or 3 (x y z), got {len(pose)}.", "Send metres and wxyz."
        )
    _check_finite("pose", pose)
    if len(pose) == POSE:
        norm = math.hypot(*pose[POSITION:])
        if abs(norm - 1) > QUATERNION_TOLERANCE:
            raise bad_input(f"the quaternion has norm {norm:.6g}, not 1.", "Normalise it; the order is qw qx qy qz.")
    distance = math.hypot(*pose[:POSITION])
    if distance > limit:
        raise _too_far(distance, limit)
    return np.array(pose, dtype=np.float64)


def checked_twist(twist: Sequence[float] | None) -> FloatArray | None:
    """Return a twist `(6,)`, or None where none was sent.

    Raises
    ------
    ServiceError
        BAD_INPUT: wrong length, not finite, or no speed of a robot.
    """
    if twist is None:
        return None
    if len(twist) != TWIST:
        raise bad_input(
            f"a twist is 6 numbers (vx vy vz wx wy wz), got {len(twist)}.",
            "Leave it out where it is not known.",
        )
    _check_finite("twist", twist)
    speed, turning = math.hypot(*twist[:POSITION]), math.hypot(*twist[POSITION:])
    if speed > MAX_SPEED or turning > MAX_TURNING:
        raise bad_input(
            f"a twist of {speed:.4g} m/s and {turning:.4g} rad/s is no robot's.",
            "Send m/s and rad/s, not mm/s or deg/s.",
        )
    return np.array(twist, dtype=np.float64)


def checked_path(
    poses: Sequence[Sequence[float]], times: Sequence[float], limit: float
) -> tuple[FloatArray, FloatArray]:
    """Return poses `(n, 7)` or `(n, 3)` and strictly increasing times `(n,)`.

    Raises
    ------
    ServiceError
        BAD_INPUT: as for one pose, naming the row; or times that do not increase.
    """
    if not 0 < len(poses) <= MAX_PATH_POSES:
        raise bad_input(
            f"a path has 1 to {MAX_PATH_POSES} poses, got {len(poses)}.",
            "Cut longer paths where the robot rests.",
        )
    if len(times) != len(poses):
        raise bad_input(f"{len(poses)} poses came with {len(times)} times.", "Send one time (s) a pose.")
    if len({len(pose) for pose in poses}) != 1:
        raise bad_input("the poses of the path differ in length.", "Send 7 numbers in every pose, or 3 in every pose.")
    for row, pose in enumerate(poses):
        try:
            checked_pose(pose, limit)
        except ServiceError as error:
            raise bad_input(f"pose {row} of the path: {error.message}", error.hint) from error
    _check_finite("times", times)
    stamps = np.array(times, dtype=np.float64)
    check_times(stamps)
    return np.array(poses, dtype=np.float64), stamps


def check_times(times: FloatArray) -> None:
    """Refuse times that no path has: not increasing, closer than a microsecond, or from another unit.

    Raises
    ------
    ServiceError
        BAD_INPUT.
    """
    steps = np.diff(times)
    if (steps <= 0).any():
        raise bad_input("the times of the path do not increase.", "Send seconds, strictly increasing.")
    if (steps < SHORTEST_STEP).any() or (np.abs(times) > LATEST).any():
        raise bad_input(
            f"times are seconds at least {SHORTEST_STEP:g} apart and up to {LATEST:g}.",
            "Send seconds, not nanoseconds; stamps since 1970 or since the start are both well.",
        )


def check_answer(position: Sequence[float], quaternion: Sequence[float] | None, limit: float) -> None:
    """Refuse to pass on a command that no robot should be given.

    Raises
    ------
    ServiceError
        INTERNAL: the command is not finite, not a rotation, or outside any workspace.
    """
    numbers = [*position, *(quaternion or ())]
    if not all(map(math.isfinite, numbers)):
        raise _unsafe("is not finite")
    if quaternion is not None and abs(math.hypot(*quaternion) - 1) > ANSWER_TOLERANCE:
        raise _unsafe("has a quaternion that is no rotation")
    if math.hypot(*position) > limit:
        raise _unsafe(f"lies further than {limit:.3g} m away")


def _check_finite(what: str, numbers: Sequence[float]) -> None:
    # One sum tells of most rows that all is well; a sum of huge numbers may overflow, so it alone condemns nobody.
    if not math.isfinite(sum(numbers)) and not all(map(math.isfinite, numbers)):
        raise bad_input(f"the {what} holds a number that is not finite.", "Send only complete poses.")


def _too_far(distance: float, limit: float) -> ServiceError:
    if distance / 1000 <= limit:
        return bad_input(
            f"the position is {distance:.4g} m from the origin.", "This looks like millimetres: send metres."
        )
    return bad_input(
        f"the position is {distance:.4g} m from the origin, beyond {limit:.3g} m.",
        "Check frame and unit (metres).",
    )


def bad_input(cause: str, next_step: str) -> ServiceError:
    """Return the refusal of a request that cannot be meant."""
    return ServiceError("BAD_INPUT", cause, hint=next_step)


def _unsafe(what: str) -> ServiceError:
    return ServiceError(
        "INTERNAL", f"the model's command {what}.", hint="Do not use this model; fit it again and report it."
    )
