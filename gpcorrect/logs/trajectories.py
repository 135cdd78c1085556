"""Trajectory tables of public data sets, known by their columns: what each column is, without a mapping file.

TUM: time in s, position, quaternion xyzw (Sturm et al. 2012, TUM RGB-D benchmark). EuRoC: header names, time in ns
(Burri et al. 2016, EuRoC MAV data sets). KITTI: the upper three rows of a homogeneous matrix, no time (Geiger et al.
2012, odometry benchmark). JIGSAWS: 19 columns each of the master left and right and the slave left and right: tip
position, rotation, velocities, gripper, at 30 Hz (Gao et al. 2014, JHU-ISI gesture and skill assessment working set).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ColumnMap, PoseColumns
from gpcorrect.types import FloatArray

UNIT = 1e-2  # how far a quaternion's norm or a rotation may be off, to be known as one
JIGSAWS_RATE = 30.0  # Hz
JIGSAWS_ARMS = {"left": 38, "right": 57}  # first column of the slave manipulators
TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
EUROC = ("p_RS_R_x", "p_RS_R_y", "p_RS_R_z", "q_RS_w", "q_RS_x", "q_RS_y", "q_RS_z")


def recognised(names: Sequence[str], rows: FloatArray, stated: ColumnMap) -> tuple[ColumnMap, str] | None:
    """Tell what the columns of a known kind of table are, with a remark; None for other tables.

    Parameters
    ----------
    names : sequence of str
    rows : (n, columns) array, the first samples; NaN for what is no number
    stated : ColumnMap, the user's mapping, without signals
    """
    for title, columns in KINDS.items() if len(rows) else ():
        found = columns(names, rows, stated)
        if found is not None:
            given = {name: value for name in stated.model_fields_set if (value := getattr(stated, name)) is not None}
            return found.model_copy(update=given), f"read as {title}."
    return None


def _tum(names: Sequence[str], rows: FloatArray, stated: ColumnMap) -> ColumnMap | None:
    if len(names) != 8 or not (tuple(names[1:]) == TUM[1:] or _numbered(names)):
        return None
    unit = (np.abs(np.linalg.norm(rows[:, 4:], axis=1) - 1) < UNIT).all()
    if not unit or not (np.diff(rows[:, 0]) > 0).all():
        return None
    return ColumnMap(time=0, tracker_cp=PoseColumns(position=(1, 2, 3), quat_xyzw=(4, 5, 6, 7)))


def _euroc(names: Sequence[str], rows: FloatArray, stated: ColumnMap) -> ColumnMap | None:
    x, y, z, *turned = (next((name for name in names if name.partition(" ")[0] == start), "") for start in EUROC)
    if len(names) < 4 or not names[0].startswith("timestamp") or not (x and y and z):
        return None
    qw, qx, qy, qz = turned
    pose = PoseColumns(position=(x, y, z), quat_wxyz=(qw, qx, qy, qz) if all(turned) else None)
    return ColumnMap(time=names[0], time_scale=1e-9, tracker_cp=pose)


def _kitti(names: Sequence[str], rows: FloatArray, stated: ColumnMap) -> ColumnMap | None:
    if len(names) != 12 or not _numbered(names) or not _rotations(rows[:, [0, 1, 2, 4, 5, 6, 8, 9, 10]]):
        return None
    if stated.rate is None:
        raise LogError("KITTI poses have no time.", hint="Say their rate in a mapping file, such as rate = 10.0.")
    return ColumnMap(tracker_cp=PoseColumns(position=(3, 7, 11), matrix=(0, 1, 2, 4, 5, 6, 8, 9, 10)))


def _jigsaws(names: Sequence[str], rows: FloatArray, stated: ColumnMap) -> ColumnMap | None:
    if len(names) != 76 or not _numbered(names):
        return None
    if not all(_rotations(rows[:, k + 3 : k + 12]) for k in (0, 19, 38, 57)):
        return None
    if stated.bag.arm is None:
        raise LogError("JIGSAWS kinematics hold two arms.", hint="Choose one with arm left or right.")
    k = JIGSAWS_ARMS[stated.bag.arm]
    a, b, c, d, e, f, g, h, i = range(k + 3, k + 12)
    pose = PoseColumns(position=(k, k + 1, k + 2), matrix=(a, b, c, d, e, f, g, h, i))
    return ColumnMap(rate=JIGSAWS_RATE, measured_cp=pose)


def _numbered(names: Sequence[str]) -> bool:
    return tuple(names) == tuple(str(k) for k in range(len(names)))


def _rotations(rows: FloatArray) -> bool:
    R = rows.reshape(-1, 3, 3)
    return bool((np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)) < UNIT).all())


KINDS: Mapping[str, Callable[[Sequence[str], FloatArray, ColumnMap], ColumnMap | None]] = {
    "a TUM trajectory (time, position, quaternion xyzw)": _tum,
    "EuRoC ground truth (ns, position, quaternion wxyz)": _euroc,
    "KITTI poses (3 x 4 matrices, row by row)": _kitti,
    "JIGSAWS kinematics (rotations row by row)": _jigsaws,
}
"""What the columns of each kind of table are, by names, first rows and what the user stated; None for other tables."""
