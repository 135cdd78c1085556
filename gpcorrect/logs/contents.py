"""What is in a recording, before anything is chosen: topics, frames, bodies, markers, columns; and a mapping file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs import rosbag
from gpcorrect.logs.columns import BagOptions, ColumnMap, ReadSettings
from gpcorrect.logs.mocap.take import Take
from gpcorrect.logs.mocap.tool import bodies_of
from gpcorrect.logs.proposal import propose_columns
from gpcorrect.logs.reader import Format, naming, parsed
from gpcorrect.logs.table import joint_names, orientation_names, position_names
from gpcorrect.logs.topics import JOINT_TYPES, POSE_TYPES, choose_topics
from gpcorrect.plain import quoted
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal


@dataclass(frozen=True)
class Part:
    """One thing in a recording.

    Parameters
    ----------
    name : str
        Of a topic, pair of frames, body, marker or column.
    kind : str
        Type of message, "body", "marker" or "column".
    samples : int
        Messages, or samples with a value.
    detail : str
        A rate, or the range of the numbers.
    """

    name: str
    kind: str
    samples: int
    detail: str = ""


@dataclass(frozen=True)
class Contents:
    """What is in a recording.

    Parameters
    ----------
    title : str
        Its format.
    parts : tuple of Part
        In the order of the file.
    mapping : str
        A mapping file that says what is likely; lines that are left to the user begin with `#`.
    """

    title: str
    parts: tuple[Part, ...]
    mapping: str


def contents_of(path: str | Path) -> Contents:
    """List what is in a recording, and propose a mapping file.

    Parameters
    ----------
    path : str or Path
        A recording of a known format.

    Raises
    ------
    LogError
        The file cannot be read.
    MissingExtraError
        The format needs a library that is not installed.
    """
    source = Path(path)
    with naming(source):
        return parsed(Contents, _listed, source, ReadSettings(ColumnMap(rate=1.0), mapped=True, disorder="keep"))


def _listed(found: Format, path: Path, settings: ReadSettings) -> Contents:
    if found.read is rosbag.read:
        return _of_bag(found.title, path)
    recorded = found.read(path, settings)
    return _of_take(found.title, recorded) if isinstance(recorded, Take) else _of_log(found.title, recorded)


def _of_bag(title: str, path: Path) -> Contents:
    listed, tree = rosbag.topics_of(path)
    parts = [Part(t.name, t.msgtype, t.count, f"{t.rate:.4g} Hz" if t.rate else "") for t in listed]
    parts += [Part(name, "transform", count) for name, count in tree.items()]
    types = {t.name: t.msgtype for t in listed}
    try:
        chosen = dict(choose_topics(types, BagOptions()).topics)
    except LogError:  # several robots or trackers: the user is to choose
        chosen = {}
    if "raven_state" in chosen:
        return Contents(title, tuple(parts), '[bag]\narm = "left"  # or "right"\n')
    lines = ["[bag.topics]", *(f"{kind} = {quoted(topic)}" for kind, topic in chosen.items())]
    for part in parts:
        moving = part.kind in POSE_TYPES or part.kind == "transform"
        if part.name not in chosen.values() and (moving or part.kind in JOINT_TYPES):
            kind = "tracker_cp" if moving else "measured_js"
            lines.append(f"# {kind} = {quoted(part.name)}")
    return Contents(title, tuple(parts), "\n".join(lines) + "\n")


def _of_take(title: str, take: Take) -> Contents:
    seen = {name: int(np.isfinite(body.pose.position).all(axis=1).sum()) for name, body in take.bodies.items()}
    parts = [Part(name, "body", count) for name, count in seen.items()]
    counts = {name: int(np.isfinite(p).all(axis=1).sum()) for name, p in take.markers.items()}
    parts += [Part(name, "marker", count) for name, count in counts.items()]
    labelled = [name for name, count in counts.items() if count and name not in take.others]
    groups = [name for name, markers in bodies_of(labelled).items() if name and len(markers) >= 3]
    bodies = list(take.bodies) or (groups if len(groups) > 1 else [])
    lines = [f"{'# ' if k else ''}body = {quoted(name)}" for k, name in enumerate(bodies)]
    if not bodies:
        lines = [f"markers = [{', '.join(quoted(name) for name in labelled)}]"]
    return Contents(title, tuple(parts), "\n".join(["[mocap]", *lines]) + "\n")


def _of_log(title: str, log: CalibrationLog) -> Contents:
    """Columns of a table: those of signals with native names, and all others."""
    columns: dict[str, FloatArray] = {}
    for name in log.signals:
        value = getattr(log, name)
        if isinstance(value, PoseSignal):
            columns |= dict(zip(position_names(name), value.position.T, strict=True))
            turned = () if value.quaternion is None else value.quaternion.T
            columns |= dict(zip(orientation_names(name), turned, strict=False))
        elif value.ndim == 1:
            columns[name] = value
        else:
            columns |= dict(zip(joint_names(name, value.shape[1]), value.T, strict=True))
    columns |= log.extra
    return Contents(title, tuple(_column(*item) for item in columns.items()), propose_columns(dict(log.extra)))


def _column(name: str, values: FloatArray) -> Part:
    known = values[np.isfinite(values)]
    span = f"{known.min():.6g}..{known.max():.6g}" if known.size else ""
    return Part(name, "column", int(known.size), span)
