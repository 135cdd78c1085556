"""Text tables, with or without a header line; `#` comments; cells parted by a mark or by blanks.

Trajectory tables of public data sets are known by their columns, without a mapping file. TUM: time in s, position,
quaternion xyzw (Sturm et al. 2012, TUM RGB-D benchmark). EuRoC: header names, time in ns (Burri et al. 2016, EuRoC MAV
data sets). KITTI: the upper three rows of a homogeneous matrix, no time (Geiger et al. 2012, odometry benchmark).
JIGSAWS: 19 columns each of the master left and right and the slave left and right: tip position, rotation, velocities,
gripper, at 30 Hz (Gao et al. 2014, JHU-ISI gesture and skill assessment working set).
"""

from __future__ import annotations

import csv
import mmap
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ColumnMap, CsvOptions, PoseColumns, ReadSettings
from gpcorrect.logs.table import Table, complete, log_from_table
from gpcorrect.types import CalibrationLog, FloatArray

MISSING = ["", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None"]

DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")
LOOK_AHEAD = 20  # lines of data that are looked at for decimal commas, and to know a kind of trajectory
COMMENT = "#"
BYTE_ORDER_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
UNIT = 1e-2  # how far a quaternion's norm or a rotation may be off, to be known as one
JIGSAWS_RATE = 30.0  # Hz
JIGSAWS_ARMS = {"left": 38, "right": 57}  # first column of the slave manipulators
TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
EUROC = ("p_RS_R_x", "p_RS_R_y", "p_RS_R_z", "q_RS_w", "q_RS_x", "q_RS_y", "q_RS_z")


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a text table."""
    dialect, mapping = _sniff(path, settings.columns.csv), settings.columns
    known = None if mapping.used else _recognised(dialect, mapping)
    if known is not None:
        mapping = known[0]
    elif not settings.mapped and _numbered(dialect.names):
        hint = "Give a mapping file with column numbers from 0, such as tracker_cp.position = [1, 2, 3]."
        raise LogError(f"the first line holds {len(dialect.names)} numbers and no column names.", hint=hint)
    log = log_from_table(_table(dialect, mapping), mapping, settings.disorder)
    return log if known is None else replace(log, remarks=(known[1], *log.remarks))


def _table(dialect: Dialect, mapping: ColumnMap) -> Table:
    """All columns of numbers; columns of text are left out, unless the mapping needs them."""
    try:
        return _parse(dialect, ())
    except pa.ArrowInvalid as error:
        text = _text_columns(dialect, mapping)
        if not text:
            raise LogError(f"the table cannot be read: {error}.") from error
    return _parse(dialect, text)


def _parse(dialect: Dialect, without: tuple[str, ...]) -> Table:
    wanted = [name for name in dialect.names if name not in without]
    encoding = "utf8" if dialect.encoding.startswith("utf-8") else dialect.encoding
    source, skip = dialect.path, dialect.header_lines
    if dialect.cleaned:
        with dialect.lines() as lines:
            source, skip, encoding = pa.BufferReader("\n".join(text for _, text in lines).encode()), 0, "utf8"
    arrow = arrow_csv.read_csv(
        source,
        arrow_csv.ReadOptions(column_names=list(dialect.names), skip_rows=skip, encoding=encoding),
        arrow_csv.ParseOptions(delimiter=dialect.delimiter),
        arrow_csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pa.float64()),
            include_columns=wanted,
            null_values=MISSING,
            decimal_point=dialect.decimal,
        ),
    )
    columns = {name: arrow.column(name).to_numpy() for name in wanted}

    def _line(row: int) -> str:
        """Name the line that holds a sample, counted from one: an editor opens it there."""
        with dialect.records() as records:
            return f"line {next(islice((n for n, _ in records), row, None), None)}"

    return Table(columns, _line, without)


def _text_columns(dialect: Dialect, mapping: ColumnMap) -> tuple[str, ...]:
    """Columns with a cell that is no number."""
    used = complete(mapping, dialect.names)[0].used
    needed = {dialect.names[c] if isinstance(c, int) and c < len(dialect.names) else c for c in used}
    text: dict[str, None] = {}
    with dialect.records() as records:
        for line, cells in records:
            if len(cells) != len(dialect.names):
                commas = "Are there decimal commas? Say csv.delimiter and csv.decimal in a mapping file."
                hint = "The file may have been cut off." if len(cells) < len(dialect.names) else commas
                raise LogError(f"line {line} has {len(cells)} cells, expected {len(dialect.names)}.", hint=hint)
            for name, cell in zip(dialect.names, cells, strict=True):
                if name in text or cell in MISSING or _is_number(cell, dialect.decimal):
                    continue
                if name in needed:
                    comma = DECIMAL_COMMA.fullmatch(cell) is not None
                    hint = "Say csv.decimal = ',' in a mapping file." if comma else "Leave a missing cell empty."
                    raise LogError(f"column {name} must hold numbers, got {cell!r} at line {line}.", hint=hint)
                text[name] = None
    return tuple(text)


@dataclass(frozen=True)
class Dialect:
    """A text table's form."""

    names: tuple[str, ...]  # a name for every column
    header_lines: int  # lines of the file before the first sample
    # as in the file; the delimiter " " stands for any number of blanks
    delimiter: str
    decimal: str
    encoding: str
    path: Path
    comments: bool  # whether lines of the file begin with `#`

    @property
    def cleaned(self) -> bool:
        """Whether lines are changed, or left out, before they are parsed."""
        return self.comments or self.delimiter == " "

    @contextmanager
    def lines(self) -> Iterator[Iterator[tuple[int, str]]]:
        """Give an iterator over (line number, text) below the header, without comments, one blank for many."""
        with self.path.open(encoding=self.encoding, errors="replace") as file:
            below = ((n, line.strip("\r\n")) for n, line in enumerate(file, start=1) if n > self.header_lines)
            samples = ((n, line) for n, line in below if not line.lstrip().startswith(COMMENT))
            yield ((n, " ".join(line.split()) if self.delimiter == " " else line) for n, line in samples)

    @contextmanager
    def records(self) -> Iterator[Iterator[tuple[int, list[str]]]]:
        """Give an iterator over (line number, cells) of the samples, without empty lines."""
        if self.cleaned:
            with self.lines() as lines:
                cut = ((n, _cut(text, self.delimiter)) for n, text in lines)
                yield ((n, cells) for n, cells in cut if cells)
            return
        with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for _ in islice(file, self.header_lines):
                pass
            reader = csv.reader(file, delimiter=self.delimiter)
            yield ((self.header_lines + reader.line_num, cells) for cells in reader if cells)


def _is_number(cell: str, decimal: str) -> bool:
    """Whether a cell holds a number in this decimal mark; a missing one does not."""
    try:
        float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return False
    return "_" not in cell


def _sniff(path: Path, options: CsvOptions) -> Dialect:
    """Find out how a table is written, where the options do not say."""
    encoding = encoding_of(path)
    with path.open(encoding=encoding, errors="replace", newline="") as file:
        numbered = ((n, line.strip("\r\n")) for n, line in enumerate(file, start=1) if n > options.skip)
        comment, lines = _beginning((n, line) for n, line in numbered if line.strip())
    if not lines:
        raise LogError("expected a table, found no line of text.")
    number, first = lines[0]
    words = {len(text.split()) for _, text in lines}
    blanks = " " if len(words) == 1 and words.pop() > 1 else ","  # lines of as many words each, two or more
    delimiter = options.delimiter or next((d for d in "\t;," if d in first), None) or blanks
    rows = [_cut(text, delimiter) for _, text in lines]
    commas = delimiter != "," and any(DECIMAL_COMMA.fullmatch(cell) for row in rows for cell in row)
    decimal = options.decimal or ("," if commas else ".")
    numbers = all(cell.strip() == "" or _is_number(cell, decimal) for cell in rows[0])
    headed = not numbers if options.header is None else options.header
    if headed and len(lines) == 1:
        raise LogError("the table has column names but no samples.")
    above = _cut(comment.lstrip(f"{COMMENT} \t"), delimiter)
    if not headed and options.header is None and len(above) == len(rows[0]) > 1:  # names in a comment
        headed, number, rows[0] = True, number - 1, above
    found = tuple((cell.strip() or f"column_{k}") if headed else str(k) for k, cell in enumerate(rows[0]))
    names = options.names or found
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise LogError(f"the table has more than one column named {', '.join(twice)}.", hint="Rename them.")
    if len(names) != len(found):
        raise LogError(f"csv.names gives {len(names)} names, the table has {len(found)} columns.")
    with path.open("rb") as raw, mmap.mmap(raw.fileno(), 0, access=mmap.ACCESS_READ) as content:
        comments = bool(comment) or content.find(b"\n#") >= 0
    return Dialect(names, number if headed else number - 1, delimiter, decimal, encoding, path, comments)


def _beginning(lines: Iterator[tuple[int, str]]) -> tuple[str, list[tuple[int, str]]]:
    """Last comment above the table, "" for none, and the first lines of the table with their numbers."""
    comment, found = "", list[tuple[int, str]]()
    for number, line in lines:
        if not line.lstrip().startswith(COMMENT):
            found.append((number, line))
        elif not found:
            comment = line
        if len(found) > LOOK_AHEAD:
            break
    return comment, found


def _cut(text: str, delimiter: str) -> list[str]:
    return next(csv.reader([" ".join(text.split()) if delimiter == " " else text], delimiter=delimiter), [])


def encoding_of(path: Path) -> str:
    """Tell the encoding of a text file by its byte order mark; UTF-8 without one.

    Parameters
    ----------
    path : Path, any file
    """
    with path.open("rb") as file:
        head = file.read(4096)
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if head.startswith(mark):
            return encoding
    if b"\0" in head:
        raise LogError("expected a text table, found binary data.")
    return "utf-8"


def _recognised(dialect: Dialect, stated: ColumnMap) -> tuple[ColumnMap, str] | None:
    """Tell by its first samples what the columns of a known kind of table are, with a remark; None for other tables."""
    with dialect.records() as records:
        rows = [cells for _, cells in islice(records, LOOK_AHEAD) if len(cells) == len(dialect.names)]
    numbers = [[float(c) if _is_number(c, ".") else np.nan for c in (c.replace(",", ".") for c in row)] for row in rows]
    table = np.array(numbers, dtype=np.float64)
    for title, columns in KINDS.items() if rows else ():
        found = columns(dialect.names, table, stated)
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
        raise LogError("JIGSAWS kinematics hold two arms.", hint="Choose --arm left or right (in Python arm).")
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
