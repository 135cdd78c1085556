"""Logs out: the native table as CSV or Parquet, with its sidecar."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv, parquet

from gpcorrect.atomic import atomic_path, require_folder, write_file
from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs.sidecar import format_sidecar, sidecar_path
from gpcorrect.logs.table import INDEX, signal_columns
from gpcorrect.types import CalibrationLog, LogMeta


def require_writable(path: str | Path) -> None:
    """Check, before the work, that a log can be written.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    LogError
        The name ends in neither .csv nor .parquet.
    GpCorrectError
        The folder does not exist or cannot be written, or the file that the sidecar would replace is of no log.
    """
    target = Path(path)
    if target.suffix not in (".csv", ".parquet"):
        raise LogError(
            f"expected a name ending in .csv or .parquet, got {target.name}.",
            path=str(target),
            hint=f"Write {target.stem}.csv or {target.stem}.parquet.",
        )
    require_folder(target)
    beside = sidecar_path(target)
    if beside.exists() and not target.exists():
        raise GpCorrectError(
            f"{beside} is there already, and {target.name} would get its description under that name.",
            hint="Name another output, or move it away.",
        )


def write_log(log: CalibrationLog, path: str | Path) -> None:
    """Write a log that reads back as the same numbers, bit for bit; a missing number is an empty cell.

    The file appears whole or not at all. A sidecar NAME.toml beside it holds the meta data; it is written
    when there are any, or when an old one would otherwise speak for the new log.

    Parameters
    ----------
    log : CalibrationLog, the log; its extra columns are written too
    path : str or Path, ends in .csv or .parquet

    Raises
    ------
    LogError
        The name has another ending.
    GpCorrectError
        The folder does not exist or cannot be written.
    """
    target = Path(path)
    require_writable(target)
    columns: dict[str, NDArray[Any]] = {name: getattr(log, name) for name in (("session",) if log.static else INDEX)}
    columns |= signal_columns(log)
    columns |= {name: values for name, values in log.extra.items() if name not in (*columns, *INDEX)}
    table = pa.table({k: pa.array(np.ascontiguousarray(v), from_pandas=True) for k, v in columns.items()})
    with atomic_path(target) as temporary:
        if target.suffix == ".csv":
            csv.write_csv(table, temporary, csv.WriteOptions(quoting_style="needed"))
        else:
            parquet.write_table(table, temporary)
    beside = sidecar_path(target)
    if log.meta != LogMeta() or beside.exists():
        write_file(beside, format_sidecar(log.meta))
