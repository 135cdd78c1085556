"""The kinds of recordings that bench/readers.py reads: a file, what a user has to say about it, and its truth."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
from scipy.io import savemat

sys.path += [str(Path(__file__).parents[2] / "tests" / "logs"), str(Path(__file__).parents[2] / "tests")]
from mocap_support import (  # writers of the tests: they share nothing with the readers
    Tool,
    moving_tool,
    write_motive,
    write_ndi,
    write_nexus,
    write_qualisys,
    write_tracker,
    write_trc,
)
from read_support import message, plain_pose, pose_stamped, transforms, write_bag

from . import oracles
from .c3d_bytes import write_c3d_bytes

TOOL = moving_tool(5, n=400)
LABELS = [f"tool{k}" for k in range(5)]
START = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class Case:
    """A kind of recording.

    Parameters
    ----------
    kind : str, for the table
    write : callable, takes a folder, returns the file to read
    oracle : callable, what an independent reader sees in the file
    mapping : str, text of the mapping file; empty for none
    options : dict, of `read_log`
    """

    kind: str
    write: Callable[[Path], Path]
    oracle: Callable[[Path], oracles.Seen]
    mapping: str = ""
    options: dict[str, Any] = field(default_factory=dict)


def all_cases() -> list[Case]:
    return [*motive(), *vicon(), *other_mocap(), *c3d_files(), *trajectories(), *tables(), *arrays(), *ros()]


def motive() -> Iterator[Case]:
    for version in ("1.2", "1.21", "1.23", "1.24", "1.25"):
        old = version in ("1.2", "1.21")
        yield Case(
            f"Motive CSV {version}",
            lambda d, v=version, old=old: write_motive(d / "a.csv", TOOL, version=v, labelled=not old),
            lambda p, v=version: oracles.motive(p, 2 + (v == "1.24"), "xyzw", 1.0),
        )
    for order in ("XYZ", "ZYX"):
        yield Case(
            f"Motive CSV, Euler {order}",
            lambda d, o=order: write_motive(d / "a.csv", TOOL, rotation=o),
            lambda p, o=order: oracles.motive(p, 2, o, 1.0),
        )
    yield Case(
        "Motive CSV, millimetres",
        lambda d: write_motive(d / "a.csv", TOOL, unit="Millimeters", scale=1e3),
        lambda p: oracles.motive(p, 2, "xyzw", 1e-3),
    )
    yield Case(
        "Motive CSV, markers only",
        lambda d: write_motive(d / "a.csv", TOOL, bodies=False),
        lambda p: oracles.markers_of_table(p, 7, ",", 1, 2, 1.0, drop=1),
    )


def vicon() -> Iterator[Case]:
    for kind in ("Helical", "Euler", "Quaternion"):
        yield Case(
            f"Vicon Tracker CSV, {kind.lower()}",
            lambda d, k=kind: write_tracker(d / "a.csv", TOOL, kind=k),
            lambda p, k=kind: oracles.vicon_object(p, 5, k),
        )
    for name, delimiter in (("comma", ","), ("semicolon", ";"), ("tab", "\t")):
        yield Case(
            f"Vicon Nexus trajectories, {name}",
            lambda d, s=delimiter: write_nexus(d / "a.csv", TOOL, delimiter=s),
            lambda p, s=delimiter: oracles.markers_of_table(p, 15, s, None, 2, 1e-3, rate=100.0, drop=1),
        )
    yield Case(
        "Vicon Nexus segments",
        lambda d: write_nexus(d / "a.csv", TOOL, segments=True),
        lambda p: oracles.vicon_object(p, 15 + len(TOOL.time) + 6, "Degrees"),
    )
    for above, said in ((1, ""), (0, "rate = 100.0\n")):
        yield Case(
            "Vicon without title" + (", rate stated" if said else ""),
            lambda d, a=above: write_nexus(d / "a.csv", TOOL, above=a),
            lambda p, a=above: oracles.markers_of_table(p, 3 + a, ",", None, 2, 1e-3, rate=100.0, drop=1),
            said,
        )


def other_mocap() -> Iterator[Case]:
    for kind, options in {
        "TRC, millimetres": {},
        "TRC, metres": {"unit": "m", "scale": 1.0},
        "TRC, no empty line, nan": {"blank": False, "gap": "nan"},
        "TRC, virtual marker named": {"virtual": "named"},
        "TRC, virtual marker unnamed": {"virtual": "unnamed"},
    }.items():
        yield Case(
            kind,
            lambda d, o=options: write_trc(d / "a.trc", TOOL, **o),
            lambda p, o=options: oracles.markers_of_table(
                p, 6 - (not o.get("blank", True)), "\t", 1, 2, 1e-3 if "unit" not in o else 1.0, drop="virtual" in o
            ),
        )
    for kind in ("3D", "6D"):
        for titled in (True, False):
            yield Case(
                f"Qualisys TSV {kind}" + ("" if titled else ", no column names"),
                lambda d, k=kind, t=titled: write_qualisys(d / "a.tsv", TOOL, kind=k, titled=t),
                lambda p, k=kind, t=titled: oracles.qualisys(p, k, t),
            )
    for form in ("track", "toolbox", "capi"):
        yield Case(
            f"NDI CSV, {form}",
            lambda d, f=form: write_ndi(d / "a.csv", TOOL, form=f, names=("tool", "base")),
            lambda p, f=form: oracles.ndi(p, f),
            '[mocap]\nbody = "tool"\n',
        )


def c3d_files() -> Iterator[Case]:
    for order in ("intel", "dec", "mips"):
        for extra in (0, 3):
            names = [*LABELS, *(f"spare{k}" for k in range(extra))]
            yield Case(
                f"C3D, {order} order" + (", labels beyond the points" if extra else ""),
                lambda d, o=order, n=names: write_c3d_bytes(
                    d / "a.c3d", _hidden(1e3 * TOOL.markers, TOOL), n, 120.0, o
                ),
                oracles.c3d_by_c3d if order == "mips" else oracles.c3d_by_ezc3d,
            )


def _hidden(values: np.ndarray, tool: Tool) -> np.ndarray:
    shape = (-1,) + (1,) * (values.ndim - 1)
    return np.where(tool.hidden.reshape(shape), np.nan, values)


STAMPS = START / 1e9 + TOOL.time
XYZW = TOOL.rotation.as_quat()
WXYZ = TOOL.rotation.as_quat(scalar_first=True)
MATRIX = TOOL.rotation.as_matrix()


def _write_rows(path: Path, rows: np.ndarray, header: str = "", between: str = " ") -> Path:
    lines = [between.join(f"{x:.12g}" if x < 1e9 else f"{x:.6f}" for x in row) for row in rows]
    path.write_text(header + "\n".join(lines) + "\n")
    return path


def trajectories() -> Iterator[Case]:
    tum = np.column_stack([STAMPS, TOOL.position, XYZW])
    for kind, header, between in (
        ("TUM", "", " "),
        ("TUM, header in a comment", "# timestamp tx ty tz qx qy qz qw\n", " "),
        ("TUM, commas and names", "timestamp,tx,ty,tz,qx,qy,qz,qw\n", ","),
    ):
        yield Case(
            kind,
            lambda d, h=header, b=between: _write_rows(d / "a.txt", tum, h, b),
            lambda p, h=header, b=between: oracles.table(p, int(h.startswith("t")), b, 0, 1, "xyzw", 4),
        )
    ns = [f"{START + round(1e9 * t)}" for t in TOOL.time]
    for kind, width in (("EuRoC ground truth", 8), ("EuRoC positions", 4)):
        names = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"

        def euroc(folder: Path, width: int = width, names: str = names) -> Path:
            rows = np.column_stack([TOOL.position, WXYZ])[:, : width - 1]
            text = [",".join([s, *(f"{x:.12g}" for x in row)]) for s, row in zip(ns, rows, strict=True)]
            (folder / "data.csv").write_text("\n".join([",".join(names.split(",")[:width]), *text]) + "\n")
            return folder / "data.csv"

        form = "wxyz" if width == 8 else ""
        yield Case(kind, euroc, lambda p, f=form: oracles.table(p, 1, ",", 0, 1, f, 4, scale=1e-9, comment=""))
    flat = np.concatenate([MATRIX, TOOL.position[:, :, None]], axis=2).reshape(-1, 12)
    yield Case("KITTI", lambda d: _write_rows(d / "00.txt", flat), oracles.kitti, "rate = 10.0\n")
    for arm, first in (("left", 38), ("right", 57)):

        def jigsaws(folder: Path, first: int = first) -> Path:
            table = np.random.default_rng(1).normal(size=(len(MATRIX), 76))
            for k in (0, 19, 38, 57):
                table[:, k + 3 : k + 12] = np.roll(MATRIX, k, axis=0).reshape(-1, 9)
            table[:, first : first + 3] = TOOL.position
            return _write_rows(folder / "Suturing_B001.txt", table, between="   ")

        yield Case(f"JIGSAWS, {arm} arm", jigsaws, lambda p, f=first: oracles.jigsaws(p, f), options={"arm": arm})


COLUMNS = ["time", "tracker_cp_x", "tracker_cp_y", "tracker_cp_z", "tracker_cp_qw", "tracker_cp_qx", "tracker_cp_qy"]
FRAME = pd.DataFrame(np.column_stack([TOOL.time, TOOL.position, WXYZ]), columns=[*COLUMNS, "tracker_cp_qz"])


def tables() -> Iterator[Case]:
    def saved(name: str, save: Callable[[Path], object]) -> Callable[[Path], Path]:
        def write(folder: Path) -> Path:
            save(folder / name)
            return folder / name

        return write

    def seen(**options: Any) -> Callable[[Path], oracles.Seen]:
        return lambda p: oracles.frame(pd.read_csv(p, **options))

    yield Case("native CSV", saved("a.csv", lambda p: FRAME.to_csv(p, index=False)), seen())
    german = {"sep": ";", "decimal": ","}
    yield Case("CSV, decimal commas", saved("a.csv", lambda p: FRAME.to_csv(p, index=False, **german)), seen(**german))
    blank = {"sep": r"\s+", "comment": "#"}
    yield Case(
        "table between blanks, comments",
        saved("a.txt", lambda p: p.write_text("# a run\n" + FRAME.to_string(index=False, float_format="%.15g") + "\n")),
        seen(**blank),
    )
    pose = 'position = ["x", "y", "z"]\nquat_wxyz = ["a", "b", "c", "d"]\n'
    named = FRAME.set_axis(["t", *"xyzabcd"], axis=1)
    two = named.assign(sec=100 + np.floor(TOOL.time), nanosec=np.round(1e9 * (TOOL.time % 1))).drop(columns="t")
    yield Case(
        "CSV, sec and nanosec",
        saved("a.csv", lambda p: two.to_csv(p, index=False)),
        lambda p: oracles.renamed(pd.read_csv(p)),
        f'time = ["sec", "nanosec"]\ntime_scale = [1, 1e-9]\n[tracker_cp]\n{pose}',
    )
    yield Case(
        "CSV without a time, rate stated",
        saved("a.csv", lambda p: named.drop(columns="t").to_csv(p, index=False)),
        lambda p: oracles.renamed(pd.read_csv(p).assign(sec=np.arange(len(TOOL.time)) / 120.0, nanosec=0.0)),
        f"rate = 120.0\n[tracker_cp]\n{pose}",
    )
    yield Case("Parquet", saved("a.parquet", FRAME.to_parquet), lambda p: oracles.frame(pd.read_parquet(p)))
    yield Case(
        "NumPy array",
        saved("a.npy", lambda p: np.save(p, FRAME.to_numpy())),
        lambda p: oracles.frame(pd.DataFrame(np.load(p), columns=FRAME.columns)),
        "time = 0\n[tracker_cp]\nposition = [1, 2, 3]\nquat_wxyz = [4, 5, 6, 7]\n",
    )


def arrays() -> Iterator[Case]:
    T = np.zeros((len(MATRIX), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = MATRIX, TOOL.position, 1.0

    def matlab(folder: Path) -> Path:
        savemat(
            folder / "a.mat", {"time": TOOL.time[:, None], "tracker_cp": np.moveaxis(T, 0, -1)}, do_compression=True
        )
        return folder / "a.mat"

    def hdf5(folder: Path) -> Path:
        with h5py.File(folder / "a.h5", "w") as file:
            file["time"], file["tracker_cp"] = TOOL.time, T
        return folder / "a.h5"

    def hdf5_table(folder: Path) -> Path:
        with h5py.File(folder / "a.hdf5", "w") as file:
            file["run"] = FRAME.to_records(index=False)
        return folder / "a.hdf5"

    yield Case("MATLAB 5, compressed", matlab, oracles.matlab)
    yield Case("HDF5, arrays", hdf5, oracles.hdf5)
    yield Case("HDF5, a table", hdf5_table, lambda p: oracles.frame(oracles.hdf5_table(p)))


def ros() -> Iterator[Case]:
    ticks = [START + round(1e9 * t) for t in TOOL.time]

    def stamped(topic: str) -> list[Any]:
        return [pose_stamped(topic, TOOL.position[k], WXYZ[k], t) for k, t in enumerate(ticks)]

    def filled(topic: str, kind: str, fill: Callable[[int, Any], dict[str, Any]]) -> list[Any]:
        return [message(topic, kind, t, t, lambda types, k=k: fill(k, types)) for k, t in enumerate(ticks)]

    def pose(k: int, types: Any) -> Any:
        return plain_pose(types, TOOL.position[k], WXYZ[k])

    def covered(k: int, types: Any) -> Any:
        return types["geometry_msgs/msg/PoseWithCovariance"](pose(k, types), np.zeros(36))

    def odometry(k: int, types: Any) -> dict[str, Any]:
        zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        twist = types["geometry_msgs/msg/TwistWithCovariance"](
            types["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36)
        )
        return {"child_frame_id": "tool", "pose": covered(k, types), "twist": twist}

    other = [pose_stamped("/elsewhere", TOOL.position[k][::-1], WXYZ[k], t) for k, t in enumerate(ticks)]
    tf = [transforms("/tf", [("world", "tool", TOOL.position[k], WXYZ[k])], t) for k, t in enumerate(ticks)]
    fixed = transforms("/tf_static", [("tool", "tip", [0, 0, 0.1], [1, 0, 0, 0])], ticks[0])
    both = lambda k, t: {"poses": [plain_pose(t, [9, 9, 9], [1, 0, 0, 0]), pose(k, t)]}  # noqa: E731
    contents = {
        "PoseStamped": (stamped("/ndi/tool"), {}),
        "PoseStamped, no leading slash": (stamped("ndi/tool"), {"tracker_topic": "/ndi/tool"}),
        "PoseStamped among others": (stamped("/vicon/tool") + other, {}),
        "PoseWithCovarianceStamped": (
            filled("/tool", "geometry_msgs/msg/PoseWithCovarianceStamped", lambda k, t: {"pose": covered(k, t)}),
            {},
        ),
        "Odometry": (filled("/odom", "nav_msgs/msg/Odometry", odometry), {}),
        "PoseArray, second pose": (
            filled("/poses", "geometry_msgs/msg/PoseArray", both),
            {"tracker_topic": "/poses[1]"},
        ),
        "PointStamped": (
            filled("/point", "geometry_msgs/msg/PointStamped", lambda k, t: {"point": pose(k, t).position}),
            {},
        ),
        "transforms": ([*tf, fixed], {}),
    }
    for kind, (posts, options) in contents.items():
        for form in ("bag", "mcap") if kind in ("PoseStamped", "Odometry", "PointStamped") else ("mcap",):
            yield Case(
                f"{'ROS 1 bag' if form == 'bag' else 'MCAP'}, {kind}",
                lambda d, p=posts, f=form: write_bag(d / "r", p, f),
                oracles.bag if form == "bag" else oracles.mcap,
                options=options,
            )
    yield Case("ROS 2 db3, PoseStamped", lambda d: write_bag(d / "r", stamped("/ndi/tool"), "db3"), oracles.bag)
