"""The one door for recordings: which format is it, and who reads it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs import c3d_file, csv_file, matlab, npy_file, parquet_file, rosbag
from gpcorrect.logs.columns import ColumnMap, load_columns
from gpcorrect.logs.digest import recording_digest
from gpcorrect.logs.mocap import motive, trc, vicon
from gpcorrect.logs.order import Disorder
from gpcorrect.logs.settings import DEFAULT_MAX_BYTES, ReadSettings
from gpcorrect.logs.sidecar import read_sidecar, sidecar_path
from gpcorrect.types import CalibrationLog, LogMeta

__all__ = ["read_log"]

HEAD = 1024  # bytes that tell a format


@dataclass(frozen=True)
class Format:
    """A file format: what its files are called, how they begin, and who reads them."""

    title: str
    suffixes: tuple[str, ...]
    marks: tuple[bytes, ...]
    read: Callable[[Path, ReadSettings], CalibrationLog]
    text: bool = False

    def begins(self, head: bytes) -> bool:
        """Whether a file with these first bytes is one; a text may begin with empty lines and a byte order mark."""
        seen = head.removeprefix(b"\xef\xbb\xbf").lstrip(b'\r\n ,;\t"') if self.text else head
        return any(seen.startswith(mark) for mark in self.marks)


def _titles(*titles: str) -> tuple[bytes, ...]:
    """Titles that stand alone in their line, or in its first cell."""
    return tuple(title.encode() + end for title in titles for end in (b"\r", b"\n", b",", b";", b"\t", b'"'))


FORMATS = (
    Format("Parquet", (".parquet", ".pq"), (b"PAR1",), parquet_file.read),
    Format("NumPy", (".npy",), (b"\x93NUMPY",), npy_file.read),
    Format("ROS 1 bag", (".bag",), (b"#ROSBAG V",), rosbag.read),
    Format("MCAP", (".mcap",), (b"\x89MCAP0\r\n",), rosbag.read),
    Format("ROS 2 database", (".db3",), (b"SQLite format 3\0",), rosbag.read),
    Format("MATLAB", (".mat",), matlab.MARKS, matlab.read),
    Format("OptiTrack Motive CSV", (), (b"Format Version,",), motive.read, text=True),
    Format("Vicon CSV", (), _titles(*vicon.TITLES), vicon.read, text=True),
    Format("TRC", (".trc",), (b"PathFileType",), trc.read, text=True),
    Format("C3D", (".c3d",), (), c3d_file.read),
    Format("CSV", (".csv", ".tsv", ".txt"), (), csv_file.read),
)
"""A new format is a new file with a `read` function, and one line here."""

FOLDER = Format("folder of a ROS 2 recording", (), (), rosbag.read)


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
        A CSV, Parquet, npy, bag, db3, MCAP, MATLAB, C3D or TRC file, an export of Motive or Vicon, or the folder of a
        ROS 2 recording.
    columns : str or Path, optional
        Mapping file for a foreign table; its sections [bag] and [mocap] say more about those formats.
    namespace : str, optional
        Which arm of a recording of CRTK topics, such as "/PSM1".
    tracker_topic : str, optional
        Topic of the outside tracker's pose; "" for none.
    arm : {"left", "right"}, optional
        Which arm of a recording of RAVEN-II state messages.
    max_bytes : int
        Largest table to read into memory.
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
    said = {"namespace": namespace, "tracker_topic": tracker_topic, "arm": arm}
    bag = mapping.bag.model_copy(update={k: v for k, v in said.items() if v is not None})
    settings = ReadSettings(mapping.model_copy(update={"bag": bag}), columns is not None, disorder, max_bytes)
    with _naming(source):
        log = _format(source).read(source, settings)
        meta = LogMeta() if columns and sidecar_path(source) == Path(columns) else read_sidecar(source)
        return replace(log, name=str(source), meta=_over(meta, log.meta), digest=recording_digest(source))


def _over(said: LogMeta, found: LogMeta) -> LogMeta:
    """Take what the sidecar says, and what the recording itself says where the sidecar does not."""
    return replace(found, **{name: value for name, value in asdict(said).items() if value})


def _format(path: Path) -> Format:
    """By how the file begins; by its name where the format has no mark."""
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return FOLDER
        raise LogError("expected a file or the folder of a ROS 2 recording, found no metadata.yaml in it.")
    with path.open("rb") as file:
        head = file.read(HEAD)
    for known in FORMATS:
        if known.begins(head):
            return known
    named = next((f for f in FORMATS if path.suffix.lower() in f.suffixes), None)
    if named is None:
        raise LogError(f"the name ends in {path.suffix or 'nothing'} and the content is unknown.", hint=_known())
    if named.marks and head:
        raise LogError(f"the name says {named.title}, but the file does not begin like one.", hint=_known())
    return named


def _known() -> str:
    formats = ", ".join(f"{f.title} ({', '.join(f.suffixes)})" if f.suffixes else f.title for f in FORMATS)
    return f"Known formats: {formats}, and the folder of a ROS 2 recording."


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the name of the file into every error on the way out."""
    try:
        yield
    except LogError as error:
        if error.path:
            raise
        raise LogError(error.message, hint=error.hint, path=str(path)) from error
    except DataError as error:
        raise LogError(error.message, hint=error.hint, path=str(path)) from error
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror or error}.", path=str(path)) from error
