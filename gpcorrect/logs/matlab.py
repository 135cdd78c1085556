"""MATLAB files: version 5 to 7 through scipy, version 7.3 (HDF5) through h5py; and HDF5 files of other programs.

Variables and fields of structures become columns by their names; a matrix `q` of k columns becomes `q_1` to `q_k`.
Where one structure holds everything its name is left out. MATLAB may keep samples along either direction: it is the
one as long as most variables are. A native pose may be 3 x n, 7 x n (x y z qw qx qy qz) or 4 x 4 x n.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gpcorrect.errors import LogError, MissingExtraError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.orientation import CONVERTERS
from gpcorrect.logs.table import Table, log_from_table, pose_names
from gpcorrect.types import CalibrationLog, FloatArray

HDF5 = b"\x89HDF\r\n\x1a\n"  # first bytes of every such file
MARKS = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
NUMERIC = "iufb"  # kinds of NumPy types
HEADER_BYTES, TAG_BYTES, COMPRESSED = 128, 8, 15  # of a version 5 file: its head, a variable's, and what marks zlib
STEP_BYTES = 1 << 20  # unpacked at a time
# For files in which no variable has a row a sample.
NO_ROWS = 'Save one variable a signal, or columns named as in the native log: save("log.mat", "-struct", "log").'

Found = tuple[dict[str, np.ndarray[Any, Any]], list[str]]
"""Arrays of numbers by their dotted names, and the names of what holds none."""


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read the variables of a MATLAB file as columns."""
    with path.open("rb") as file:
        old = file.read(len(MARKS[0])) == MARKS[0]
    arrays, left_out = (_version_5 if old else _version_73)(path, settings)
    heads = {name.partition(".")[0] for name in arrays}
    if len(heads) == 1 and all("." in name for name in arrays):  # one structure holds everything
        arrays = {name.partition(".")[2]: values for name, values in arrays.items()}
    columns, odd = _columns(arrays)
    return log_from_table(Table(columns, "sample {}".format, (*left_out, *odd)), settings.columns, settings.disorder)


def _version_5(path: Path, settings: ReadSettings) -> Found:
    from scipy.io import loadmat

    settings.check_memory(_unpacked(path, settings.max_bytes))
    content = loadmat(path, squeeze_me=False, struct_as_record=True, verify_compressed_data_integrity=True)
    found = dict(_fields({k: v for k, v in content.items() if not k.startswith("__")}))
    arrays = {name: v for name, v in found.items() if isinstance(v, np.ndarray) and v.dtype.kind in NUMERIC}
    return arrays, [name for name in found if name not in arrays]


def _unpacked(path: Path, most: int) -> int:
    """Bytes that the compressed variables of a version 5 file unpack to, counted as far as `most`."""
    data, at, total = path.read_bytes(), HEADER_BYTES, 0
    order: Literal["little", "big"] = "little" if data[HEADER_BYTES - 2 : HEADER_BYTES] == b"IM" else "big"
    while at + TAG_BYTES <= len(data) and total <= most:
        kind, size = (int.from_bytes(data[at + k : at + k + 4], order) for k in (0, 4))
        rest, unpacker = data[at + TAG_BYTES : at + TAG_BYTES + size], zlib.decompressobj()
        while kind == COMPRESSED and rest and total <= most and not unpacker.eof:
            try:
                total += len(unpacker.decompress(rest, STEP_BYTES))
            except zlib.error:
                break  # damage is what the reader proper names
            rest = unpacker.unconsumed_tail
        at += TAG_BYTES + size
    return total


def _fields(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Variables and, dotted, the fields of structures."""
    for name, value in content.items():
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            record = value.reshape(-1)[0]
            yield from _fields({field: record[field] for field in value.dtype.names}, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _version_73(path: Path, settings: ReadSettings) -> Found:
    try:
        import h5py
    except ImportError as error:
        purpose = "Reading HDF5 and MATLAB files of version 7.3"
        raise MissingExtraError("h5py", extra="matlab", purpose=purpose) from error
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    left_out: list[str] = []
    total = 0

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        kind = item.attrs.get("MATLAB_class", b"double")
        dotted = name.replace("/", ".")
        nonlocal total
        total += int(item.size or 0) * 8  # bytes of a number
        settings.check_memory(total)
        if item.dtype.kind in NUMERIC and kind != b"char" and "MATLAB_empty" not in item.attrs:
            values = np.asarray(item[()])
            arrays[dotted] = values.T if "MATLAB_class" in item.attrs else values  # MATLAB's last direction comes first
        elif item.dtype.names:  # a table of named columns
            for field in item.dtype.names:
                if item.dtype[field].base.kind in NUMERIC:
                    arrays[f"{dotted}.{field}"] = np.asarray(item[field])
                else:
                    left_out.append(f"{dotted}.{field}")
        else:
            left_out.append(dotted)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return arrays, left_out


def _columns(arrays: Mapping[str, np.ndarray[Any, Any]]) -> tuple[dict[str, FloatArray], list[str]]:
    """Columns of the variables that have a value for every sample; the names of the others."""
    lengths = Counter(max(a.shape) for a in arrays.values() if a.size > 1)
    if not lengths:
        raise LogError("the file holds no variable with samples.", hint=NO_ROWS)
    count = max(lengths, key=lambda n: (lengths[n], n))
    columns: dict[str, FloatArray] = {}
    left_out: list[str] = []
    for name, values in arrays.items():
        # Samples lie along the last direction of three, or the first that is `count` long.
        directions = [d for d in range(values.ndim) if values.shape[d] == count]
        if not directions:
            left_out.append(name)
        else:
            along = 2 if values.ndim == 3 and 2 in directions else directions[0]
            columns |= _named(name, np.moveaxis(np.asarray(values, dtype=np.float64), along, 0))
    return columns, left_out


def _named(name: str, rows: FloatArray) -> dict[str, FloatArray]:
    """Columns of one variable: native ones for a pose, else numbered from one."""
    if name in CalibrationLog.POSES and rows.shape[1:] in ((3,), (7,), (4, 4)):
        if rows.ndim == 3:  # homogeneous transforms
            turned = CONVERTERS["matrix"](rows[:, :3, :3].reshape(len(rows), 9))
            rows = np.hstack([rows[:, :3, 3], turned])
        return dict(zip(pose_names(name), rows.T, strict=False))
    flat = rows.reshape(len(rows), -1)
    if flat.shape[1] == 1 and name not in CalibrationLog.JOINTS:
        return {name: flat[:, 0]}
    return {f"{name}_{k + 1}": flat[:, k] for k in range(flat.shape[1])}
