"""The one door for recordings: which format is it, and who reads it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import c3d_file, csv_file, matlab, npy_file, parquet_file, rosbag
from gpcorrect.logs.apart import parse, parse_apart
from gpcorrect.logs.columns import DEFAULT_MAX_BYTES, ColumnMap, ReadSettings, load_columns
from gpcorrect.logs.mocap import motive, ndi, qualisys, trc, vicon
from gpcorrect.logs.mocap.take import Take, log_of
from gpcorrect.logs.native import read_sidecar, sidecar_path
from gpcorrect.logs.order import Disorder, check_order
from gpcorrect.types import CalibrationLog, LogMeta, PoseSignal

T = TypeVar("T")
Reader = Callable[[Path, ReadSettings], CalibrationLog | Take]
"""What reads a format into a log, or what cameras saw, where the tool is still to be chosen. A file that is damaged,
cut off, too large or of another layout raises a LogError, a library that is not installed a MissingExtraError."""
FARTHEST = 1e6  # m or rad: beyond it, in whatever unit, no arm has been
SAME_DECIMALS = 8  # of a mean: far below what noise makes of two recordings, far above rounding; chosen by hand
HEAD = 1 << 16  # bytes that tell a format: the header of a motion capture export names hundreds of markers
ENDS = (b"\r", b"\n", b",", b";", b"\t", b'"')  # of a title that stands alone in its line, or in its first cell
VICON = tuple(title.encode() + end for title in vicon.TITLES for end in ENDS)
AXES = re.compile(rb'^"?Frame"?[,;\t]"?Sub ?Frame', re.MULTILINE)  # of Vicon's exports without a title
ROS = ("rosbags.highlevel", "rosbags.typesys.stores.latest")  # the types take longer to load than a bag to read


@dataclass(frozen=True)
class Format:
    """A file format: what its files are called, how they begin, who reads them, whether as a whole, with what.

    `libraries` are the compiled modules that parse it: such files are read apart (:mod:`gpcorrect.logs.apart`).
    A text without a first word of its own is known by a `line` near its beginning.
    """

    title: str
    suffixes: tuple[str, ...]
    marks: tuple[bytes, ...]
    read: Reader
    text: bool = False
    whole: bool = True
    line: re.Pattern[bytes] | None = None
    libraries: tuple[str, ...] = ()


FORMATS = (
    Format("Parquet", (".parquet", ".pq"), (b"PAR1",), parquet_file.read, libraries=("pandas", "pyarrow.compute")),
    Format("NumPy", (".npy",), (b"\x93NUMPY",), npy_file.read),
    Format("ROS 1 bag", (".bag",), (b"#ROSBAG V",), rosbag.read, whole=False, libraries=ROS),
    Format("MCAP", (".mcap",), (b"\x89MCAP0\r\n",), rosbag.read, whole=False, libraries=ROS),
    Format("ROS 2 database", (".db3",), (b"SQLite format 3\0",), rosbag.read, whole=False, libraries=ROS),
    Format("MATLAB", (".mat",), matlab.MARKS, matlab.read, libraries=("scipy.io", "h5py")),
    Format("HDF5", (".h5", ".hdf5"), (matlab.HDF5,), matlab.read, libraries=("h5py",)),
    Format("OptiTrack Motive CSV", (), (b"Format Version,",), motive.read, text=True),
    Format("Vicon CSV", (), VICON, vicon.read, text=True, line=AXES),
    Format("Qualisys TSV", (), qualisys.MARKS, qualisys.read, text=True),
    Format("NDI CSV", (), ndi.MARKS, ndi.read, text=True),
    Format("TRC", (".trc",), (b"PathFileType",), trc.read, text=True),
    Format("C3D", (".c3d",), (), c3d_file.read),
    Format("CSV", (".csv", ".tsv", ".txt"), (), csv_file.read),
)
"""A new format is a new file with a `read` function, and one line here."""

FOLDER = Format("ROS 2", (), (), rosbag.read, whole=False, libraries=ROS)


def read_log(
    path: str | Path,
    *,
    columns: str | Path | None = None,
    namespace: str | None = None,
    tracker_topic: str | None = None,
    arm: str | None = None,
    max_bytes: int = DEFAULT_MAX_BYTES,
    disorder: Disorder = "refuse",
) -> CalibrationLog:
    """Read a recording of any format that is known, into SI units, radians and quaternions wxyz.

    Parameters
    ----------
    path : str or Path
        A CSV, Parquet, npy, bag, db3, MCAP, MATLAB, HDF5, C3D or TRC file, an export of Motive, Vicon, Qualisys or NDI,
        or the folder of a ROS 2 recording.
    columns : str or Path, optional
        Mapping file for a foreign table; its sections [bag] and [mocap] say more about those formats.
    namespace : str, optional, which arm of a recording of CRTK topics, such as "/PSM1"
    tracker_topic : str, optional, topic of the outside tracker's pose; "" for none
    arm : {"left", "right"}, optional, which arm of a recording of RAVEN-II state messages
    max_bytes : int, largest table to read into memory
    disorder : {"refuse", "drop", "keep"}
        What to do about time that does not increase inside a trajectory: raise, leave the samples out, or
        keep them, which is for looking at a recording only.

    Returns
    -------
    CalibrationLog
        With the sidecar's meta data, the SHA-256 of the file, and remarks on what reading decided.

    Raises
    ------
    LogError
        The file is missing, damaged, too large, of no known format, or does not hold what is needed.
    MissingExtraError
        The format needs a library that is not installed.
    """
    if arm not in (None, "left", "right"):
        raise LogError(f"expected arm 'left' or 'right', got {arm!r}.")
    source = Path(path)
    mapping = ColumnMap() if columns is None else load_columns(columns)
    given = {"namespace": namespace, "tracker_topic": tracker_topic, "arm": arm}
    bag = mapping.bag.model_copy(update={k: v for k, v in given.items() if v is not None})
    settings = ReadSettings(mapping.model_copy(update={"bag": bag}), columns is not None, disorder, max_bytes)
    with naming(source):
        log = _scaled(_possible(parsed(CalibrationLog, _log, source, settings)), mapping.scales)
        meta = LogMeta() if columns and sidecar_path(source) == Path(columns) else read_sidecar(source)
        stated = {name: value for name, value in asdict(meta).items() if value}  # the sidecar comes first
        digest = recording_digest(source)
        found: dict[str, Any] = {"digest": digest, "recordings": (digest,), "contents": (_contents(log),)}
        return replace(log, name=str(source), meta=replace(log.meta, **stated), **found)


def parsed(kind: type[T], read: Callable[[Format, Path, ReadSettings], T], path: Path, settings: ReadSettings) -> T:
    """Have a recording read: in a process of its own where compiled code parses its format.

    Parameters
    ----------
    kind : type, what `read` returns: a dataclass
    read : callable, from format, path and settings to what is wanted of the recording; a function of a module
    path, settings : see :func:`read_log`
    """
    found = format_of(path)
    size = path.stat().st_size
    if found.whole and size > settings.max_bytes:
        hint = "Convert it to Parquet, split it, or raise the limit in Python with max_bytes."
        raise LogError(f"expected at most {settings.max_bytes / 1e9:.3g} GB, got {size / 1e9:.3g} GB.", hint=hint)
    if found.whole and size == 0:
        raise LogError("the file is empty.")
    reader = partial(read, found)
    if found.libraries:
        return parse_apart(kind, found.title, reader, path, settings, found.libraries)
    return parse(found.title, reader, path, settings)


def _log(found: Format, path: Path, settings: ReadSettings) -> CalibrationLog:
    recorded = found.read(path, settings)
    if not isinstance(recorded, Take):
        return recorded
    log = log_of(recorded, settings.columns.mocap)
    time, keep, remarks = check_order(log.time, log.trajectory, settings.disorder, lambda row: f"sample {row + 1}")
    log = replace(log, time=time, remarks=(*log.remarks, *remarks))
    return log if keep.all() else log.select(keep)


def _scaled(log: CalibrationLog, scales: Mapping[str, float]) -> CalibrationLog:
    """Return the log with poses in metres whose recording holds, or states, another unit."""
    changed: dict[str, Any] = {}
    for name, scale in scales.items():
        pose = getattr(log, name)
        if pose is None:
            hint = f"Present: {', '.join(log.signals)}."
            raise LogError(f"the mapping file scales {name}, which the recording does not hold.", hint=hint)
        changed[name] = PoseSignal(pose.position * scale, pose.quaternion)
        if name == "tracker_cp" and "marker_rms" in log.extra:
            changed["extra"] = {**log.extra, "marker_rms": log.extra["marker_rms"] * scale}
    return replace(log, **changed) if changed else log


def _possible(log: CalibrationLog) -> CalibrationLog:
    """Return the log with numbers that no arm or tracker has as missing; remarks say how many."""
    changed: dict[str, Any] = {}
    remarks = []
    for name in log.signals:
        value = getattr(log, name)
        pose = isinstance(value, PoseSignal)
        table = value.position if pose else value
        limit = FARTHEST if pose or name.endswith("_jp") else np.inf
        wrong = np.isinf(table) | (np.abs(table) > limit)
        if wrong.any():
            rows = int(wrong.reshape(len(wrong), -1).any(axis=1).sum())
            remarks.append(
                f"{rows} samples of {name} are infinite or beyond {FARTHEST:g} m or rad; they count as missing."
            )
            rest = np.where(wrong, np.nan, table)
            changed[name] = PoseSignal(rest, value.quaternion) if pose else rest
    seen: PoseSignal | None = changed.get("tracker_cp", log.tracker_cp)
    if seen is not None:
        # Exactly 0, 0, 0 and unturned is how trackers write what they do not see; one that counts from its first pose
        # is there once.
        unturned = True if seen.quaternion is None else ~(np.abs(seen.quaternion[:, 0]) < 1.0)
        hidden = (seen.position == 0.0).all(axis=1) & unturned
        if hidden.sum() > 1:
            changed["tracker_cp"] = PoseSignal.of(np.where(hidden[:, None], np.nan, seen.table))
            what = f"{hidden.sum()} samples of tracker_cp are at exactly 0, 0, 0, unturned"
            remarks.append(f"{what}; they count as missing.")
    return replace(log, **changed, remarks=(*log.remarks, *remarks)) if changed else log


def format_of(path: Path) -> Format:
    """Tell the format of a recording, by how the file begins; by its name where the format has no mark.

    Parameters
    ----------
    path : Path, a file, or the folder of a ROS 2 recording
    """
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return FOLDER
        raise LogError("expected a file or the folder of a ROS 2 recording, found no metadata.yaml in it.")
    with path.open("rb") as file:
        head = file.read(HEAD)
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip(b'\r\n ,;\t"')  # may begin with empty lines and a byte order mark
    for known in FORMATS:
        if (text if known.text else head).startswith(known.marks) or (known.line and known.line.search(head)):
            return known
    named = next((f for f in FORMATS if path.suffix.lower() in f.suffixes), None)
    if named is not None and not (named.marks and head):
        return named
    formats = ", ".join(f"{f.title} ({', '.join(f.suffixes)})" if f.suffixes else f.title for f in FORMATS)
    what = f"the name ends in {path.suffix or 'nothing'} and the content is unknown."
    if named is not None:
        what = f"the name says {named.title}, but the file does not begin like one."
    raise LogError(what, hint=f"Known formats: {formats}, and the folder of a ROS 2 recording.")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of the file into every error on the way out.

    Parameters
    ----------
    path : Path
    """
    try:
        yield
    except (LogError, DataError) as error:
        if isinstance(error, LogError) and error.path:
            raise
        raise LogError(error.message, hint=error.hint, path=str(path)) from error
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror or error}.", path=str(path)) from error


