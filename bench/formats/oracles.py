"""What readers of others see in a file: ezc3d, c3d, rosbags, mcap, scipy.io, h5py and pandas; nothing of gpcorrect."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Seen:
    """Poses, or markers of a rigid tool; NaN where nothing was seen.

    Parameters
    ----------
    time : (n,) array, s; None where the file has none that can be compared
    position : (n, 3) array, m; of markers their centroid
    rotation : (n, 3, 3) array or None, of markers relative to the first frame
    signal : str, where gpcorrect puts it
    relative : bool, whether rotations are relative to the first frame
    """

    time: Any
    position: np.ndarray
    rotation: np.ndarray | None
    signal: str = "tracker_cp"
    relative: bool = False


def turned(values: np.ndarray, form: str) -> np.ndarray | None:
    """Rotation matrices, NaN for incomplete rows; Euler angles in degrees about the body's own axes x, y, z."""
    if not form:
        return None
    known = np.isfinite(values).all(axis=1) & (np.abs(values).sum(axis=1) > 0 if "w" in form else True)
    some = values[known]
    if form in ("xyzw", "wxyz"):
        R = Rotation.from_quat(some, scalar_first=form == "wxyz")
    elif form == "rotvec":
        R = Rotation.from_rotvec(some)
    else:
        R = Rotation.from_euler(form, some[:, ["XYZ".index(axis) for axis in form]], degrees=True)
    result = np.full((len(values), 3, 3), np.nan)
    result[known] = R.as_matrix()
    return result


def of_markers(time: Any, points: np.ndarray) -> Seen:
    """Centroid, and rotation from the first frame, of markers `(n, m, 3)` that are seen all or not at all."""
    centred = points - points.mean(axis=1, keepdims=True)
    R = np.full((len(points), 3, 3), np.nan)
    for k in np.flatnonzero(np.isfinite(points).all(axis=(1, 2))):
        R[k] = Rotation.align_vectors(centred[k], centred[0])[0].as_matrix()
    return Seen(time, points.mean(axis=1), R, relative=True)


def _numbers(path: Path, skip: int, sep: str, *, width: int | None = None) -> np.ndarray:
    names = None if width is None else list(range(width))
    table = pd.read_csv(
        path, skiprows=skip, sep=sep, header=None, names=names, skip_blank_lines=False, on_bad_lines="skip",
        dtype=str, engine="python",
    )  # fmt: skip
    stop = next((k for k, row in enumerate(table.isna().all(axis=1)) if row), len(table))
    return table.iloc[:stop].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=float)


def markers_of_table(
    path: Path, skip: int, sep: str, clock: int | None, first: int, scale: float, rate: float = 0.0, drop: int = 0
) -> Seen:
    """Markers in columns from `first` on, without the last `drop`; the time is a column, or frames at a rate."""
    table = _numbers(path, skip, sep, width=2 + 3 * (5 + int(drop)))
    points = table[:, first : first + 15].reshape(len(table), 5, 3) * scale
    time = table[:, 0] / rate if clock is None else table[:, clock]
    return of_markers(time, points)


def motive(path: Path, first: int, form: str, scale: float) -> Seen:
    lines = path.read_text().splitlines()
    skip = next(k for k, line in enumerate(lines) if line.startswith("Frame")) + 1
    table = _numbers(path, skip, ",", width=max(line.count(",") for line in lines[1:]) + 1)
    size = 4 if form == "xyzw" else 3
    position = table[:, first + size : first + size + 3] * scale
    return Seen(table[:, 1], position, turned(table[:, first : first + size], form))


def vicon_object(path: Path, skip: int, kind: str) -> Seen:
    size = 4 if kind == "Quaternion" else 3
    table = _numbers(path, skip, ",", width=2 + size + 3)
    values, position = table[:, 2 : 2 + size], 1e-3 * table[:, 2 + size :]
    lost = (position == 0).all(axis=1)
    values, position = np.where(lost[:, None], np.nan, values), np.where(lost[:, None], np.nan, position)
    form = {"Quaternion": "xyzw", "Euler": "XYZ"}.get(kind, "rotvec")
    values = np.rad2deg(values) if kind == "Euler" else np.deg2rad(values) if kind == "Degrees" else values
    return Seen(table[:, 0] / 100.0, position, turned(values, form))


def qualisys(path: Path, kind: str, titled: bool) -> Seen:
    table = _numbers(path, 8 if titled else 7, "\t", width=(2 if titled else 0) + (15 if kind == "3D" else 16))
    time = table[:, 1] if titled else np.arange(len(table)) / 120.0
    values = table[:, 2:] if titled else table
    lost = (values[:, :3] == 0).all(axis=1)
    values = np.where(lost[:, None], np.nan, values)
    if kind == "3D":
        return of_markers(time, 1e-3 * values.reshape(len(values), 5, 3))
    return Seen(time, 1e-3 * values[:, :3], values[:, 7:16].reshape(-1, 3, 3).swapaxes(1, 2))


