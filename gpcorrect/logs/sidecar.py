"""The sidecar: a TOML file beside a log that says what robot and tracker made it."""

from __future__ import annotations

import tomllib
from dataclasses import asdict
from pathlib import Path

from pydantic import BaseModel, ConfigDict, StrictStr, ValidationError

from gpcorrect.errors import LogError
from gpcorrect.plain import toml_text
from gpcorrect.types import LogMeta


class _TrackerBase(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    translation: tuple[float, float, float]
    rotvec: tuple[float, float, float]


class _Sidecar(BaseModel):
    model_config = ConfigDict(extra="ignore")

    robot: StrictStr = ""
    arm: StrictStr = ""
    joint_types: StrictStr = ""
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
