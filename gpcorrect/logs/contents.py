"""What is in a recording, before anything is chosen: topics, frames, bodies, markers, columns; and a mapping file.

The file of a table is made of the names of its columns; what they do not say is left to the user.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs import rosbag
from gpcorrect.logs.checks.clock import EPOCH_UNITS
from gpcorrect.logs.columns import BagOptions, ColumnMap, ReadSettings
from gpcorrect.logs.mocap.take import Take, bodies_of
from gpcorrect.logs.reader import Format, naming, parsed
from gpcorrect.logs.table import signal_columns
from gpcorrect.logs.topics import JOINT_TYPES, POSE_TYPES, choose_topics
from gpcorrect.plain import quoted
from gpcorrect.types import CalibrationLog, FloatArray

CLOCK = re.compile(r"time|stamp|^t$|^sec|nsec|nanosec", re.IGNORECASE)
UNITS = {  # of time, at the end of a name
    **dict.fromkeys(("ns", "nsec", "nanosec", "nanoseconds"), 1e-9),
    **dict.fromkeys(("us", "usec", "microseconds"), 1e-6),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e-3),
}
ROLES = {
    "setpoint": r"set|cmd|command|des|goal|target|ref",
    "tracker": r"track|marker|mocap|ndi|opti|vicon|qualisys|polaris|truth|gt_|camera",
    "external": r"extern|encoder|true",
    "measured": r"meas|act|state|curr|robot|joint_pos",
}


@dataclass(frozen=True)
class Part:
    """One thing in a recording."""

    name: str  # of a topic, pair of frames, body, marker or column
    kind: str  # type of message, "body", "marker" or "column"
    samples: int  # messages, or samples with a value
    detail: str = ""  # a rate, or the range of the numbers


@dataclass(frozen=True)
class Contents:
    """What is in a recording."""

    title: str  # its format
    parts: tuple[Part, ...]  # in the order of the file
    mapping: str  # a mapping file that says what is likely; lines that are left to the user begin with `#`


def contents_of(path: str | Path) -> Contents:
    """List what is in a recording, and propose a mapping file.

    Parameters
    ----------
    path : str or Path, a recording of a known format

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
        parts, mapping = _of_bag(path)
    else:
        recorded = found.read(path, settings)
        parts, mapping = _of_take(recorded) if isinstance(recorded, Take) else _of_log(recorded)
    return Contents(found.title, tuple(parts), mapping)


def _of_bag(path: Path) -> tuple[list[Part], str]:
    topics, tree = rosbag.topics_of(path)
    parts = [Part(name, kind, count, f"{rate:.4g} Hz" if rate else "") for name, kind, count, rate in topics]
    parts += [Part(name, "transform", count) for name, count in tree.items()]
    try:
        chosen, _ = choose_topics({name: kind for name, kind, *_ in topics}, BagOptions())
    except LogError:  # several robots or trackers: the user is to choose
        chosen = {}
    if "raven_state" in chosen:
        return parts, '[bag]\narm = "left"  # or "right"\n'
    lines = ["[bag.topics]", *(f"{kind} = {quoted(topic)}" for kind, topic in chosen.items())]
    for part in parts:
        moving = part.kind in POSE_TYPES or part.kind == "transform"
        if part.name not in chosen.values() and (moving or part.kind in JOINT_TYPES):
            kind = "tracker_cp" if moving else "measured_js"
            lines.append(f"# {kind} = {quoted(part.name)}")
    return parts, "\n".join(lines) + "\n"


def _of_take(take: Take) -> tuple[list[Part], str]:
    def _seen(points: FloatArray) -> int:
        return int(np.isfinite(points).all(axis=1).sum())

    markers = [Part(name, "marker", _seen(points)) for name, points in take.markers.items()]
    parts = [*(Part(name, "body", _seen(body.pose.position)) for name, body in take.bodies.items()), *markers]
    labelled = [part.name for part in markers if part.samples and part.name not in take.others]
    groups = [name for name, markers in bodies_of(labelled).items() if name and len(markers) >= 3]
    bodies = list(take.bodies) or (groups if len(groups) > 1 else [])
    lines = [f"{'# ' if k else ''}body = {quoted(name)}" for k, name in enumerate(bodies)]
    if not bodies:
        lines = [f"markers = [{', '.join(quoted(name) for name in labelled)}]"]
    return parts, "\n".join(["[mocap]", *lines]) + "\n"


def _of_log(log: CalibrationLog) -> tuple[list[Part], str]:
    """Columns of a table: those of signals with native names, and all others."""
    parts = []
    for name, values in {**signal_columns(log), **log.extra}.items():
        known = values[np.isfinite(values)]
        span = f"{known.min():.6g}..{known.max():.6g}" if known.size else ""
        parts.append(Part(name, "column", int(known.size), span))
    return parts, _propose_columns(log.extra)


