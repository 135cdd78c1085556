"""A folder of models: which there are, which one is active, which were before; it survives a kill at any moment.

    models/<SHA-256>.gpc    the files, named after what they hold: never written twice, never changed
    store.json              names, order of arrival, active model and history of each kind; whether it is paused

A file enters under another name, is synced and renamed; `store.json` is replaced in one rename. So a reader finds the
state of before or of after, whatever happens between, and a file that no state names is only a leftover.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from gpcorrect.atomic import atomic_path, make_folder, write_file
from gpcorrect.calibration.history import Step
from gpcorrect.calibration.model_file import TASKS, load_with_hash, model_hash, read_history, refused
from gpcorrect.errors import ArtifactError, DataError, GpCorrectError

SCHEMA = 1  # of `store.json`
LONGEST_HISTORY = 50  # activations that can be rolled back; chosen by hand
HASH = re.compile("[0-9a-f]{64}")
SHORTEST_PREFIX = 4
"""Hexadecimal digits of a hash that may stand for a model: 65,536 beginnings separate the models of one arm."""

SAME = ("robot", "arm", "frames", "types", "direction", "input")
"""What a description must not say otherwise where both say it."""


@dataclass(frozen=True)
class Entry:
    """One model: its name, the SHA-256 of its file, its task, and when it came (s since 1970)."""

    id: str
    hash: str
    kind: str
    added: float


@dataclass(frozen=True)
class _State:
    models: tuple[Entry, ...] = ()
    history: dict[str, tuple[str, ...]] = field(default_factory=dict)  # by kind: hashes, the active one last
    paused: bool = False


class ModelStore:
    """The models of one arm.

    What reads a store raises DataError where the folder holds another thing, or something of a newer version; what
    changes it GpCorrectError where it cannot be written (the active model stays); what reads a model file ArtifactError
    where that is refused.

    Parameters
    ----------
    folder : path, made at the first change
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    @property
    def exists(self) -> bool:
        """Whether anything was written there: a folder that was taken away says nothing, and not that nothing is so."""
        return (self.folder / "store.json").exists()

    def models(self) -> tuple[Entry, ...]:
        """Return the models, oldest first."""
        return self._read().models

    def active(self, kind: str = "pose") -> Entry | None:
        """Return the active model of a kind, None where none was activated yet.

        Parameters
        ----------
        kind : str, task of the model
        """
        history = self.history(kind)
        return history[-1] if history else None

    def history(self, kind: str = "pose") -> tuple[Entry, ...]:
        """Return the models that were active, the present one last.

        Parameters
        ----------
        kind : str, task of the models
        """
        state = self._read()
        by_hash = {entry.hash: entry for entry in state.models}
        return tuple(by_hash[hash_] for hash_ in state.history.get(kind, ()))

    @property
    def paused(self) -> bool:
        """Whether an operator has paused the arm: its servers refuse corrections, those too that start later."""
        return self._read().paused

    def pause(self, *, paused: bool) -> None:
        """Note that the arm is paused, or goes on.

        Parameters
        ----------
        paused : bool
        """
        with self._locked() as state:
            if state.paused != paused:
                self._write(replace(state, paused=paused))

    def path(self, entry: Entry) -> Path:
        """Return the file of a model.

        Parameters
        ----------
        entry : Entry
        """
        return self.folder / "models" / f"{entry.hash}.gpc"

    def made(self, entry: Entry) -> tuple[Step, ...]:
        """Return how a model was made, oldest step first; nothing where it is not known, or the file is damaged.

        Parameters
        ----------
        entry : Entry
        """
        try:
            return read_history(self.path(entry))
        except ArtifactError:  # said where the model is used
            return ()

    def find(self, name: str) -> Entry:
        """Return the model of this name (the newest of several), or whose hash begins so; a DataError without one.

        Parameters
        ----------
        name : str, or the beginning of a hash that fits no other
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

        Parameters
        ----------
        path : str or Path, model file
        now : float, time of arrival, s since 1970
        name : str, in the store; that of the file by default
        """
        model, digest = load_with_hash(path)
        entry = Entry(name or Path(path).stem, digest, model.TASK, now)
        with self._locked() as state:
            target = self.path(entry)
            if not target.exists():
                with _writing(target), atomic_path(target) as temporary:
                    shutil.copyfile(path, temporary)
                    if model_hash(temporary) != digest:
                        raise refused(path, "it was replaced while it was read")
            others = tuple(one for one in state.models if one.hash != entry.hash)
            self._write(replace(state, models=(*others, entry)))
        return entry

    def activate(self, entry: Entry, *, verified: bool = False, back: bool = False) -> None:
        """Make a model the active one of its kind; its file is verified and asked its check queries first.

        Raises ArtifactError too where the model means another thing than the active one, which stays.

        Parameters
        ----------
        entry : Entry
        verified : bool
            Whether the caller has just read it, and compared it with the one it follows: then it is not read again.
        back : bool, whether the active model is given up for the one before it: the next one back is then an older one
        """
        if not verified:
            new, before = self.verified(entry), self.active(entry.kind)
            try:
                old = None if before is None else self.verified(before)
            except ArtifactError:  # a damaged one must not stay for ever
                old = None
            if old is not None:
                refuse_other_use(entry.id, new.info(), old.info())
        with self._locked() as state:
            history = state.history.get(entry.kind, ())
            if history[-1:] == (entry.hash,):
                return
            given_up = back and history[-2:-1] == (entry.hash,)
            longer = history[:-1] if given_up else (*history, entry.hash)[-LONGEST_HISTORY:]
            self._write(replace(state, history={**state.history, entry.kind: longer}))

    def rollback(self, kind: str = "pose") -> Entry:
        """Make the model active again that was before the present one, and return it; raises DataError without one.

        Parameters
        ----------
        kind : str, task of the model
        """
        history = self.history(kind)
        if len(history) < 2:
            raise DataError(
                f"there is no model of kind {kind} to go back to in {self.folder}.", hint="See: gpcorrect models list"
            )
        before = history[-2]
        self.verified(before)
        self.activate(before, verified=True, back=True)
        return before

    def verified(self, entry: Entry) -> Any:
        """Return the model of an entry, its file read whole, verified, and asked its check queries.

        Parameters
        ----------
        entry : Entry
        """
        path = self.path(entry)
        model, digest = load_with_hash(path, TASKS[entry.kind])
        if digest != entry.hash:
            raise refused(path, "it is not the file that was added under this hash")
        return model

    def _read(self) -> _State:
        path = self.folder / "store.json"
        try:
            stored = json.loads(path.read_text())
        except FileNotFoundError:
            return _State()
        except (OSError, ValueError, RecursionError) as error:
            raise DataError(f"{path} cannot be read ({error}).", hint="Name the folder of a model store.") from error
        try:
            if stored["schema"] > SCHEMA:
                raise DataError(
                    f"{path} has schema {stored['schema']}; this version reads up to {SCHEMA}.",
                    hint="It was written by a newer gpcorrect: upgrade.",
                )
            models = tuple(Entry(**entry) for entry in stored["models"])
            state = _State(
                models, {kind: tuple(hashes) for kind, hashes in stored["history"].items()}, stored.get("paused", False)
            )
            _check_state(state)
            return state
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            if isinstance(error, DataError):
                raise
            hint = "Copy it again from where it was saved, or add the models to a new folder: gpcorrect models add."
            raise DataError(f"{path} is not the state of a model store ({error}).", hint=hint) from error

    def _write(self, state: _State) -> None:
        stored = {"schema": SCHEMA, **asdict(state)}
        target = self.folder / "store.json"
        with _writing(target):
            write_file(target, json.dumps(stored, indent=2))
        handle = os.open(self.folder, os.O_RDONLY)
        try:
            os.fsync(handle)  # so that the rename outlasts a power cut
        finally:
            os.close(handle)

    @contextmanager
    def _locked(self) -> Iterator[_State]:
        """Give the state that no other process changes until the block ends."""
        make_folder(self.folder / "models")
        with _writing(self.folder):
            # Never through a link: it could name any file of the user.
            lock = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX)
                yield self._read()
            finally:
                os.close(lock)


