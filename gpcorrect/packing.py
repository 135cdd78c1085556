"""Takes trees of frozen dataclasses apart into JSON and named arrays, and puts them together again.

What a tree may hold is written in its type hints: numbers, text, None, arrays, tuples, dicts, and other
dataclasses. Only
classes that the hints name are ever built.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from gpcorrect.errors import DataError

__all__ = ["pack", "unpack"]

T = TypeVar("T")
Arrays = dict[str, Any]
ARRAY = "array:"  # marks, in the JSON, where an array stood


def pack(value: Any, prefix: str) -> tuple[Any, Arrays]:
    """Return `value` as JSON-able data and the arrays it held, named below `prefix`."""
    if isinstance(value, np.ndarray):
        return ARRAY + prefix, {prefix: value}
    if is_dataclass(value) and not isinstance(value, type):
        return _pack_items({f.name: getattr(value, f.name) for f in fields(value) if f.init}, prefix)
    if isinstance(value, Mapping):
        return _pack_items({str(k): v for k, v in value.items()}, prefix)
    if isinstance(value, tuple | list):
        parts, arrays = _pack_items({str(i): v for i, v in enumerate(value)}, prefix)
        return list(parts.values()), arrays
    return (value.item() if isinstance(value, np.generic) else value), {}


def _pack_items(items: Mapping[str, Any], prefix: str) -> tuple[dict[str, Any], Arrays]:
    data: dict[str, Any] = {}
    arrays: Arrays = {}
    for name, item in items.items():
        data[name], found = pack(item, f"{prefix}.{name}")
        arrays.update(found)
    return data, arrays


def unpack(hint: type[T], data: Any, arrays: Mapping[str, Any]) -> T:
    """Rebuild what :func:`pack` took apart, as the type hint `hint` says.

    Raises
    ------
    DataError
        The data are not what the hint says.
    """
    value: T = _unpack(hint, data, arrays)
    return value


def _unpack(hint: Any, data: Any, arrays: Mapping[str, Any]) -> Any:
    if isinstance(data, str) and data.startswith(ARRAY):
        return _array(data.removeprefix(ARRAY), arrays)
    if is_dataclass(hint):
        return _dataclass(hint, data, arrays)
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return None if data is None else _unpack(next(a for a in inner if a is not types.NoneType), data, arrays)
    if origin is tuple:
        kinds = inner[:1] * len(data) if Ellipsis in inner else inner
        return tuple(_unpack(kind, item, arrays) for kind, item in zip(kinds, data, strict=True))
    if origin is typing.Literal or data is None or isinstance(data, bool | int | float | str | dict | list):
        return data
    raise DataError(f"cannot rebuild {hint} from {type(data).__name__}.")


def _array(name: str, arrays: Mapping[str, Any]) -> Any:
    if name not in arrays:
        raise DataError(f"the array {name} is missing.")
    value = np.array(arrays[name])
    value.setflags(write=False)
    return value


def _dataclass(kind: Any, data: Any, arrays: Mapping[str, Any]) -> Any:
    hints = get_type_hints(kind)
    names = [f.name for f in fields(kind) if f.init]
    if not isinstance(data, dict) or set(data) != set(names):
        raise DataError(f"the stored {kind.__name__} does not have the fields {', '.join(names)}.")
    return kind(**{name: _unpack(hints[name], data[name], arrays) for name in names})
