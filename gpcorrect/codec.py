"""Takes trees of frozen dataclasses apart into JSON and named arrays, and puts them together again.

What a tree may hold is written in its type hints: numbers, text, None, arrays, tuples, dicts, other dataclasses, and
unions of them, distinguished by the class name that is written with each. Only classes that the hints name, and their
subclasses, are ever built.
"""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from gpcorrect.errors import DataError

T = TypeVar("T")
Arrays = dict[str, Any]
ARRAY = "array:"  # marks, in the JSON, where an array stood
TYPE = "type"  # names the class of a dataclass; no field may be called so
PLAIN = (int, bool, str, types.NoneType)
"""Types that JSON holds as they are; a float may stand there as an integer."""
_hints = cache(get_type_hints)  # a third of the time that it takes to build a small model


def pack(value: Any, prefix: str) -> tuple[Any, Arrays]:
    """Return a tree as JSON-able data and the arrays it held.

    Parameters
    ----------
    value : Any
    prefix : str, under which the arrays are named
    """
    if isinstance(value, np.ndarray):
        return ARRAY + prefix, {prefix: value}
    if is_dataclass(value) and not isinstance(value, type):
        data, arrays = _pack_items({f.name: getattr(value, f.name) for f in fields(value) if f.init}, prefix)
        return {TYPE: type(value).__name__, **data}, arrays
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
    """Rebuild what :func:`pack` took apart.

    Parameters
    ----------
    hint : type
    data : JSON-able, from :func:`pack`
    arrays : mapping, likewise
    """
    value: T = _unpack(hint, data, arrays)
    return value


def _unpack(hint: Any, data: Any, arrays: Mapping[str, Any]) -> Any:
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return _unpack(_member(inner, data), data, arrays)
    if is_dataclass(hint):
        return _dataclass(hint, data, arrays)
    if origin is np.ndarray:
        return _array(hint, data, arrays)
    if origin in (tuple, Sequence) and isinstance(data, list):
        kinds = inner[:1] * len(data) if origin is Sequence or Ellipsis in inner else inner
        return tuple(_unpack(kind, item, arrays) for kind, item in zip(kinds, data, strict=True))
    if origin is Mapping and isinstance(data, dict):
        return {name: _unpack(inner[1], item, arrays) for name, item in data.items()}
    if hint is float and type(data) in (float, int):
        try:
            return float(data)
        except OverflowError as error:
            raise DataError("no floating-point number is as large as the stored integer.") from error
    if hint is Any or (data in inner if origin is Literal else hint in PLAIN and type(data) is hint):
        return data
    raise DataError(f"cannot rebuild {hint} from {type(data).__name__}.")


def _array(hint: Any, data: Any, arrays: Mapping[str, Any]) -> Any:
    name = data.removeprefix(ARRAY) if isinstance(data, str) and data.startswith(ARRAY) else ""
    if name not in arrays:
        raise DataError(f"the array {name or data} is missing.")
    value = np.array(arrays[name], order="C")  # compiled code is compiled anew, for seconds, for another order
    kind = get_args(get_args(hint)[1])[0]
    if value.dtype != kind:
        raise DataError(f"the array {name} holds {value.dtype}, expected {np.dtype(kind)}.")
    value.setflags(write=False)
    return value


def _member(members: tuple[Any, ...], data: Any) -> Any:
    """Return which of a union's members the data are of: the class that they name, or the only one that is no class."""
    if data is None and types.NoneType in members:
        return types.NoneType
    named = data.get(TYPE) if isinstance(data, dict) else None
    for member in members:
        if is_dataclass(member) and isinstance(member, type) and member.__name__ == named:
            return member
    others = [member for member in members if member is not types.NoneType and not is_dataclass(member)]
    if not others:
        raise DataError(f"the stored {named or type(data).__name__} is none of {members}.")
    return others[0]


def _dataclass(hint: Any, data: Any, arrays: Mapping[str, Any]) -> Any:
    named = data.get(TYPE) if isinstance(data, dict) else None
    kind = next((one for one in (hint, *hint.__subclasses__()) if one.__name__ == named), hint)
    hints = _hints(kind)
    names = {f.name: f for f in fields(kind) if f.init}
    needed = {name for name, f in names.items() if f.default is MISSING and f.default_factory is MISSING}
    if not isinstance(data, dict) or not {TYPE, *needed} <= set(data) <= {TYPE, *names} or named != kind.__name__:
        raise DataError(f"the stored {kind.__name__} does not have the fields {', '.join(names)}.")
    return kind(**{name: _unpack(hints[name], data[name], arrays) for name in names if name in data})
