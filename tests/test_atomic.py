"""Files appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gpcorrect.atomic import atomic_path, make_folder, require_folder
from gpcorrect.errors import GpCorrectError


def test_an_error_half_way_leaves_the_old_file_and_no_litter(tmp_path: Path) -> None:
    """What was there stays, whatever the writer did before it failed."""
    target = tmp_path / "model.bin"
    target.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), atomic_path(target) as temporary:
        temporary.write_bytes(b"half" * (1 // 0))
    assert target.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["model.bin"]


def test_a_finished_file_replaces_the_old_one(tmp_path: Path) -> None:
    """The new contents stand under the name, alone."""
    target = tmp_path / "model.bin"
    target.write_bytes(b"old")
    with atomic_path(target) as temporary:
        temporary.write_bytes(b"new")
    assert target.read_bytes() == b"new"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    """The message names the output and what to do."""
    with pytest.raises(GpCorrectError, match="Create the folder first"), atomic_path(tmp_path / "no" / "model.bin"):
        pass


def test_what_is_no_file_is_never_replaced(tmp_path: Path) -> None:
    """A folder, or a device such as /dev/null, is refused before the work and stays what it was."""
    for target in (tmp_path, Path(os.devnull)):
        with pytest.raises(GpCorrectError, match="no file"), atomic_path(target):
            pass
    assert Path(os.devnull).is_char_device()


def test_a_folder_that_takes_no_file_is_found_before_the_work() -> None:
    """A folder in which no file can be made, here the kernel's own, is refused at once, whoever asks."""
    for require in (require_folder, make_folder):
        with pytest.raises(GpCorrectError, match="cannot write"):
            require(Path("/proc") if require is make_folder else Path("/proc/model.gpc"))
