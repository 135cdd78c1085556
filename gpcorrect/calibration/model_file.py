"""The model file of every task: NumPy arrays plus a JSON header in one file; loading never runs code.

The file is a NumPy `.npz` archive (a zip, so a truncated file has no directory and a flipped bit fails its CRC). Its
`header` entry is JSON: schema, versions, the model's tree, the SHA-256 of every array, and answers that were recorded
at save time and are asked again at load time.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from gpcorrect.atomic import atomic_path, require_own
from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.history import Step
from gpcorrect.calibration.joints import JointCorrector
from gpcorrect.calibration.task import Corrector
from gpcorrect.calibration.tool_position import PositionEstimator
from gpcorrect.codec import pack, unpack
from gpcorrect.errors import ArtifactError, DataError
from gpcorrect.logs.copies import recalled
from gpcorrect.types import FloatArray

# 5: with the model's history. 6: with stops; memory and joints of poses are asked check queries too. 7: velocities of
# positions and of turns have stencils of their own
SCHEMA = 7
OLDEST = 4  # that is read: with where and how fast the training moved; files of before are fitted anew
TASKS: dict[str, type[Corrector]] = {t.TASK: t for t in (CommandCorrector, JointCorrector, PositionEstimator)}
USED = {
    "pose": "gpcorrect serve MODEL",
    "joints": "gpcorrect serve --joints MODEL, gpcorrect joint rezero, or learned anew from all recordings: joint fit",
    "tool_position": "gpcorrect vision evaluate MODEL LOG",
}
MADE = {"pose": "gpcorrect fit", "joints": "gpcorrect joint fit", "tool_position": "gpcorrect vision fit"}
CHECK_TOLERANCE = 1e-7  # m and rad: far below any sensor, far above rounding between processors and precisions
SLACK_BYTES = 1 << 20
"""By which an archive may unpack to more than it is long: models are stored, not compressed; chosen by hand."""

BEGINS = rb"PK\x03\x04.{26}header\.npy"  # an archive whose first entry is the header

Three = tuple[float, float, float]
PARTS: dict[str, Any] = {
    "robot": str | None,
    "arm": str | None,
    "method": str,
    "features": Sequence[str],
    "remarks": Sequence[str],
    "baseline": Sequence[float],
    "data": {"source": str, "sha256": str, "recordings": Sequence[str]},
    "fit": {"n_train": int, "n_trajectories": int, "dropped": Mapping[str, int], "seed": int},
}
"""Parts of a description that every fit writes, with their types."""
OPTIONAL: dict[str, Any] = {
    "joint_names": Sequence[str],
    "frames": {"input": str, "output": str},
    "training_region": {"position_min": Three, "position_max": Three},
}
"""Parts that are written of some tasks."""
KNOWN = {"contents": Sequence[str], "marks": str}  # of data and updates, in models of this version
UPDATE: dict[str, Any] = {"source": str, "sha256": str, "recordings": Sequence[str], "n_added": int, "keep": float}
"""Of each of the `updates`, where there are any."""

C = TypeVar("C", bound=Corrector)
Arrays = dict[str, FloatArray]
Header = dict[str, Any]


def require_model_place(path: str | Path) -> None:
    """Check, before the work, that a model file can be written, and replaces nothing but a model file.

    Parameters
    ----------
    path : str or Path, the file to come

    Raises
    ------
    GpCorrectError
        The folder cannot be written, or another file is there.
    """
    require_own(path, BEGINS, "model file")


def save(corrector: Corrector, path: str | Path) -> None:
    """Write the model file atomically.

    Parameters
    ----------
    corrector : Corrector, of any task
    path : str or Path, file to write

    Raises
    ------
    GpCorrectError
        The folder cannot be written, or what is there is no model file.
    """
    require_model_place(path)
    model, arrays = pack(corrector, "model")
    header = {
        "model": model,
        "check": corrector.check_answers().tolist(),
        "kind": corrector.KIND,
        "schema": SCHEMA,
        "version": version("gpcorrect"),
        "digests": {name: _digest(array) for name, array in arrays.items()},
    }
    header = {**header, "seal": seal_of(header)}
    contents: dict[str, Any] = {"header": np.frombuffer(json.dumps(header, sort_keys=True).encode(), dtype=np.uint8)}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **contents, **arrays)


@overload
def load(path: str | Path) -> CommandCorrector: ...
@overload
def load(path: str | Path, kind: type[C]) -> C: ...
def load(path: str | Path, kind: type[Any] = CommandCorrector) -> Any:
    """Read a model file, verify it, and check its answers to the queries of the time it was saved.

    Parameters
    ----------
    path : str or Path, model file
    kind : type, task that it must be of; poses by default

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of another schema or task, not a model file, or answers otherwise than
        when it was saved.
    """
    return load_with_hash(path, kind)[0]


def load_any(path: str | Path) -> Any:
    """Read a model file of whatever task; raises as :func:`load`.

    Parameters
    ----------
    path : str or Path, model file
    """
    return load_with_hash(path)[0]


def load_with_hash(path: str | Path, kind: type[Corrector] | None = None) -> tuple[Any, str]:
    """Return a model and the hash of the very bytes that it was built from, though the file be replaced meanwhile.

    The hash is as of :func:`model_hash`; raises as :func:`load`.

    Parameters
    ----------
    path : str or Path, model file
    kind : type, optional, task that it must be of; any by default
    """
    content = _read(path)
    header, arrays = read_parts(path, content)
    found = next(task for task in TASKS.values() if header["kind"] == task.KIND)
    if kind is not None and found.TASK != kind.TASK:
        raise ArtifactError(
            f"model file {path} corrects {found.TASK}, and a model of {kind.TASK} is needed here.",
            hint=f"It is used by {USED[found.TASK]} (in Python load(path, gpcorrect.{found.__name__})). A model of "
            f"{kind.TASK} is made by {MADE[kind.TASK]}.",
        )
    try:
        with np.errstate(all="ignore"):  # forged numbers overflow; what comes of it is compared below
            corrector = unpack(kind or found, _as_now(header["model"]), arrays)
            _check_summary(corrector.summary)
            given = corrector.check_answers()
        expected = np.array(header.get("check"), dtype=np.float64)
    except Exception as error:  # whatever numbers of the wrong kind, shape or size make the code of a model raise
        raise refused(path, f"its contents do not form a model ({error})") from error
    if header["schema"] < SCHEMA:
        given = given[: len(expected)]
    if expected.shape != given.shape or not np.allclose(expected, given, rtol=0, atol=CHECK_TOLERANCE):
        raise refused(path, "it answers its own check queries otherwise than when it was saved")
    return corrector, hashlib.sha256(content).hexdigest()


def read_parts(path: str | Path, content: bytes | None = None) -> tuple[Header, Arrays]:
    """Read and verify header and arrays without building the model.

    Parameters
    ----------
    path : str or Path, model file
    content : bytes, optional, what it holds, where that was read already
    """
    contents = _unpacked(path, _read(path) if content is None else content)
    header = _header_in(path, contents)
    digests: dict[str, str] = header["digests"]
    if set(digests) != set(contents):
        raise refused(path, "arrays were added or removed")
    changed = [name for name, array in contents.items() if _digest(array) != digests[name]]
    if changed:
        raise refused(path, f"array {changed[0]} was altered")
    return header, contents


def read_history(path: str | Path) -> tuple[Step, ...]:
    """Return how a model was made, oldest step first, from its header alone; nothing in older files.

    Parameters
    ----------
    path : str or Path, model file
    """
    header = _header_in(path, _unpacked(path, _read(path), only="header"))
    try:
        history = unpack(tuple[Step, ...], header["model"].get("history", []), {})
    except Exception as error:  # as in load
        raise refused(path, f"its contents do not form a model ({error})") from error
    return history


def model_hash(path: str | Path) -> str:
    """Return the SHA-256 of the whole model file, hexadecimal: the identity that a service reports.

    Parameters
    ----------
    path : str or Path, model file
    """
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def seal_of(header: Header) -> str:
    """Return the SHA-256 of a header's own text, its `seal` left out: what shows that it was edited.

    Parameters
    ----------
    header : dict, JSON-able
    """
    text = json.dumps({name: value for name, value in header.items() if name != "seal"}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def refused(path: str | Path, why: str) -> ArtifactError:
    """Return the error for a model file that is not used.

    Parameters
    ----------
    path : str or Path
    why : str, reason, as a clause
    """
    return ArtifactError(
        f"model file {path} is refused: {why}.", hint="Copy it again from its source, or fit the model again."
    )


def _as_now(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tree of a model as it is written today: before schema 7 one stencil found all velocities."""
    if "velocity_step" not in tree:
        return dict(tree)
    step = tree["velocity_step"] or 0.0
    return {**{name: part for name, part in tree.items() if name != "velocity_step"}, "velocity_steps": [step, step]}


