"""How to read: mapping files, which columns of a foreign table are which signals in which units; and the settings."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StrictInt, StrictStr, ValidationError, model_validator

from gpcorrect.errors import LogError
from gpcorrect.logs.order import Disorder
from gpcorrect.logs.orientation import CONVERTERS

DEFAULT_MAX_BYTES = 2 * 1024**3  # largest table that is read into memory unless the caller allows more

Column = StrictStr | Annotated[StrictInt, Field(ge=0)]
"""A column by its name, or by its number counted from zero."""

EulerOrder = Literal["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]
"""Order of three turns, each about the axes of the body as the turns before left it."""

Triple = tuple[Column, Column, Column]
Four = tuple[Column, Column, Column, Column]
Nine = tuple[Column, Column, Column, Column, Column, Column, Column, Column, Column]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class PoseColumns(_Section):
    """Where a pose is: three columns of position, and at most one form of orientation.

    A scale alone, of the native columns or of what a recording without columns holds, leaves its orientation as it is.
    """

    position: Triple | None = None
    position_scale: float = 1.0
    quat_wxyz: Four | None = None
    quat_xyzw: Four | None = None
    rotvec: Triple | None = None
    rpy: Triple | None = None
    rpy_deg: Triple | None = None
    matrix: Nine | None = None

    @model_validator(mode="after")
    def _one_orientation(self) -> Self:
        if self.position is None and self.model_fields_set != {"position_scale"}:
            raise ValueError("give the columns of its position, or position_scale alone")
        given = [name for name in CONVERTERS if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"give one orientation, not {' and '.join(given)}")
        return self

    @property
    def orientation(self) -> tuple[str, tuple[Column, ...]] | None:
        """Form and columns of the orientation, None when the source measures positions only."""
        return next(((name, columns) for name in CONVERTERS if (columns := getattr(self, name)) is not None), None)


class ArrayColumns(_Section):
    """Where a joint or scalar signal is: value = column * scale + offset, each for itself or one for all."""

    columns: Annotated[tuple[Column, ...], Field(min_length=1)]
    scale: float | tuple[float, ...] = 1.0
    offset: float | tuple[float, ...] = 0.0

    @model_validator(mode="after")
    def _one_a_column(self) -> Self:
        for name in ("scale", "offset"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != len(self.columns):
                raise ValueError(f"{name} has {len(value)} numbers for {len(self.columns)} columns")
        return self


class CsvOptions(_Section):
    """How a text table is written; what is not given is taken from the file."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    skip: Annotated[int, Field(ge=0)] = 0
    header: bool | None = None
    names: tuple[str, ...] | None = None


class BagOptions(_Section):
    """What to take from a recording of ROS topics."""

    namespace: str | None = None
    tracker_topic: str | None = None
    arm: Literal["left", "right"] | None = None
    clock: Literal["header", "receive"] = "header"
    base: str | None = None
    max_gap: Annotated[float, Field(gt=0)] | None = None
    shifts: dict[str, float] = {}
    topics: dict[
        Literal["setpoint_cp", "measured_cp", "tracker_cp", "setpoint_js", "measured_js", "external_js"], str
    ] = {}


class MocapOptions(_Section):
    """What of a motion capture recording is the tool: a solved body, or the markers on it; and how it is turned."""

    body: str | None = None
    markers: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    rotation: Literal["rotvec"] | EulerOrder | None = None

    @model_validator(mode="after")
    def _one_tool(self) -> Self:
        if self.body is not None and self.markers is not None:
            raise ValueError("give the body or its markers, not both")
        return self