def ndi(path: Path, form: str) -> Seen:
    table = pd.read_csv(path, skiprows=1, header=None).apply(pd.to_numeric, errors="coerce").to_numpy(dtype=float)
    first = {"track": 6, "toolbox": 5, "capi": 6}[form]
    values = np.where(np.abs(table[:, first : first + 7]) < 1e20, table[:, first : first + 7], np.nan)
    time = table[:, 3] if form == "track" else table[:, 2] / 60.0
    return Seen(time, 1e-3 * values[:, 4:], turned(values[:, :4], "wxyz"))


def c3d_by_ezc3d(path: Path) -> Seen:
    import ezc3d

    content = ezc3d.c3d(str(path))
    points = np.moveaxis(content["data"]["points"][:3], 0, -1).swapaxes(0, 1)
    hidden = content["data"]["meta_points"]["residuals"][0].T < 0
    rate = content["parameters"]["POINT"]["RATE"]["value"][0]
    return of_markers(np.arange(len(points)) / rate, 1e-3 * np.where(hidden[..., None], np.nan, points))


def c3d_by_c3d(path: Path) -> Seen:
    import c3d

    with warnings.catch_warnings(), path.open("rb") as file:
        warnings.simplefilter("ignore")
        reader = c3d.Reader(file)
        values = np.array([points for _, points, _ in reader.read_frames()], dtype=float)
        rate = reader.point_rate
    points = np.where(values[..., 3:4] < 0, np.nan, values[..., :3])
    return of_markers(np.arange(len(points)) / rate, 1e-3 * points)


def table(
    path: Path,
    skip: int,
    sep: str,
    clock: int,
    first: int,
    form: str,
    turn: int,
    scale: float = 1.0,
    comment: str = "#",
) -> Seen:
    values = pd.read_csv(
        path, skiprows=skip, sep=r"\s+" if sep == " " else sep, header=None, comment=comment or None, dtype=float
    ).to_numpy()
    return Seen(values[:, clock] * scale, values[:, first : first + 3], turned(values[:, turn:], form))


def kitti(path: Path) -> Seen:
    T = np.loadtxt(path).reshape(-1, 3, 4)
    return Seen(np.arange(len(T)) / 10.0, T[:, :, 3], T[:, :, :3])


def jigsaws(path: Path, first: int) -> Seen:
    values = np.loadtxt(path)
    R = values[:, first + 3 : first + 12].reshape(-1, 3, 3)
    return Seen(np.arange(len(R)) / 30.0, values[:, first : first + 3], R, signal="measured_cp")


def frame(values: pd.DataFrame) -> Seen:
    position = values[[f"tracker_cp_{a}" for a in "xyz"]].to_numpy()
    rotation = turned(values[[f"tracker_cp_q{a}" for a in "wxyz"]].to_numpy(), "wxyz")
    return Seen(values["time"].to_numpy(), position, rotation)


def renamed(values: pd.DataFrame) -> Seen:
    time = values["sec"] + 1e-9 * values["nanosec"]
    return Seen(time.to_numpy(), values[[*"xyz"]].to_numpy(), turned(values[[*"abcd"]].to_numpy(), "wxyz"))


def matlab(path: Path) -> Seen:
    from scipy.io import loadmat

    content = loadmat(path)
    T = np.moveaxis(content["tracker_cp"], -1, 0)
    return Seen(content["time"].ravel(), T[:, :3, 3], T[:, :3, :3])


def hdf5(path: Path) -> Seen:
    import h5py

    with h5py.File(path) as file:
        T, time = file["tracker_cp"][()], file["time"][()]
    return Seen(time, T[:, :3, 3], T[:, :3, :3])


def hdf5_table(path: Path) -> pd.DataFrame:
    import h5py

    with h5py.File(path) as file:
        return pd.DataFrame(file["run"][()])


def bag(path: Path) -> Seen:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        rows = [_message(reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]
        start = reader.start_time
    return _poses([(stamp - start, *rest) for stamp, *rest in rows])


def mcap(path: Path) -> Seen:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    wanted = ("ndi/tool", "/ndi/tool", "/vicon/tool", "/tool", "/odom", "/poses", "/point", "/tf")
    with path.open("rb") as file:
        messages = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    start = min(m.message.log_time for m in messages)
    rows = [_message(m.decoded_message) for m in messages if m.channel.topic in wanted]
    return _poses([(stamp - start, *rest) for stamp, *rest in rows])


def _message(message: Any) -> tuple[int, list[float], list[float]]:
    """Stamp in ns, position, quaternion xyzw; the last pose of an array, the first transform."""
    message = message.transforms[0] if hasattr(message, "transforms") else message
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    if hasattr(message, "point"):
        return stamp, [message.point.x, message.point.y, message.point.z], []
    if hasattr(message, "transform"):
        p, q = message.transform.translation, message.transform.rotation
    else:
        pose = message.poses[-1] if hasattr(message, "poses") else message.pose
        pose = pose.pose if hasattr(pose, "pose") else pose
        p, q = pose.position, pose.orientation
    return stamp, [p.x, p.y, p.z], [q.x, q.y, q.z, q.w]


def _poses(rows: list[tuple[int, list[float], list[float]]]) -> Seen:
    quaternion = np.array([q for _, _, q in rows])
    form = "xyzw" if quaternion.size else ""
    return Seen(np.array([t for t, _, _ in rows]) / 1e9, np.array([p for _, p, _ in rows]), turned(quaternion, form))
