"""A small sound recording of every kind that is read, and what of it is damaged."""

from __future__ import annotations

import sys
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from support import ROOT

from fuzzing.mutations import BYTES, TEXT, Mutation
from gpcorrect.logs import write_log
from gpcorrect.types import CalibrationLog

# The tests' own writers of recordings.
sys.path.insert(0, str(ROOT / "tests" / "logs"))
from mocap_support import moving_tool, write_motive, write_ndi, write_nexus, write_qualisys, write_tracker, write_trc
from read_support import START, joint_state, pose_stamped, random_log, write_bag
from test_read_c3d import LABELS, motion, write_c3d
from test_read_matlab import variables, write_5, write_73
from test_read_raven2 import record, state

STEP_NS = 10_000_000
MESSAGES = 12
MAPPING = """\
time = "t"
time_scale = 1e-3
[tracker_cp]
position = ["x", "y", "z"]
position_scale = 1e-3
quat_xyzw = ["qx", "qy", "qz", "qw"]
[measured_jp]
columns = ["j1", "j2"]
scale = [1.0, 0.01]
offset = 0.5
[csv]
delimiter = ";"
decimal = ","
[bag]
namespace = "/PSM1"
max_gap = 0.1
[bag.shifts]
tracker_cp = 0.5
[mocap]
body = "tool"
rotation = "XYZ"
"""
SIDECAR = """\
robot = "RAVEN-II"
joint_types = "RRPRRR"
[T_tracker_base]
translation = [0.1, 0.2, 0.3]
rotvec = [0.0, 0.0, 1.5]
"""


@dataclass(frozen=True)
class Example:
    """A sound recording, the mapping it needs, the files that are damaged, and in which ways."""

    name: str
    path: Path
    targets: tuple[Path, ...]
    ways: Sequence[Mutation]
    columns: Path | None = None
    arm: str | None = None


def examples(folder: Path) -> list[Example]:
    """Write them all."""
    log, tool = random_log(0, n=30), moving_tool(n=30)
    found = []

    def add(name: str, path: Path, ways: Sequence[Mutation] = BYTES, **more: Any) -> None:
        found.append(Example(name, path, more.pop("targets", (path,)), ways, **more))

    def place(name: str) -> Path:
        (folder / name.replace(" ", "_")).mkdir()
        return folder / name.replace(" ", "_")

    for name, ways in (("csv", TEXT), ("parquet", BYTES)):
        add(name, _written(log, place(name) / f"a.{name}"), ways)
    add("npy", _structured(log, place("npy") / "a.npy"))
    content = variables(log, wide=False)
    add("mat 5 compressed", write_5(place("mat 5 compressed") / "a.mat", content), (*BYTES, unpacked_flipped))
    add("mat 5", _uncompressed(place("mat 5") / "a.mat", content))
    add("mat 7.3", write_73(place("mat 7.3") / "a.mat", content))
    add("hdf5", _hierarchical(place("hdf5") / "a.h5", content))
    add("c3d", write_c3d(place("c3d") / "a.c3d", motion(0)[2] * 1e3, LABELS))
    for name, write in (("motive", write_motive), ("tracker", write_tracker), ("nexus", write_nexus)):
        add(name, write(place(name) / "a.csv", tool), TEXT)
    add("qualisys", write_qualisys(place("qualisys") / "a.tsv", tool), TEXT)
    add("ndi", write_ndi(place("ndi") / "a.csv", tool), TEXT)
    add("trc", write_trc(place("trc") / "a.trc", tool), TEXT)
    for name in ("bag", "bag bz2", "bag lz4", "db3", "mcap", "mcap zstd", "mcap lz4"):
        add(name, _bag(place(name) / "r", name), (*BYTES, cells_in_bytes))
    add(
        "bag raven",
        record(place("bag raven") / "r", [state(k) for k in range(10)]),
        (*BYTES, cells_in_bytes),
        arm="left",
    )
    for name in ("folder", "folder zstd messages", "folder zstd file"):
        path = _bag(place(name) / "r", name)
        add(name, path, (*BYTES, cells_in_bytes), targets=tuple(p for p in path.iterdir() if p.is_file()))
    table = place("mapping") / "a.csv"
    table.write_text("t;x;y;z;qx;qy;qz;qw;j1;j2\n" + "".join(f"{k};1,5;2;{k};0;0;0;1;0,1;{k}\n" for k in range(20)))
    (table.parent / "map.toml").write_text(MAPPING)
    add("mapping", table, TEXT, targets=(table.parent / "map.toml",), columns=table.parent / "map.toml")
    beside = _written(log, place("sidecar") / "a.csv")
    beside.with_suffix(".toml").write_text(SIDECAR)
    add("sidecar", beside, TEXT, targets=(beside.with_suffix(".toml"),))
    return found