def _contents(log: CalibrationLog) -> str:
    """SHA-256 of three moments of each column of a log's signals: no format, time or last digit changes them."""
    whole, late = hashlib.sha256(), np.linspace(0.0, 1.0, len(log))[:, None]
    for name in log.signals:
        values = getattr(log, name)
        parts = (values.position, values.quaternion) if isinstance(values, PoseSignal) else (values,)
        for part in (part.reshape(len(log), -1) for part in parts if part is not None):
            there = np.isfinite(part)
            with np.errstate(over="ignore", invalid="ignore"):
                known = np.where(there, part, 0.0)
                moments = np.mean([known, known * late, known**2], axis=1)
            whole.update(f"{name} {part.shape} {there.sum(axis=0).tolist()}".encode())
            whole.update((np.round(moments, SAME_DECIMALS) + 0.0).tobytes())  # no zero below zero
    return whole.hexdigest()


def recording_digest(path: Path) -> str:
    """SHA-256 of a file; of a folder, the SHA-256 over the names and digests of the files directly in it.

    Parameters
    ----------
    path : Path
    """
    if not path.is_dir():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    whole = hashlib.sha256()
    for part in sorted(p for p in path.iterdir() if p.is_file()):
        whole.update(f"{part.name}\0{recording_digest(part)}\n".encode())
    return whole.hexdigest()
