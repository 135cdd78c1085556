"""Recordings of a tool in the layouts that motion capture systems export: headers, units, gaps, orders of rotation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from sync_support import wandering

from gpcorrect.types import FloatArray

BODY = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.07, 0], [0, 0, 0.05], [0.04, 0.05, 0.02]])
ID = "A3C388CBAE3411E968D7AB6B1FACDB9B"
RATE = 120.0


@dataclass(frozen=True)
class Tool:
    """A tool that was seen: times, positions, orientations and markers; NaN where it was hidden."""

    time: FloatArray
    position: FloatArray
    rotation: Rotation
    markers: FloatArray
    hidden: FloatArray

    def angles(self, order: str) -> FloatArray:
        """Degrees about x, y, z of turns in this order about the body's own axes."""
        turns = self.rotation.as_euler(order, degrees=True)
        return turns[:, [order.index(axis) for axis in "XYZ"]]


def moving_tool(seed: int = 0, n: int = 60, hidden: Sequence[int] = (4, 5), rate: float = RATE) -> Tool:
    """Make a tool that wanders and turns; some frames are hidden."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) / rate
    position = 0.2 * wandering(rng)(time) / 3
    rotation = Rotation.from_rotvec(0.8 * wandering(rng)(time))
    markers = rotation.as_matrix()[:, None] @ BODY[..., None]
    gone = np.zeros(n, dtype=bool)
    gone[list(hidden)] = True
    return Tool(time, position, rotation, markers[..., 0] + position[:, None], gone)


def cells(values: FloatArray, gone: bool) -> list[str]:
    """Numbers with six decimals, empty where hidden."""
    return ["" if gone else f"{value:.6f}" for value in values]


def write_lines(path: Path, lines: Sequence[str], end: str = "\n") -> Path:
    """Write a text file and give its path."""
    path.write_bytes((end.join(lines) + end).encode())
    return path


def write_motive(
    path: Path,
    tool: Tool,
    *,
    version: str = "1.23",
    rotation: str = "Quaternion",
    unit: str = "Meters",
    scale: float = 1.0,
    names: Sequence[str] = ("tool",),
    bodies: bool = True,
    labelled: bool = True,
) -> Path:
    """Write what Motive exports: 1.23 as it is, 1.24 with a time code, 1.25 with parents, up to 1.21 without labels."""
    code = version == "1.24"
    turn = "XYZW" if rotation == "Quaternion" else "XYZ"
    parts = [*(("Rotation", axis) for axis in turn), *(("Position", axis) for axis in "XYZ"), ("Mean Marker Error", "")]
    columns = [("Rigid Body", name, *part) for name in (names if bodies else ()) for part in parts]
    markers = [f"tool:Marker {k + 1:03d}" for k in range(len(BODY))]
    for kind in ("Rigid Body Marker", "Marker") if bodies else ("Marker",):
        columns += [(kind, name, "Position", axis) for name in markers for axis in "XYZ"]
    columns += [("Marker", "Unlabeled 1189", "Position", axis) for axis in "XYZ"]
    kinds, titles, whats, axes = zip(*columns, strict=True)
    label = (lambda text: ["", text]) if labelled else (lambda text: ["", ""])
    pad = [""] if code else []
    header = (
        f"Format Version,{version},Take Name,test,Take Notes,,"
        f"Capture Frame Rate,{RATE:.6f},Export Frame Rate,{RATE:.6f},"
        f"Capture Start Time,2019-07-29 04.19.58.625 PM,Total Frames in Take,{len(tool.time)},"
        f"Total Exported Frames,{len(tool.time)},Rotation Type,{rotation},Length Units,{unit},Coordinate Space,Global"
    )
    lines = [header, "" if version == "1.25" else "," * (len(kinds) + 1)]
    above = {"Type": kinds, "Name": [f'"{title}"' for title in titles], "ID": [ID] * len(kinds)}
    above |= {"Parent": [""] * len(kinds)} if version == "1.25" else {}
    lines += [",".join([*label(name), *pad, *words]) for name, words in above.items()]
    lines += [",".join(["", "", *pad, *whats])]
    clock = "Time" if version == "1.21" else "Time (Seconds)"
    lines += [",".join(["Frame", clock, *(["TimeCode"] if code else []), *axes])]
    quaternion, angles = tool.rotation.as_quat(), None if turn == "XYZW" else tool.angles(rotation)
    for k, t in enumerate(tool.time):
        row = [str(k), f"{t:.6f}", *(["15:26:46:12.02"] if code else [])]
        for j, _ in enumerate(names if bodies else ()):
            turned = quaternion[k] if angles is None else angles[k]
            row += cells(np.hstack([turned, scale * (tool.position[k] + j), scale * 1e-4]), tool.hidden[k])
        expected = cells(scale * (tool.markers[k] + 1e-3).ravel(), tool.hidden[k]) if bodies else []
        row += [*expected, *cells(scale * tool.markers[k].ravel(), tool.hidden[k]), "", "", ""]
        lines.append(",".join(row))
    return write_lines(path, lines, "\r\n")


def write_tracker(
    path: Path, tool: Tool, *, kind: str = "", lost: str = "0", unit: str = "rad", names: Sequence[str] = ("tool",)
) -> Path:
    """Write what Vicon Tracker exports: a section Objects; what is lost is written as zeros, or empty."""
    axes = "RX,RY,RZ,RW,TX,TY,TZ" if kind == "Quaternion" else "RX,RY,RZ,TX,TY,TZ"
    width = axes.count(",") + 1
    turned = {
        "Quaternion": tool.rotation.as_quat(),
        "Euler": np.deg2rad(tool.angles("XYZ")),
    }.get(kind, tool.rotation.as_rotvec()) * (np.rad2deg(1.0) if unit == "deg" and kind != "Quaternion" else 1.0)
    said = f"Global Angle ({kind}) " if kind else "Global Angle "
    units = ",,,,mm,mm,mm" if kind == "Quaternion" else f"{unit},{unit},{unit},mm,mm,mm"
    lines = ["Objects", "100", ",," + ",".join(f"{said}{n}:{n}" + "," * (width - 1) for n in names)]
    lines += ["Frame,Sub Frame," + ",".join([axes] * len(names)), ",," + ",".join([units] * len(names))]
    for k in range(len(tool.time)):
        values = np.hstack([turned[k], 1e3 * tool.position[k]])
        row = [lost] * width if tool.hidden[k] else [f"{v:.6f}" for v in values]
        lines.append(",".join([str(k + 1), "0", *(row * len(names))]))
    return write_lines(path, [*lines, ""])


def write_nexus(
    path: Path, tool: Tool, *, segments: bool = False, delimiter: str = ",", start: int = 101, above: int = 2
) -> Path:
    """Write what Vicon Nexus exports: empty lines, devices, model outputs, segments, then trajectories in mm.

    With `above` 1 the trajectories stand alone without their title, with 0 without their rate too.
    """
    n = len(BODY)
    lines = ["", "", "Devices", "1000", ",,Force", "Frame,Sub Frame,Fx", ",,N", "1,0,3.5", "1,1,3.6", ""]
    lines = lines if above == 2 else []
    lines += [*["Trajectories", "100"][2 - above :], ",," + ",".join(f"tool:M{k}," + "," for k in range(n)) + ",*12,,"]
    lines += ["Frame,Sub Frame," + ",".join(["X,Y,Z"] * (n + 1)), ",," + ",".join(["mm,mm,mm"] * (n + 1))]
    for k in range(len(tool.time)):
        lines.append(",".join([str(start + k), "0", *cells(1e3 * tool.markers[k].ravel(), tool.hidden[k]), "", "", ""]))
    if segments:
        lines += ["", "Segments", "100", ",,subject:tool,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ"]
        lines += [",,deg,deg,deg,mm,mm,mm"]
        turned = np.rad2deg(tool.rotation.as_rotvec())
        for k in range(len(tool.time)):
            values = np.hstack([turned[k], 1e3 * tool.position[k]])
            lines.append(",".join([str(start + k), "0", *cells(values, tool.hidden[k])]))
    text = [line.replace(",", delimiter) for line in lines]
    return write_lines(path, [*text, ""])


def write_trc(
    path: Path,
    tool: Tool,
    *,
    unit: str = "mm",
    scale: float = 1e3,
    gap: str = "",
    blank: bool = True,
    virtual: str = "",
) -> Path:
    """Write a TRC file; a hidden marker is empty, `nan` or zeros, the line below the axes may be missing.

    A virtual marker stands behind the others: "named" in line 4 only, or in no line ("unnamed").
    """
    n, count = len(BODY), len(tool.time)
    label = "\tV_mid\t\t" if virtual == "named" else ""
    lines = [f"PathFileType\t4\t(X/Y/Z)\t{path.name}"]
    lines += ["DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"]
    lines += [f"{RATE:.2f}\t{RATE:.2f}\t{count}\t{n}\t{unit}\t{RATE:.2f}\t1\t{count}"]
    lines += ["Frame#\tTime\t" + "\t\t\t".join(f"tool:M{k}" for k in range(n)) + "\t\t" + label]
    lines += ["\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(n) for axis in "XYZ")]
    lines += [""] if blank else []
    for k in range(count):
        values = [gap] * (3 * n) if tool.hidden[k] else cells(scale * tool.markers[k].ravel(), False)
        values += cells(scale * tool.markers[k, :2].mean(axis=0) + 7, False) if virtual else []
        lines.append("\t".join([str(k + 1), f"{tool.time[k]:.6f}", *values]).rstrip("\t"))
    return write_lines(path, lines, "\r\n")


def write_qualisys(
    path: Path,
    tool: Tool,
    *,
    kind: str = "6D",
    titled: bool = True,
    names: Sequence[str] = ("tool",),
    lost: str = "0.000",
) -> Path:
    """Write what Qualisys Track Manager exports: bodies (6D) or markers (3D), with or without frame and time."""
    labels = names if kind == "6D" else [f"tool - {k + 1}" for k in range(len(BODY))]
    key = "BODIES" if kind == "6D" else "MARKERS"
    lines = [f"NO_OF_FRAMES\t{len(tool.time)}", "NO_OF_CAMERAS\t4", f"NO_OF_{key}\t{len(labels)}"]
    lines += [f"FREQUENCY\t{RATE:g}", "TIME_STAMP\t2020-01-22, 17:47:17\t22107.99", f"DATA_INCLUDED\t{kind}"]
    lines += ["\t".join([f"{key[:-3]}Y_NAMES" if kind == "6D" else "MARKER_NAMES", *labels])]
    columns = ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{k}]" for k in range(9))]
    axes = [columns if kind == "6D" else ["X", "Y", "Z"]] * len(labels)
    heading = [f"{name} {' '.join(part[:1])}\t" + "\t".join(part[1:]) for name, part in zip(labels, axes, strict=True)]
    lines += ["\t".join(["Frame", "Time", *heading]) + "\t"] if titled else []
    for k in range(len(tool.time)):
        if kind == "6D":
            by_columns = tool.rotation[k].as_matrix().T.ravel()
            values = np.hstack([1e3 * tool.position[k], tool.rotation[k].as_euler("xyz"), 0.1, by_columns])
            row = [f"{v:.6f}" for _ in labels for v in values]
        else:
            row = [f"{v:.6f}" for v in 1e3 * tool.markers[k].ravel()]
        row = [lost] * len(row) if tool.hidden[k] else row
        lines.append("\t".join([*([str(k + 1), f"{tool.time[k]:.6f}"] if titled else []), *row]))
    return write_lines(path, lines, "\r\n")


def write_ndi(path: Path, tool: Tool, *, form: str = "track", names: Sequence[str] = ("tool",)) -> Path:
    """Write what NDI's Track ("track"), ToolBox ("toolbox") or the samples of the Combined API ("capi") record."""
    pose = ["Q0", "Qx", "Qy", "Qz", "Tx", "Ty", "Tz", "Error"]
    before = {
        "track": ["Frame", "Time [sec]", "Face", "State"],
        "toolbox": ["Frame", "Face", "State"],
        "capi": ["Frame#", "PortHandle", "Face#", "TransformStatus"],
    }[form]
    markers = [] if form == "toolbox" else ["Markers", "State", "Tx", "Ty", "Tz"]
    first = "#Tools" if form == "capi" else "Tools"
    label = {n: f"Port 0x0{k}: {n}  s/n:3E4C880{k}" for k, n in enumerate(names, start=1)}
    groups = [["ToolInfo" if form == "capi" else label[n], *before, *pose, *markers] for n in names]
    lines = [",".join([first, *(cell for group in groups[: 1 if form == "capi" else None] for cell in group)])]
    quaternion = tool.rotation.as_quat(scalar_first=True)
    for k, t in enumerate(tool.time):
        row = [str(len(names))]
        for j, name in enumerate(names):
            gone = bool(tool.hidden[k])
            frame = str(650512279 + round(60 * t))
            state = ("Missing" if gone else "Enabled") if form == "capi" else ("Too Few Markers" if gone else "OK")
            cell = {"Frame": frame, "Frame#": frame, "Time [sec]": f"{t:.9f}", "PortHandle": f"Port:{j}"}
            row += [label[name], *(cell.get(n, state if "tat" in n else "1") for n in before)]
            nothing = [""] * 8 if form == "capi" else ["-3.697314E28"] * 7 + ["0.0000000"]
            row += nothing if gone else [f"{v:.7f}" for v in (*quaternion[k], *(1e3 * (tool.position[k] + j)), 0.25)]
            row += ["1", "Missing", "", "", ""] if markers else []
        lines.append(",".join(row))
    return write_lines(path, lines)


def mapping(path: Path, section: Mapping[str, object]) -> Path:
    """Write a mapping file with a section [mocap]."""
    lines = [f"{key} = {list(v) if isinstance(v, tuple) else repr(v)}" for key, v in section.items()]
    return write_lines(path, ["[mocap]", *(line.replace("'", '"') for line in lines)])