def _propose_columns(columns: Mapping[str, FloatArray]) -> str:
    """Propose a mapping file for columns that have no native names."""
    left = dict(columns)
    lines = _clock(left)
    taken: set[str] = set()
    triples = [triple for name in left for triple in _alike(name, "xyz", list(left))]
    triples.sort(key=lambda t: re.search(r"q|rot|quat|vel|ang|^r|_r|w", t[0], re.IGNORECASE) is not None)
    for names in triples:  # quaternions and velocities last
        if set(names) <= set(left):
            lines += _pose(names, left, taken)
    for series in _numbered(list(left)):
        role = _role(series[0])
        signal = f"{role or 'measured'}_jp"
        body = [f"columns = [{', '.join(map(quoted, series))}]"]
        body += ["scale = 0.0174533  # degrees"] if re.search(r"(?<![a-z])deg", series[0], re.IGNORECASE) else []
        lines += _section(signal, body, role is None or signal in taken)
        taken.add(signal)
    return "\n".join(lines) + "\n"


def _clock(left: dict[str, FloatArray]) -> list[str]:
    """Lines on the time; its columns are taken away."""
    named = [name for name in left if CLOCK.search(name)]
    seconds = next((n for n in named if re.search(r"sec", n, re.IGNORECASE) and not re.search(r"nsec|nano", n)), None)
    parts = next((n for n in named if re.search(r"nsec|nano", n, re.IGNORECASE)), None)
    if seconds and parts:
        left.pop(seconds), left.pop(parts)
        return [f"time = [{quoted(seconds)}, {quoted(parts)}]", "time_scale = [1, 1e-9]"]
    if not named:
        return ["# rate = 100.0  # Hz, or: time = ..."]
    values = left.pop(named[0])
    known = np.abs(values[np.isfinite(values)])
    unit = re.split(r"[\s_\[\](]+", named[0].strip("]) "))[-1].lower()
    large = known.max() if known.size else 0.0
    scale = UNITS.get(unit) or next((s for least, _, s in EPOCH_UNITS if large > least), 1.0)
    return [f"time = {quoted(named[0])}", *([f"time_scale = {scale:g}"] if scale != 1.0 else [])]


def _alike(name: str, axes: str, names: Sequence[str]) -> Iterator[list[str]]:
    """Yield the columns that differ from one by their axis in one place, such as x, y and z."""
    for match in re.finditer(axes[0], name, re.IGNORECASE):
        letters = axes if match[0].islower() else axes.upper()
        found = [f"{name[: match.start()]}{axis}{name[match.end() :]}" for axis in letters]
        if all(other in names for other in found):
            yield found


def _pose(names: Sequence[str], left: dict[str, FloatArray], taken: set[str]) -> list[str]:
    """Lines on a pose; a quaternion goes with the position before it in the table."""
    order = list(left)
    after = order[order.index(names[2]) + 1 :]
    turned: list[str] = next((found for n in after for found in _alike(n, "wxyz", order)), [])
    role = _role(names[0])
    signal = f"{role or 'tracker'}_cp".replace("external", "tracker")
    body = [f"position = [{', '.join(map(quoted, names))}]"]
    body += ["position_scale = 1e-3"] if re.search(r"mm\b|_mm|\[mm", names[0]) else []
    body += [f"quat_wxyz = [{', '.join(map(quoted, turned))}]"] if turned else []
    for name in (*names, *turned):
        left.pop(name, None)
    doubtful = (
        signal in taken or re.search(r"vel|acc|force|torque|twist|(^|_)v_?x", names[0], re.IGNORECASE) is not None
    )
    if not doubtful:
        taken.add(signal)
    return _section(signal, body, doubtful or (role is None and len(taken) > 1))


def _numbered(names: Sequence[str]) -> list[list[str]]:
    """Series of columns whose names differ by a number that counts up; three or more."""
    series: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        match = re.fullmatch(r"(.*?)(\d+)(\D*)", name)
        if match and (match[1] or match[3]):
            series.setdefault(f"{match[1]}#{match[3]}", []).append((int(match[2]), name))
    return [[name for _, name in sorted(found)] for found in series.values() if len(found) >= 3]


def _role(name: str) -> str | None:
    return next((role for role, words in ROLES.items() if re.search(words, name, re.IGNORECASE)), None)


def _section(signal: str, body: Sequence[str], doubtful: bool) -> list[str]:
    lines = ["", f"[{signal}]", *body]
    return ["", *(f"# {line}" for line in lines[1:])] if doubtful else lines
