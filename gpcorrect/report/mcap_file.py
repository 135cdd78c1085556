"""The poses of an evaluation as a ROS 2 recording (MCAP), for Foxglove, RViz and PlotJuggler."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.atomic import require_folder, require_new
from gpcorrect.calibration import CommandCorrector, Evaluation
from gpcorrect.errors import DataError, MissingExtraError
from gpcorrect.rigid import apply_residual, pose_residual
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

POSE, VECTOR = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/Vector3Stamped"
UPRIGHT = (1.0, 0.0, 0.0, 0.0)  # orientation of poses of which positions alone are known, wxyz


def write_mcap(evaluation: Evaluation, log: CalibrationLog, folder: Path) -> None:
    """Write commanded, reached and corrected poses, and what the model changes, of the samples that pass cleaning.

    Topics, all in the frame of commands, stamped with the log's time: `/commanded`, `/reached` (the observed pose,
    registered) and `/corrected` (the command that would have been given for it) as `PoseStamped`, with no rotation
    where orientations were not measured; `/correction/position` (m) and `/correction/rotation` (rotation vector, rad)
    from reached to corrected as `Vector3Stamped`.

    Parameters
    ----------
    evaluation : Evaluation
    log : CalibrationLog
    folder : Path, made; it holds the MCAP file and its description, as `ros2 bag` has them

    Raises
    ------
    DataError, GpCorrectError
        The model corrects no poses, or the log has no clock; the folder exists already or cannot be made.
    """
    if not isinstance(evaluation.corrector, CommandCorrector) or log.setpoint_cp is None:
        hint = "Use --report for this model."
        raise DataError("a recording of poses is written for models that correct poses.", hint=hint)
    if log.static:
        raise DataError("static poses have no clock, and a recording needs one.", hint="Use --report for them.")
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtraError("rosbags", extra="ros", purpose="Writing MCAP") from error
    require_new(folder)
    require_folder(folder)
    store, measured = get_typestore(Stores.LATEST), evaluation.clean
    frame = str(evaluation.corrector.info()["frames"]["output"])
    commanded = log.setpoint_cp[measured.rows]
    reached, corrected = (apply_residual(commanded, -errors) for errors in (measured.registered, measured.corrected))
    change = pose_residual(reached, corrected)
    topics: dict[str, tuple[str, PoseSignal | FloatArray]] = {
        "/commanded": (POSE, commanded),
        "/reached": (POSE, reached),
        "/corrected": (POSE, corrected),
        "/correction/position": (VECTOR, change[:, :3]),
    }
    if np.isfinite(change[:, 3:]).all():
        topics["/correction/rotation"] = (VECTOR, change[:, 3:])
    stamps = np.round(1e9 * (measured.time - min(0.0, measured.time.min()))).astype(np.int64).tolist()
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, (kind, values) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            rows = values.table if isinstance(values, PoseSignal) else values
            for stamp, row in zip(stamps, rows.tolist(), strict=True):
                message = _message(store.types, kind, stamp, frame, row)
                writer.write(connection, stamp, store.serialize_cdr(message, kind))


def _message(types: Mapping[str, Any], kind: str, stamp: int, frame: str, row: list[float]) -> Any:
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    header = types["std_msgs/msg/Header"](time, frame)
    if kind == VECTOR:
        return types[VECTOR](header, types["geometry_msgs/msg/Vector3"](*row))
    x, y, z, qw, qx, qy, qz = (*row, *UPRIGHT)[:7]  # upright where a row is a position alone
    point, turn = types["geometry_msgs/msg/Point"](x, y, z), types["geometry_msgs/msg/Quaternion"](qx, qy, qz, qw)
    return types[POSE](header, types["geometry_msgs/msg/Pose"](point, turn))
