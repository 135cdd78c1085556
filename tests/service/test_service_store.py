"""The store of models: whole before, whole after, whatever happens between."""

from __future__ import annotations

import errno
import io
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gpcorrect.calibration import CommandCorrector, ModelStore, compare, model_store
from gpcorrect.errors import ArtifactError, DataError, GpCorrectError
from gpcorrect_service import ServerSettings
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.protocol.messages import JSON, ActivateRequest
from gpcorrect_service.server.handlers import Admin
from gpcorrect_service.server.models import Active
from gpcorrect_service.server.requests import Clock, Request, RequestParser


@pytest.fixture
def store(tmp_path: Path, model_files: tuple[Path, Path]) -> ModelStore:
    made = ModelStore(tmp_path / "store")
    for when, path in enumerate(model_files):
        made.add(path, now=float(when))
    return made


def names(store: ModelStore) -> list[str]:
    return [entry.id for entry in store.history()]


def test_models_come_back_in_order(store: ModelStore, model_files: tuple[Path, Path]) -> None:
    """What was added is listed oldest first, under its file's name and hash, and its file is the one that was given."""
    monday, tuesday = store.models()
    assert [monday.id, tuesday.id] == ["monday", "tuesday"]
    assert store.path(monday).read_bytes() == model_files[0].read_bytes()
    assert store.find(tuesday.hash[:8]) == tuesday
    assert store.active() is None


def test_activation_and_rollback_are_inverse(store: ModelStore) -> None:
    """Activating twice and going back once leaves the first; the same model twice is once."""
    monday, tuesday = store.models()
    for entry in (monday, tuesday, tuesday):
        store.activate(entry)
    assert names(store) == ["monday", "tuesday"]
    assert store.rollback() == monday
    assert names(store) == ["monday"]
    with pytest.raises(DataError, match="go back"):
        store.rollback()


def test_a_name_that_is_none(store: ModelStore) -> None:
    """An unknown name is refused with those that there are."""
    with pytest.raises(DataError) as caught:
        store.find("sunday")
    assert "monday" in caught.value.hint


@pytest.mark.parametrize("damage", ["truncated", "flipped", "swapped", "gone"])
def test_a_damaged_model_is_not_activated(store: ModelStore, damage: str) -> None:
    """A file that was cut, changed, exchanged or lost in the store is refused, and the active one stays."""
    monday, tuesday = store.models()
    store.activate(monday)
    path = store.path(tuesday)
    whole = path.read_bytes()
    path.unlink()
    if damage == "truncated":
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "flipped":
        path.write_bytes(whole[:-5000] + bytes([whole[-5000] ^ 1]) + whole[-4999:])
    elif damage == "swapped":
        shutil.copyfile(store.path(monday), path)
    with pytest.raises(ArtifactError):
        store.activate(tuesday)
    assert names(store) == ["monday"]


@pytest.mark.parametrize("step", ["write", "sync", "rename"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS], ids=["full disk", "read-only disk"])
def test_a_disk_that_takes_nothing_changes_nothing(
    step: str, code: int, store: ModelStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever step of an activation the disk refuses, the store is as it was, and says so."""
    monday, tuesday = store.models()
    store.activate(monday)

    def refuse(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    places = {"write": (Path, "write_bytes"), "sync": (os, "fsync"), "rename": (Path, "replace")}
    monkeypatch.setattr(*places[step], refuse)
    with pytest.raises(GpCorrectError, match=os.strerror(code)):
        store.activate(tuesday)
    monkeypatch.undo()
    assert names(store) == ["monday"]
    assert not list(store.folder.glob(".store*"))


# One process reads the libraries; each step is another's, a copy of it that is killed there.
KILLED = """
import os, sys
from pathlib import Path
from gpcorrect.calibration import ModelStore
def die(*_): os._exit(9)
def activate(step, folder):
    if step == "before the write": Path.write_bytes = die
    if step == "before the sync": os.fsync = die
    if step == "before the rename": Path.replace = die
    if step == "after the rename":
        rename = Path.replace
        Path.replace = lambda *paths: (rename(*paths), die())
    store = ModelStore(folder)
    store.activate(store.find("tuesday"))
for folder in map(Path, sys.argv[1:]):
    child = os.fork()
    if not child:
        activate(folder.name, folder)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9, folder.name
"""


def test_a_kill_at_any_step_leaves_a_whole_store(store: ModelStore, tmp_path: Path) -> None:
    """Killed at each step of an activation, the store holds the old or the new state, and works on."""
    monday, _ = store.models()
    store.activate(monday)
    steps = ("before the write", "before the sync", "before the rename", "after the rename")
    folders = [shutil.copytree(store.folder, tmp_path / step) for step in steps]
    subprocess.run([sys.executable, "-c", KILLED, *folders], timeout=120, check=True)
    for folder in folders:
        left = ModelStore(folder)
        assert names(left) == (["monday", "tuesday"] if folder.name == "after the rename" else ["monday"])
        assert len(left.models()) == 2
        left.activate(left.models()[1])
        left.rollback()
        assert names(left) == ["monday"]


def test_models_are_compared_by_what_they_command(store: ModelStore) -> None:
    """A model is not apart from itself; two fits differ in what they say and in what they command."""
    monday, tuesday = store.models()
    one, other = (store.verified(entry) for entry in (monday, tuesday))
    same = compare(one, one)
    assert same["differs"] == {}
    assert same["commands"] == {"queries": 2 * len(one.check_queries), "mean_mm": 0.0, "max_mm": 0.0, "max_deg": 0.0}
    apart = compare(one, other)
    assert "fit.n_train" in apart["differs"]
    assert 0.0 < apart["commands"]["mean_mm"] <= apart["commands"]["max_mm"]
    away = np.array([5.0, 0.0, 0.0])  # of a tracker that was moved across the room: no query of the one is the other's
    trained = replace(one.trained, low=one.trained.low + away, high=one.trained.high + away)
    moved = replace(one, check_queries=one.check_queries + np.r_[away, np.zeros(10)], trained=trained)
    assert compare(one, moved)["commands"]["queries"] == 2 * len(one.check_queries)


def test_an_activation_reads_its_model_once(store: ModelStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over the network a model file is read, and its check queries asked, once: before the store notes it."""
    reads, read = [], np.load
    monkeypatch.setattr(np, "load", lambda *given, **options: reads.append(given[0]) or read(*given, **options))
    active, logger = Active(), open_logger(io.StringIO())
    parser = RequestParser(active, ServerSettings(), logger, Clock())
    activate = Admin(parser, store).handlers()["admin/activate"]
    request = Request(JSON.encode(ActivateRequest("tuesday")), JSON.encoding("admin/activate"), b"", time.monotonic())
    assert not activate(request).is_error
    assert len(reads) == 1
    assert active.pose_model().id == names(store)[-1] == "tuesday"


def load(store: ModelStore) -> CommandCorrector:
    model = store.verified(store.models()[0])
    assert isinstance(model, CommandCorrector)
    return model


def test_the_state_of_a_newer_version_is_refused(store: ModelStore) -> None:
    """A store that a newer version wrote is not guessed at."""
    (store.folder / "store.json").write_text('{"schema": 2}')
    with pytest.raises(DataError, match="schema 2"):
        store.models()
    assert model_store.SCHEMA == 1