def _check_state(state: _State) -> None:
    """Refuse, with a ValueError, a state that was never written here: names of files are made of what it says."""
    tasks = {}
    for entry in state.models:
        texts = isinstance(entry.id, str) and isinstance(entry.hash, str) and HASH.fullmatch(entry.hash)
        if not texts or entry.kind not in TASKS or not isinstance(entry.added, int | float):
            raise ValueError(f"what it says of model {entry.id!r} is not what a store writes")
        tasks[entry.hash] = entry.kind
    if not isinstance(state.paused, bool):
        raise ValueError("it does not say whether the arm is paused")
    for kind, hashes in state.history.items():
        if any(tasks.get(hash_) != kind for hash_ in hashes):
            raise ValueError(f"its history of {kind!r} names a model that is not there")


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise GpCorrectError(
            f"cannot write {path}: {error.strerror}. The active model stays.", hint="Make room, or change the rights."
        ) from error


def refuse_other_use(name: str, new: Mapping[str, Any], old: Mapping[str, Any]) -> None:
    """Refuse a model that means another thing than the one it follows.

    Parameters
    ----------
    name : str, what to call the new model
    new, old : mapping, descriptions, as :meth:`gpcorrect.calibration.task.Corrector.info` gives them

    Raises
    ------
    ArtifactError
        It was learned on another arm, answers in other frames, or joints of another kind, of another signal, or in
        the other direction.
    """
    for what in SAME:
        one, other = old.get(what), new.get(what)
        if one and other and one != other:
            raise ArtifactError(
                f"model {name} has {what} {other}, the active model {one}.",
                hint="Activate a model of this arm and use; another arm has its own server, store and folder.",
            )
