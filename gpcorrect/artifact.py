"""The model file: NumPy arrays plus a JSON header in one file; loading never runs code.

The file is a NumPy `.npz` archive (a zip, so a truncated file has no directory and a flipped bit fails its CRC). Its
`header` entry is JSON: schema, versions, frames, units, features, fit report, the SHA-256 of every array, and check
queries whose answers were recorded at save time and are asked again at load time.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.atomic import atomic_path
from gpcorrect.corrector import CommandCorrector
from gpcorrect.errors import ArtifactError
from gpcorrect.types import FloatArray

__all__ = ["KIND", "SCHEMA", "load", "model_hash", "read_parts", "refused", "save", "seal_of", "write_parts"]

SCHEMA = 3  # 3: what cleaning learned holds its registration; files of 1 and 2 are refused
KIND = "gpcorrect.command_corrector"
CHECK_TOLERANCE = 1e-7  # m and rad: far below any sensor, far above rounding between processors and precisions

Arrays = dict[str, FloatArray]
Header = dict[str, Any]


def save(corrector: CommandCorrector, path: str | Path) -> None:
    """Write the model file atomically.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    header, arrays = corrector.to_parts()
    write_parts(path, KIND, {**header, "check": _check_answers(corrector, arrays)}, arrays)


def write_parts(path: str | Path, kind: str, header: Header, arrays: Arrays) -> None:
    """Write a model file of any kind atomically: its header gets kind, schema, version and digests.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    header = {
        **header,
        "kind": kind,
        "schema": SCHEMA,
        "version": version("gpcorrect"),
        "digests": {name: _digest(array) for name, array in arrays.items()},
    }
    header = {**header, "seal": seal_of(header)}
    text = np.frombuffer(json.dumps(header, sort_keys=True).encode(), dtype=np.uint8)
    contents: dict[str, Any] = {"header": text, **arrays}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **contents)


def seal_of(header: Header) -> str:
    """SHA-256 of a header's own text, its `seal` left out: what shows that it was edited."""
    text = json.dumps({name: value for name, value in header.items() if name != "seal"}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def load(path: str | Path) -> CommandCorrector:
    """Read a model file, verify it, and ask it its recorded check queries.

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of a newer schema, not a model file, or answers its check queries
        otherwise than when it was saved.
    """
    header, arrays = read_parts(path)
    try:
        corrector = CommandCorrector.from_parts(header, arrays)
    except (KeyError, TypeError, ValueError) as error:
        raise refused(path, f"its contents do not form a model ({error})") from error
    _verify_answers(path, corrector, header, arrays)
    return corrector


def read_parts(path: str | Path, kind: str = KIND) -> tuple[Header, Arrays]:
    """Read and verify header and arrays without building the model.

    Raises
    ------
    ArtifactError
        As for :func:`load`.
    """
    contents = _read_archive(path)
    if "header" not in contents:
        raise refused(path, "it holds no header")
    try:
        header = json.loads(contents.pop("header").tobytes().decode())
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise refused(path, "its header is not JSON") from error
    _check_header(path, header, kind)
    _check_digests(path, header["digests"], contents)
    return header, contents


def model_hash(path: str | Path) -> str:
    """SHA-256 of the whole model file, hexadecimal: the identity that a service reports."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read_archive(path: str | Path) -> dict[str, Any]:
    if not Path(path).is_file():
        raise ArtifactError(f"there is no model file {path}.", hint="Fit one with: gpcorrect fit LOG --output MODEL")
    try:
        if not zipfile.is_zipfile(path):
            raise refused(path, "it is truncated, or no model file at all")
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise refused(path, "it is truncated or altered") from error


def _check_header(path: str | Path, header: Any, kind: str) -> None:
    if not isinstance(header, dict) or header.get("kind") != kind:
        raise refused(path, f"it is not a {kind} file")
    schema = header.get("schema")
    if not isinstance(schema, int) or schema > SCHEMA:
        raise ArtifactError(
            f"model file {path} has schema {schema}; this version reads up to {SCHEMA}.",
            hint=f"It was written by gpcorrect {header.get('version')}: upgrade, or fit the model again.",
        )
    if header.get("seal") != seal_of(header):
        raise refused(path, "its header was altered")
    if schema < SCHEMA:
        raise ArtifactError(
            f"model file {path} has schema {schema}; this version reads {SCHEMA}.", hint="Fit the model again."
        )
    if not isinstance(header.get("digests"), dict):
        raise refused(path, "it carries no digests")


def _check_digests(path: str | Path, digests: dict[str, str], arrays: Arrays) -> None:
    if set(digests) != set(arrays):
        raise refused(path, "arrays were added or removed")
    changed = [name for name, array in arrays.items() if _digest(array) != digests[name]]
    if changed:
        raise refused(path, f"array {changed[0]} was altered")


def _digest(array: FloatArray) -> str:
    layout = f"{array.dtype.str}{array.shape}".encode()
    return hashlib.sha256(layout + np.ascontiguousarray(array).tobytes()).hexdigest()


def _check_answers(corrector: CommandCorrector, arrays: Arrays) -> list[list[float]]:
    return [_answer(corrector, query) for query in arrays["check_queries"]]


def _answer(corrector: CommandCorrector, query: FloatArray) -> list[float]:
    size = 7 if corrector.has_orientation else 3
    answer = corrector.correct(query[:size], query[7:])
    quaternion: list[float] = [] if answer.quaternion is None else answer.quaternion.tolist()
    return [float(v) for v in (*answer.position, *quaternion, *np.nan_to_num(answer.std))]


def _verify_answers(path: str | Path, corrector: CommandCorrector, header: Header, arrays: Arrays) -> None:
    expected = np.array(header.get("check"))
    given = np.array(_check_answers(corrector, arrays))
    if expected.shape != given.shape or not np.allclose(expected, given, rtol=0, atol=CHECK_TOLERANCE):
        raise refused(path, "it answers its own check queries otherwise than when it was saved")


def refused(path: str | Path, why: str) -> ArtifactError:
    """Return the error that says why a model file is not used."""
    return ArtifactError(
        f"model file {path} is refused: {why}.", hint="Copy it again from its source, or fit the model again."
    )