def _header_in(path: str | Path, contents: dict[str, Any]) -> Header:
    if "header" not in contents:
        raise refused(path, "it holds no header")
    try:
        header: Header = json.loads(contents.pop("header").tobytes().decode())
    except (ValueError, RecursionError) as error:
        raise refused(path, "its header is not JSON") from error
    if not isinstance(header, dict) or header.get("kind") not in [task.KIND for task in TASKS.values()]:
        raise refused(path, "it is not a model file of gpcorrect")
    schema = header.get("schema")
    if not isinstance(schema, int) or schema > SCHEMA:
        raise ArtifactError(
            f"model file {path} has schema {schema}; this version reads schemas {OLDEST} to {SCHEMA}.",
            hint=f"It was written by gpcorrect {header.get('version')}: upgrade, or fit the model again.",
        )
    if schema < OLDEST:
        raise ArtifactError(
            f"model file {path} has schema {schema}, from before every model knew its training's speed.",
            hint="Fit the model again.",
        )
    if header.get("seal") != seal_of(header):
        raise refused(path, "its header was altered")
    if not isinstance(header.get("digests"), dict):
        raise refused(path, "it carries no digests")
    return header


def _read(path: str | Path) -> bytes:
    """Return the file, once it is an archive: no recording of gigabytes is read whole to be refused."""
    if not Path(path).is_file():
        raise ArtifactError(f"there is no model file {path}.", hint="Fit one with: gpcorrect fit LOG --output MODEL")
    try:
        with Path(path).open("rb") as file:
            if not zipfile.is_zipfile(file):
                raise refused(path, "it is truncated, or no model file at all")
            file.seek(0)
            return file.read()
    except OSError as error:
        raise refused(path, f"it cannot be read ({error})") from error


