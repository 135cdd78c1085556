"""NumPy files: structured arrays by name, plain arrays by column number."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.table import Table, log_from_table
from gpcorrect.types import CalibrationLog, FloatArray


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read an array, a row a sample; a field of k numbers counts as the columns `field_1` to `field_k`."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError as error:
        raise LogError(f"the array cannot be read: {error}.", hint="Arrays of objects are not read.") from error
    columns = _fields(array) if array.dtype.names else _numbered(array, settings.mapped)
    return log_from_table(Table(columns, "row {}".format), settings.columns, settings.disorder)


def _numbered(array: Any, mapped: bool) -> dict[str, FloatArray]:
    if array.ndim != 2 or array.dtype.kind not in "iuf":
        raise LogError(f"expected an (n, columns) array of numbers, got {array.dtype} of shape {array.shape}.")
    if not mapped:
        hint = "Give a mapping file with column numbers counted from 0, such as tracker_cp.position = [1, 2, 3]."
        raise LogError(f"an array of shape {array.shape} does not say which column is which.", hint=hint)
    return {str(k): array[:, k].astype(np.float64) for k in range(array.shape[1])}


def _fields(array: Any) -> dict[str, FloatArray]:
    columns: dict[str, FloatArray] = {}
    for name in array.dtype.names:
        field = array[name]
        if array.ndim != 1 or field.ndim > 2 or field.dtype.kind not in "iuf":
            raise LogError(f"expected fields of numbers, a row a sample, got {name} of {field.dtype} {field.shape}.")
        if field.ndim == 1:
            columns[name] = field.astype(np.float64)
        else:
            columns |= {f"{name}_{k + 1}": field[:, k].astype(np.float64) for k in range(field.shape[1])}
    return columns
