"""What a request may hold before a model sees it, and what a command may be before a robot does."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from gpcorrect.correction import Correction, Reason
from gpcorrect.types import QUATERNION_TOLERANCE, FloatArray
from gpcorrect_service.protocol.errors import ServiceError, bad_input
from gpcorrect_service.protocol.messages import Row

POSITION, POSE, TWIST = 3, 7, 6  # how many numbers each has


@dataclass(frozen=True)
class Limits:
    """Beyond these a number is a mistake of units or a broken message; chosen by hand, each for the reason given."""

    # norm of a quaternion off one: as for recorded samples; more is a mistake, not rounding
    quaternion: float = QUATERNION_TOLERANCE
    command_quaternion: float = 1e-6  # the same for commands: a model's own quaternion is normalised
    # m from the origin: no tabletop robot or tracker of its workspace measures further, and 5 mm sent as metres is 5
    room: float = 5.0
    reach: float = 10.0  # times the reach of the training data: millimetres for metres are a thousand times
    # m/s and rad/s of a twist: faster than any robot arm
    speed: float = 20.0
    turning: float = 200.0
    shortest_step: float = 1e-6  # s between rows: no robot is asked more often, and velocities over less are rounding
    latest: float = 2.0**31 - 1.0  # s: as late as a header of ROS can say; milliseconds since 1970 are far more
    # of a path: about a minute at 100 Hz; question and answer stay below the largest message in JSON too
    rows: int = 5000
    # m and rad of a joint: no arm inserts 2 m, and 20 rad are over three turns; more are millimetres or degrees
    sliding: float = 2.0
    turned: float = 20.0
    # m between a command and what registration alone commands: no arm here misses by a third of it
    learned: float = 0.1


LIMITS = Limits()


def position_limit(info: Mapping[str, Any]) -> float:
    """Return the distance from the origin, m, beyond which a position is taken for a mistake of units.

    Parameters
    ----------
    info : mapping
        A model's description; where present, `info["training_region"]` with `position_min` and `position_max` (3,), m.
    """
    region = info.get("training_region")
    if not region:
        return LIMITS.room
    corners = np.array([region["position_min"], region["position_max"]], dtype=np.float64)
    return max(LIMITS.room, LIMITS.reach * float(np.linalg.norm(np.abs(corners).max(axis=0))))


def checked_stamp(stamp: float) -> float:
    """Return a stamp; BAD_INPUT where it is 0, negative, not finite, or of another unit.

    Parameters
    ----------
    stamp : float, s
    """
    if not 0 < stamp <= LIMITS.latest:
        raise bad_input(f"the stamp is {stamp}.", "Stamp messages with the robot's clock, in s, not in ms or ns.")
    return stamp


def checked_pose(pose: Sequence[float], limit: float) -> FloatArray:
    """Return one pose (7,) or (3,); BAD_INPUT for a wrong length, NaN, no unit quaternion, or one too far away.

    Parameters
    ----------
    pose : 7 or 3 float, x y z in m, then the quaternion w x y z
    limit : float, largest believed distance from the origin, m
    """
    if len(pose) not in (POSE, POSITION):
        hint = "Send metres and wxyz."
        raise bad_input(f"a pose is 7 numbers (x y z qw qx qy qz) or 3 (x y z), got {len(pose)}.", hint)
    _check_finite("pose", pose)
    if len(pose) == POSE:
        norm = math.hypot(*pose[POSITION:])
        if abs(norm - 1) > LIMITS.quaternion:
            raise bad_input(f"the quaternion has norm {norm:.6g}, not 1.", "Normalise it; the order is qw qx qy qz.")
    distance = math.hypot(*pose[:POSITION])
    if distance > limit:
        millimetres = distance / 1000 <= limit
        raise bad_input(
            f"the position is {distance:.4g} m from the origin" + ("." if millimetres else f", beyond {limit:.3g} m."),
            "This looks like millimetres: send metres." if millimetres else "Check frame and unit (metres).",
        )
    return np.array(pose, dtype=np.float64)


def checked_twist(twist: Sequence[float] | None) -> FloatArray | None:
    """Return a twist (6,), or None where none was sent; BAD_INPUT for a wrong length, NaN, or too fast a one.

    Parameters
    ----------
    twist : 6 float or None, m/s, then rad/s
    """
    if twist is None:
        return None
    if len(twist) != TWIST:
        hint = "Leave it out where it is not known."
        raise bad_input(f"a twist is 6 numbers (vx vy vz wx wy wz), got {len(twist)}.", hint)
    _check_finite("twist", twist)
    speed, turning = math.hypot(*twist[:POSITION]), math.hypot(*twist[POSITION:])
    if speed > LIMITS.speed or turning > LIMITS.turning:
        hint = "Send m/s and rad/s, not mm/s or deg/s."
        raise bad_input(f"a twist of {speed:.4g} m/s and {turning:.4g} rad/s is no robot's.", hint)
    return np.array(twist, dtype=np.float64)


def checked_path(
    poses: Sequence[Sequence[float]], times: Sequence[float], limit: float
) -> tuple[FloatArray, FloatArray]:
    """Return poses (n, 7) or (n, 3) and increasing times (n,); BAD_INPUT as for poses and times, naming the row.

    Parameters
    ----------
    poses : n sequences of 7 or 3 float
    times : n float, s
    limit : float, as for :func:`checked_pose`
    """
    if not 0 < len(poses) <= LIMITS.rows:
        hint = "Cut longer paths where the robot rests."
        raise bad_input(f"a path has 1 to {LIMITS.rows} poses, got {len(poses)}.", hint)
    if len(times) != len(poses):
        raise bad_input(f"{len(poses)} poses came with {len(times)} times.", "Send one time (s) a pose.")
    if len({len(pose) for pose in poses}) != 1:
        raise bad_input("the poses of the path differ in length.", "Send 7 numbers in every pose, or 3 in every pose.")
    for row, pose in enumerate(poses):
        try:
            checked_pose(pose, limit)
        except ServiceError as error:
            raise bad_input(f"pose {row} of the path: {error.message}", error.hint) from error
    return np.array(poses, dtype=np.float64), check_times(times)


def check_times(times: Sequence[float]) -> FloatArray:
    """Return times (n,) of a path; BAD_INPUT where they are not finite, not increasing, too close, or of another unit.

    Parameters
    ----------
    times : n float, s
    """
    _check_finite("times", times)
    stamps = np.array(times, dtype=np.float64)
    steps = np.diff(stamps)
    if (steps <= 0).any():
        raise bad_input("the times of the path do not increase.", "Send seconds, strictly increasing.")
    if (steps < LIMITS.shortest_step).any() or (np.abs(stamps) > LIMITS.latest).any():
        hint = "Send seconds, not nanoseconds; stamps since 1970 or since the start are both well."
        raise bad_input(f"times are seconds at least {LIMITS.shortest_step:g} apart and up to {LIMITS.latest:g}.", hint)
    return stamps


def checked_rows(rows: Sequence[Row], dof: int, what: str) -> FloatArray:
    """Return rows (n, dof) of joints or efforts, NaN where null or infinite; BAD_INPUT for rows of another length.

    Parameters
    ----------
    rows : n sequences of dof float or None
    dof : int, joints of the model
    what : str, name for messages
    """
    wrong = next((len(row) for row in rows if len(row) != dof), None)
    if wrong is not None:
        raise bad_input(f"the model knows {dof} joints, a row of the {what} has {wrong}.", "Send all joints in order.")
    values = np.array(rows, dtype=np.float64)
    return np.where(np.isfinite(values), values, np.nan)


def checked_joints(rows: Sequence[Row], types: str) -> FloatArray:
    """Return joints (n, d), NaN where null; BAD_INPUT for another number of joints, and where a unit is mistaken.

    Parameters
    ----------
    rows : n sequences of d float or None, rad and m
    types : str, "R" or "P" for each joint
    """
    q = checked_rows(rows, len(types), "joints")
    far = np.abs(q) > _farthest(types)  # false where missing
    if far.any():
        joint = int(far.any(axis=0).argmax())
        unit = "metres, not millimetres" if types[joint] == "P" else "radians, not degrees"
        raise bad_input(f"joint {joint + 1} is {np.nanmax(np.abs(q[:, joint])):.4g} in the joints.", f"Send {unit}.")
    return q


@lru_cache(maxsize=16)
def _farthest(types: str) -> FloatArray:
    """Return how far each joint may be, rad or m."""
    return np.array([LIMITS.sliding if kind == "P" else LIMITS.turned for kind in types])


def check_command(
    position: Sequence[float],
    quaternion: Sequence[float] | None,
    limit: float,
    reference: Callable[[], Sequence[float]],
) -> None:
    """Refuse to pass on a command that no robot should be given.

    Parameters
    ----------
    position, quaternion : 3 float, 4 float or None, m and wxyz
    limit : float, as for :func:`checked_pose`
    reference : callable, gives the position that registration alone commands, m

    Raises
    ------
    ServiceError
        INTERNAL: the command is not finite, not a rotation, or outside any workspace. BAD_INPUT: it is outside because
        the pose that was asked for is.
    """
    trouble = ""
    if not all(map(math.isfinite, [*position, *(quaternion or ())])):
        trouble = "is not finite"
    elif quaternion is not None and abs(math.hypot(*quaternion) - 1) > LIMITS.command_quaternion:
        trouble = "has a quaternion that is no rotation"
    elif math.hypot(*position) > limit:
        if math.dist(position, reference()) <= LIMITS.learned:
            hint = "Check frame and unit (metres)."
            raise bad_input(f"the pose lies {math.hypot(*position):.4g} m from the base, beyond {limit:.3g} m.", hint)
        trouble = f"lies further than {limit:.3g} m away"
    if trouble:
        hint = "Do not use this model; fit it again and report it."
        raise ServiceError("INTERNAL", f"the model's command {trouble}.", hint=hint)


def check_inside(answer: Correction) -> None:
    """Refuse, as BAD_INPUT, an answer of which any row lies outside the training region.

    Parameters
    ----------
    answer : Correction
    """
    outside = np.flatnonzero(np.atleast_1d(answer.reasons & Reason.OUTSIDE))
    if outside.size:
        where = f"row {outside[0]} of the path" if isinstance(answer.reasons, np.ndarray) else "what was asked"
        raise bad_input(f"{where} is outside the training region.", "Stay inside, or record and fit data there.")


def check_frame(frame: str, expected: str) -> None:
    """Refuse, as BAD_INPUT, a pose that names another frame than the model; where either has no name, any is taken.

    Parameters
    ----------
    frame, expected : str, as the pose and as the model say
    """
    if frame and expected and frame.strip("/") != expected.strip("/"):
        hint = "Transform it, or name the frame that its tracker has in ROS: gpcorrect serve --frame"
        raise bad_input(f"the pose is in frame {frame!r}, and this model takes poses in {expected!r}.", hint)


def _check_finite(what: str, numbers: Sequence[float]) -> None:
    # One sum tells of most rows that all is well; a sum of huge numbers may overflow, so it alone condemns nobody.
    if not math.isfinite(sum(numbers)) and not all(map(math.isfinite, numbers)):
        raise bad_input(f"the {what} holds a number that is not finite.", "Send only complete poses.")