def _unpacked(path: str | Path, content: bytes, only: str | None = None) -> dict[str, Any]:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as listing:
            unpacked = sum(entry.file_size for entry in listing.infolist())
        if unpacked > len(content) + SLACK_BYTES:
            raise refused(path, f"it would unpack to {unpacked / 1e6:.0f} MB, more than it is long")
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            contents = {name: archive[name] for name in archive.files if only in (None, name)}
        if not all(isinstance(part, np.ndarray) for part in contents.values()):  # NumPy hands out other bytes as such
            raise refused(path, "it is truncated or altered")
        return contents
    except ArtifactError:
        raise
    except Exception as error:  # whatever damaged bytes make the readers of archives and arrays raise
        raise refused(path, "it is truncated or altered") from error


def _digest(array: FloatArray) -> str:
    layout = f"{array.dtype.str}{array.shape}".encode()
    return hashlib.sha256(layout + np.ascontiguousarray(array).tobytes()).hexdigest()


def _check_summary(summary: Mapping[str, Any]) -> None:
    """Refuse a description, read from a file, that the programs which show or follow it cannot read."""
    if not summary:
        return
    _check(PARTS, summary, "its description")
    _check({name: part for name, part in OPTIONAL.items() if name in summary}, summary, "its description")
    updates = summary.get("updates", [])
    if not isinstance(updates, list):
        raise DataError("its updates are no list.")
    for update in updates:
        _check(UPDATE, update, "one of its updates")
    for entry in (summary["data"], *updates):
        _check({name: part for name, part in KNOWN.items() if name in entry}, entry, "what it says of its data")
        recalled(entry.get("marks", ""))


def _check(parts: Mapping[str, Any], found: Any, where: str) -> None:
    if not isinstance(found, Mapping):
        raise DataError(f"{where} is no table.")
    for name, hint in parts.items():
        if name not in found:
            raise DataError(f"{where} does not say its {name}.")
        if isinstance(hint, dict):
            _check(hint, found[name], f"{where}, {name},")
        else:
            unpack(hint, found[name], {})
