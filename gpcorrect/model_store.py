"""A folder of models: which there are, which one is active, which were before; it survives a kill at any moment.

    models/<SHA-256>.gpc    the files, named after what they hold: never written twice, never changed
    store.json              names, order of arrival, active model and history of each kind

A file enters under another name, is synced and renamed; `store.json` is replaced in one rename. So a reader finds the
state of before or of after, whatever happens between, and a file that no state names is only a leftover.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from gpcorrect import artifact, joint_artifact
from gpcorrect.atomic import atomic_path, make_folder
from gpcorrect.errors import ArtifactError, DataError, GpCorrectError

__all__ = ["KINDS", "Entry", "ModelStore", "kind_of"]

SCHEMA = 1
KINDS = {"pose": artifact.KIND, "joints": joint_artifact.JOINT_KIND}
LONGEST_HISTORY = 50
SHORTEST_PREFIX = 4


@dataclass(frozen=True)
class Entry:
    """One model: its name, the SHA-256 of its file, "pose" or "joints", and when it came (s since 1970)."""

    id: str
    hash: str
    kind: str
    added: float


@dataclass(frozen=True)
class _State:
    models: tuple[Entry, ...] = ()
    history: dict[str, tuple[str, ...]] = field(default_factory=dict)  # by kind: hashes, the active one last


class ModelStore:
    """The models of one arm.

    Parameters
    ----------
    folder : path
        Made at the first change.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def models(self) -> tuple[Entry, ...]:
        """Return the models, oldest first.

        Raises
        ------
        DataError
            The folder holds another thing, or something of a newer version.
        """
        return self._read().models

    def active(self, kind: str = "pose") -> Entry | None:
        """Return the active model of a kind, None where none was activated yet."""
        history = self.history(kind)
        return history[-1] if history else None

    def history(self, kind: str = "pose") -> tuple[Entry, ...]:
        """Return the models that were active, the present one last."""
        state = self._read()
        by_hash = {entry.hash: entry for entry in state.models}
        return tuple(by_hash[hash_] for hash_ in state.history.get(kind, ()))

    def path(self, entry: Entry) -> Path:
        """Return the file of a model."""
        return self.folder / "models" / f"{entry.hash}.gpc"

    def find(self, name: str) -> Entry:
        """Return the model of this name (the newest of several), or whose hash begins so.

        Raises
        ------
        DataError
            There is none, or the beginning fits several.
        """
        models = self.models()
        named = [entry for entry in models if entry.id == name]
        if named:
            return named[-1]
        fitting = [entry for entry in models if len(name) >= SHORTEST_PREFIX and entry.hash.startswith(name)]
        if len(fitting) == 1:
            return fitting[0]
        known = ", ".join(f"{entry.id} ({entry.hash[:12]})" for entry in models) or "none yet"
        what = "names no model" if not fitting else "fits several models"
        raise DataError(f"{name!r} {what} of {self.folder}.", hint=f"There are: {known}.")

    def add(self, path: str | Path, *, now: float, name: str = "") -> Entry:
        """Take a copy of a model file, verified and asked its check queries; one that is there already is only named.

        Raises
        ------
        ArtifactError
            The file is refused.
        GpCorrectError
            The store cannot be written.
        """
        kind = kind_of(path)
        load(path, kind)
        entry = Entry(name or Path(path).stem, artifact.model_hash(path), kind, now)
        with self._locked() as state:
            target = self.path(entry)
            if not target.exists():
                with _writing(target), atomic_path(target) as temporary:
                    shutil.copyfile(path, temporary)
            kept = tuple(one for one in state.models if one.hash != entry.hash)
            self._write(replace(state, models=(*kept, entry)))
        return entry

    def activate(self, entry: Entry) -> None:
        """Make a model the active one of its kind; its file is verified and asked its check queries first.

        Raises
        ------
        ArtifactError
            The file is refused; the active model stays.
        GpCorrectError
            The store cannot be written; the active model stays.
        """
        self.verified(entry)
        with self._locked() as state:
            history = state.history.get(entry.kind, ())
            if history[-1:] != (entry.hash,):
                changed = {**state.history, entry.kind: (*history, entry.hash)[-LONGEST_HISTORY:]}
                self._write(replace(state, history=changed))

    def rollback(self, kind: str = "pose") -> Entry:
        """Make the model active again that was before the present one, and return it.

        Raises
        ------
        DataError
            There was none before.
        """
        before = self.previous(kind)
        self.verified(before)
        with self._locked() as state:
            shorter = state.history[kind][:-1]
            self._write(replace(state, history={**state.history, kind: shorter}))
        return before

    def previous(self, kind: str = "pose") -> Entry:
        """Return the model that was active before the present one; raises as :meth:`rollback`."""
        history = self.history(kind)
        if len(history) < 2:
            raise DataError(
                f"there is no model of kind {kind} to go back to in {self.folder}.", hint="See: gpcorrect models list"
            )
        return history[-2]

    def verified(self, entry: Entry) -> Any:
        """Return the model of an entry, its file read whole, verified, and asked its check queries.

        Raises
        ------
        ArtifactError
            The file is refused, or is not the one that was added.
        """
        path = self.path(entry)
        model = load(path, entry.kind)
        if artifact.model_hash(path) != entry.hash:
            raise artifact.refused(path, "it is not the file that was added under this hash")
        return model

    def _read(self) -> _State:
        path = self.folder / "store.json"
        try:
            told = json.loads(path.read_text())
        except FileNotFoundError:
            return _State()
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise DataError(f"{path} cannot be read ({error}).", hint="Name the folder of a model store.") from error
        try:
            if told["schema"] > SCHEMA:
                raise DataError(f"{path} has schema {told['schema']}; this version reads up to {SCHEMA}.")
            models = tuple(Entry(**entry) for entry in told["models"])
            return _State(models, {kind: tuple(hashes) for kind, hashes in told["history"].items()})
        except (KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{path} is not the state of a model store ({error}).") from error

    def _write(self, state: _State) -> None:
        told = {"schema": SCHEMA, "models": [asdict(entry) for entry in state.models], "history": state.history}
        target = self.folder / "store.json"
        with _writing(target), atomic_path(target) as temporary:
            temporary.write_text(json.dumps(told, indent=2))
        _sync_folder(self.folder)

    @contextmanager
    def _locked(self) -> Iterator[_State]:
        """Give the state that no other process changes until the block ends."""
        make_folder(self.folder / "models")
        with _writing(self.folder), (self.folder / ".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield self._read()


def kind_of(path: str | Path) -> str:
    """Return what a model file corrects: "pose" or "joints".

    Raises
    ------
    ArtifactError
        It is none of these, or damaged.
    """
    refusal: ArtifactError | None = None
    for kind, name in KINDS.items():
        try:
            artifact.read_parts(path, name)
        except ArtifactError as error:
            refusal = refusal or error
        else:
            return kind
    assert refusal is not None
    raise refusal


def load(path: str | Path, kind: str) -> Any:
    """Read, verify and try a model file of a kind; raises as :func:`gpcorrect.artifact.load`."""
    return artifact.load(path) if kind == "pose" else joint_artifact.load_joint(path)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise GpCorrectError(
            f"cannot write {path}: {error.strerror}. The active model stays.", hint="Make room, or change the rights."
        ) from error


def _sync_folder(folder: Path) -> None:
    """Make a rename last through a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