def _written(log: CalibrationLog, path: Path) -> Path:
    write_log(log, path)
    return path


def _structured(log: CalibrationLog, path: Path) -> Path:
    kinds: list[tuple[Any, ...]] = [("time", "f8"), ("trajectory", "i8"), ("measured_jp", "f8", (6,))]
    table = np.zeros(len(log), dtype=kinds)
    table["time"], table["trajectory"], table["measured_jp"] = log.time, log.trajectory, log.measured_jp
    np.save(path, table)
    return path


def _uncompressed(path: Path, content: dict[str, Any]) -> Path:
    from scipy.io import savemat

    savemat(path, content, do_compression=False)
    return path


def _hierarchical(path: Path, content: dict[str, Any]) -> Path:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in content.items():
            file.create_dataset(name, data=values, compression="gzip")
    return path


def unpacked_flipped(rng: np.random.Generator, data: bytes) -> bytes:
    """Damage a variable of a MATLAB 5 file beneath its compression."""
    at, variables = 128, []
    while at + 8 <= len(data):
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        variables.append(data[at + 8 : at + 8 + size])
        at += 8 + size
    chosen = int(rng.integers(len(variables)))
    inside = zlib.decompress(variables[chosen])
    variables[chosen] = zlib.compress(BYTES[rng.integers(len(BYTES))](rng, inside) or b"\0")
    return data[:128] + b"".join(b"\x0f\0\0\0" + len(v).to_bytes(4, "little") + v for v in variables)


def cells_in_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    """Exchange a word of plain text in a recording (a topic, a type, a definition, a key) for one as long."""
    words = (b"/PSM1", b"setpoint", b"measured", b"geometry", b"JointState", b"position", b"stamp", b"header")
    words += (b"float64", b"int32", b"string", b"std_msgs", b"none", b"zstd", b"lz4", b"bz2", b"topic", b"time")
    present = [word for word in words if word in data]
    if not present:
        return BYTES[0](rng, data)
    old, new = present[rng.integers(len(present))], words[rng.integers(len(words))]
    changed = rng.bytes(len(old)) if rng.random() < 0.3 else (new * len(old))[: len(old)]
    return data.replace(old, changed, 1 if rng.random() < 0.5 else -1)


def posts() -> list[Any]:
    """Messages of an arm that moves, and of a tracker."""
    rng = np.random.default_rng(0)
    found = []
    for k in range(MESSAGES):
        t, q = START + k * STEP_NS, rng.normal(size=6)
        found += [joint_state("/PSM1/measured_js", q, t, velocity=q), joint_state("/PSM1/setpoint_js", -q, t)]
        for topic in ("/PSM1/setpoint_cp", "/PSM1/measured_cp", "/ndi/tool"):
            found.append(pose_stamped(topic, rng.normal(size=3), (1.0, 0.0, 0.0, 0.0), t))
    return found


def _bag(path: Path, name: str) -> Path:
    kind, _, packed = name.partition(" ")
    with _compressed(packed):
        return write_bag(path, posts(), kind)


@contextmanager
def _compressed(how: str) -> Iterator[None]:
    """Have recordings written compressed: "bz2", "lz4", "zstd", "zstd messages", "zstd file"; "" changes nothing."""
    from lz4.frame import compress
    from rosbags.rosbag1 import Writer as Ros1Writer
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, storage_mcap
    from rosbags.rosbag2 import Writer as Ros2Writer

    open_1, open_2, init = Ros1Writer.open, Ros2Writer.open, storage_mcap.McapWriter.__init__
    modes = {"zstd": "STORAGE", "lz4": "STORAGE", "zstd messages": "MESSAGE", "zstd file": "FILE"}

    def opened_1(writer: Any) -> None:
        if how:
            writer.set_compression(Ros1Writer.CompressionFormat[how.upper()])
        open_1(writer)

    def opened_2(writer: Any) -> None:
        if how:
            writer.set_compression(CompressionMode[modes[how]], CompressionFormat.ZSTD)
        open_2(writer)

    def made(writer: Any, *given: Any) -> None:
        init(writer, *given)
        if how == "lz4":  # which rosbags reads, and does not write
            writer.compression, writer.compressor = how, compress

    with (
        patch.object(Ros1Writer, "open", opened_1),
        patch.object(Ros2Writer, "open", opened_2),
        patch.object(storage_mcap.McapWriter, "__init__", made),
    ):
        yield