class ColumnMap(_Section):
    """A whole mapping file.

    `time * time_scale + time_offset` is in seconds; several columns of time are added, each scaled by its own.
    Without a column of time samples may follow each other at a rate, Hz. What is not named here, the time too, is
    looked for under its native name; a table of poses without any time holds static poses.
    """

    time: Column | Annotated[tuple[Column, ...], Field(min_length=1)] | None = None
    time_scale: float | tuple[float, ...] = 1.0
    time_offset: float = 0.0
    rate: Annotated[float, Field(gt=0)] | None = None
    trajectory: Column | None = None
    session: Column | None = None
    setpoint_cp: PoseColumns | None = None
    measured_cp: PoseColumns | None = None
    tracker_cp: PoseColumns | None = None
    setpoint_jp: ArrayColumns | None = None
    measured_jp: ArrayColumns | None = None
    measured_jv: ArrayColumns | None = None
    measured_jf: ArrayColumns | None = None
    external_jp: ArrayColumns | None = None
    payload: ArrayColumns | None = None
    temperature: ArrayColumns | None = None
    csv: CsvOptions = CsvOptions()
    bag: BagOptions = BagOptions()
    mocap: MocapOptions = MocapOptions()

    @model_validator(mode="after")
    def _one_time(self) -> Self:
        if self.rate is not None and self.time is not None:
            raise ValueError("give the time or a rate, not both")
        if isinstance(self.time_scale, tuple) and len(self.time_scale) != len(self.times):
            raise ValueError(f"time_scale has {len(self.time_scale)} numbers for {len(self.times)} columns of time")
        return self

    @model_validator(mode="after")
    def _scalars_have_one_column(self) -> Self:
        for name in ("payload", "temperature"):
            value = getattr(self, name)
            if value is not None and len(value.columns) != 1:
                raise ValueError(f"{name} is one column, not {len(value.columns)}")
        return self

    @property
    def times(self) -> tuple[Column, ...]:
        """Columns of the time; none where the mapping names none."""
        return self.time if isinstance(self.time, tuple) else () if self.time is None else (self.time,)

    @property
    def scales(self) -> dict[str, float]:
        """Scale of each pose of which nothing else is said."""
        poses = ((name, section) for name, section in self if isinstance(section, PoseColumns))
        return {name: pose.position_scale for name, pose in poses if pose.position is None}

    @property
    def used(self) -> tuple[Column, ...]:
        """All columns that are named."""
        named = [*self.times, *(c for c in (self.trajectory, self.session) if c is not None)]
        for _, section in self:
            if isinstance(section, ArrayColumns):
                named += section.columns
            elif isinstance(section, PoseColumns):
                named += [*(section.position or ()), *(section.orientation or ("", ()))[1]]
        return tuple(named)


@dataclass(frozen=True)
class ReadSettings:
    """How a recording is to be read."""

    columns: ColumnMap = field(default_factory=ColumnMap)  # the mapping; empty when none was given
    mapped: bool = False  # whether a mapping was given
    disorder: Disorder = "refuse"  # what to do about time that does not increase
    max_bytes: int = DEFAULT_MAX_BYTES  # largest table to read into memory

    def check_memory(self, needed: int) -> None:
        """Refuse a table that, unpacked, would not fit in memory.

        Parameters
        ----------
        needed : int, bytes that it takes
        """
        if needed > self.max_bytes:
            most = f"{self.max_bytes / 1e9:.3g} GB"
            hint = "Split it, or raise the limit in Python with max_bytes."
            raise LogError(f"expected a table of at most {most}, this one unpacks to more.", hint=hint)


def load_columns(path: str | Path) -> ColumnMap:
    """Read a mapping file.

    Parameters
    ----------
    path : str or Path, TOML, with the keys of :class:`ColumnMap`
    """
    try:
        with Path(path).open("rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise LogError(f"cannot read the mapping file: {error.strerror}.", path=str(path)) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise LogError(f"the mapping file is not TOML: {error}.", path=str(path)) from error
    try:
        return ColumnMap.model_validate(content)
    except ValidationError as error:
        raise _explain(error, str(path)) from error


def _explain(error: ValidationError, path: str) -> LogError:
    """Name the first key that is wrong, and the key that may have been meant."""
    first = error.errors()[0]
    where = tuple(str(part) for part in first["loc"] if not re.match(r"function-|tuple\[|float$", str(part)))
    key = ".".join(where)
    if first["type"] != "extra_forbidden":
        came = "" if isinstance(first["input"], dict) else f" (got {first['input']!r})"
        return LogError(f"key {key or 'of the file'}: {first['msg']}{came}.", path=path)
    sections: dict[str, type[BaseModel]] = {"csv": CsvOptions, "bag": BagOptions, "mocap": MocapOptions}
    signal = PoseColumns if where[0].endswith("_cp") else ArrayColumns
    known = list((ColumnMap if len(where) == 1 else sections.get(where[0], signal)).model_fields)
    near = get_close_matches(where[-1], known, n=1)
    hint = f"Did you mean {near[0]}?" if near else f"Known keys here: {', '.join(known)}."
    return LogError(f"unknown key {key}.", hint=hint, path=path)
