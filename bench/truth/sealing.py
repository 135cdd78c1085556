"""Cases as files, the labels sealed apart: only their SHA-256 lies beside the recording."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gpcorrect.logs import write_log
from truth.spec import Case


def labels_bytes(labels: Mapping[str, Any]) -> bytes:
    """Labels as JSON, the same bytes for the same labels."""
    return json.dumps(labels, sort_keys=True, indent=1, allow_nan=False).encode()


def nominal_text(nominal: Mapping[str, Any]) -> str:
    """Return the tables of nominal.toml as text."""
    plain = [f"{k} = {_value(v)}" for k, v in nominal.items() if not isinstance(v, Mapping)]
    for name, table in nominal.items():
        if isinstance(table, Mapping):
            plain += ["", f"[{name}]", *(f"{k} = {_value(v)}" for k, v in table.items())]
    return "\n".join(plain) + "\n"


def write_case(case: Case, folder: Path, sealed: Path) -> str:
    """Write `log.csv`, `nominal.toml` and `labels.sha256` into a folder, and the labels to another file.

    Returns
    -------
    str
        The labels' SHA-256.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sealed.parent.mkdir(parents=True, exist_ok=True)
    write_log(case.log, folder / "log.csv")
    (folder / "nominal.toml").write_text(nominal_text(case.nominal), encoding="utf-8")
    content = labels_bytes(case.labels)
    digest = hashlib.sha256(content).hexdigest()
    (folder / "labels.sha256").write_text(digest + "\n", encoding="utf-8")
    sealed.write_bytes(content)
    return digest


def open_labels(folder: Path, sealed: Path) -> dict[str, Any]:
    """Labels of a case.

    Raises
    ------
    ValueError
        They are not those that were sealed beside the recording.
    """
    content = sealed.read_bytes()
    if hashlib.sha256(content).hexdigest() != (folder / "labels.sha256").read_text(encoding="utf-8").strip():
        raise ValueError(f"the labels in {sealed} are not those sealed in {folder}")
    labels: dict[str, Any] = json.loads(content)
    return labels


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value) if isinstance(value, str) else repr(value)
