"""Parquet tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.table import Table, log_from_table
from gpcorrect.types import CalibrationLog, FloatArray

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a Parquet table; a time stamp becomes seconds since 1970."""
    with parquet.ParquetFile(path) as file:
        settings.check_memory(file.metadata.num_rows * max(file.metadata.num_columns, 1) * 8)  # bytes of a number
        arrow = file.read()
    numbers = {name: _numbers(arrow.column(k)) for k, name in enumerate(arrow.column_names)}
    if len(numbers) < len(arrow.column_names):
        raise LogError("the table has more than one column of the same name.", hint="Rename them.")
    columns = {name: values for name, values in numbers.items() if values is not None}
    left_out = tuple(name for name, values in numbers.items() if values is None)
    return log_from_table(Table(columns, "row {}".format, left_out), settings.columns, settings.disorder)


def _numbers(column: Any) -> FloatArray | None:
    """Read a column of numbers, null as NaN; None when it holds something else."""
    kind = column.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        return np.asarray(_numbers(column.cast(pa.int64()))) * SECONDS[kind.unit]
    numeric = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind)
    if not numeric and not pa.types.is_decimal(kind):
        return None
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy())
