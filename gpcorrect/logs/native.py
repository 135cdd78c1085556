"""The native log out, as CSV or Parquet; and its sidecar, a TOML file beside it: what robot and tracker made it."""

from __future__ import annotations

import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv, parquet
from pydantic import BaseModel, ConfigDict, StrictStr, ValidationError

from gpcorrect.atomic import atomic_path, require_folder, write_file
from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs.table import INDEX, signal_columns
from gpcorrect.plain import toml_text
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

    Raises as :func:`require_writable`.

    The file appears whole or not at all. A sidecar NAME.toml beside it holds the meta data; it is written
    when there are any, or when an old one would otherwise speak for the new log.

    Parameters
    ----------
    log : CalibrationLog, the log; its extra columns are written too
    path : str or Path, ends in .csv or .parquet
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


class _TrackerBase(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    translation: tuple[float, float, float]
    rotvec: tuple[float, float, float]


class _Sidecar(BaseModel):
    model_config = ConfigDict(extra="ignore")

    robot: StrictStr = ""
    arm: StrictStr = ""
    joint_types: StrictStr = ""
    joint_names: tuple[StrictStr, ...] = ()
    tracker: StrictStr = ""
    notes: StrictStr = ""
    source: StrictStr = ""
    licence: StrictStr = ""
    T_tracker_base: _TrackerBase | None = None


def sidecar_path(path: Path) -> Path:
    """Where the sidecar of a log is.

    Parameters
    ----------
    path : Path
    """
    return path.with_suffix(".toml")


def read_sidecar(path: Path) -> LogMeta:
    """Read what the sidecar of a log says: nothing where there is none; unknown keys are passed over.

    Parameters
    ----------
    path : Path

    Raises
    ------
    LogError
        The sidecar is no TOML, or a key has a value of the wrong kind.
    """
    beside = sidecar_path(path)
    if not beside.is_file():
        return LogMeta()
    try:
        with beside.open("rb") as file:
            content = _Sidecar.model_validate(tomllib.load(file))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise LogError(f"the sidecar is not TOML: {error}.", path=str(beside)) from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise LogError(f"sidecar key {key}: {first['msg']}.", path=str(beside)) from error
    frame = content.T_tracker_base
    tracker_base = None if frame is None else (*frame.translation, *frame.rotvec)
    return LogMeta(**content.model_dump(exclude={"T_tracker_base"}), tracker_base=tracker_base)


def format_sidecar(meta: LogMeta) -> str:
    """TOML text that reads back as the same meta data.

    Parameters
    ----------
    meta : LogMeta
    """
    stated = {name: text for name, text in asdict(meta).items() if text}
    frame = stated.pop("tracker_base", None)
    if frame is not None:
        numbers = [float(x) for x in frame]
        stated["T_tracker_base"] = {"translation": numbers[:3], "rotvec": numbers[3:]}
    return toml_text(stated)
