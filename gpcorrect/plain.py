"""Values as JSON and TOML can hold them; of TOML the standard library is a reader only."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any


def json_ready(value: Any) -> Any:
    """Replace what JSON cannot hold (NaN, infinity, NumPy scalars and arrays, tuples) by what it can.

    Parameters
    ----------
    value : Any
        Mappings, lists, arrays and scalars, nested.
    """
    if isinstance(value, Mapping):
        return {str(k): json_ready(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(v) for v in value]
    if hasattr(value, "tolist"):
        return json_ready(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def quoted(text: str) -> str:
    """Write a string: JSON's escapes are TOML's, but for DEL, which TOML does not take as it is.

    Parameters
    ----------
    text : str
    """
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_text(document: Mapping[str, Any]) -> str:
    """Return TOML that `tomllib` reads back to the same values.

    Parameters
    ----------
    document : mapping
        Text, numbers, truth values, lists of these, tables, and lists of tables. Tables inside a table of the first
        level, or inside a list, are written inline.
    """
    plain, blocks = [], list[str]()
    for key, value in document.items():
        if isinstance(value, Mapping):
            blocks.append("\n".join([f"[{_key(key)}]", *(_line(k, v) for k, v in value.items())]))
        elif isinstance(value, Sequence) and value and all(isinstance(v, Mapping) for v in value):
            blocks += ["\n".join([f"[[{_key(key)}]]", *(_line(k, v) for k, v in table.items())]) for table in value]
        else:
            plain.append(_line(key, value))
    return "\n\n".join(["\n".join(plain), *blocks] if plain else blocks) + "\n"


def _line(key: str, value: Any) -> str:
    return f"{_key(key)} = {_value(value)}"


def _key(key: str) -> str:
    bare = key.replace("_", "").replace("-", "").isalnum() and key.isascii()
    return key if bare else quoted(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_line(k, v) for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(_value, value)) + "]"
    return repr(value)  # int and float: Python's shortest exact form, also inf and nan, is TOML's
