"""Parsers of compiled code run in a process of their own: what damaged bytes do there ends there, in words."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from read_support import START, assert_same_log, random_log, transforms, write, write_bag
from test_read_bag import robot

from gpcorrect.errors import LogError, MissingExtraError
from gpcorrect.logs import apart, parquet_file, read_log, reader, write_log
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.logs.contents import contents_of
from gpcorrect.types import CalibrationLog


def hangs(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Stand for a parser that loops for ever."""
    while True:
        pass


def crashes(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Stand for a parser that reads where no memory is."""
    ctypes.string_at(0)
    return random_log(0)


def devours(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Stand for a parser that believes a length."""
    np.ones(1 << 29)
    return random_log(0)


def stumbles(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Stand for a parser that raises what nobody foresaw."""
    raise KeyError("chunk")


def lacks(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Stand for a parser whose library is missing."""
    raise MissingExtraError("h5py", extra="matlab", purpose="Reading")


def talks(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Stand for a parser that prints."""
    sys.stdout.write("a warning\n")
    sys.stdout.flush()
    return random_log(3)


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (hangs, "the X file is damaged: reading it did not end within 4 s"),
        (crashes, r"the X file is damaged: it crashed its reader \(status -11\)\..*Copy it again"),
        (devours, r"the X file asks for more memory than a file of its size may\..*saved without compression"),
        (stumbles, "the X file cannot be read, it may be damaged or cut off: KeyError: 'chunk'"),
    ],
)
def test_whatever_a_parser_does_the_caller_goes_on_with_words(
    read: Callable[[Path, ReadSettings], CalibrationLog], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A loop, a crash, a request for 4 GB and a foreign exception all become errors of the log."""
    monkeypatch.setattr(apart, "PATIENCE", 4.0)
    with pytest.raises(LogError, match=said):
        apart.parse_apart(CalibrationLog, "X", read, write(tmp_path / "a", b"x"), ReadSettings())


def test_a_missing_library_is_named_with_its_extra(tmp_path: Path) -> None:
    """An error keeps its class, its words and what else it carries on the way out of the process."""
    with pytest.raises(MissingExtraError, match=r"h5py, which is not installed.*gpcorrect\[matlab\]") as caught:
        apart.parse_apart(CalibrationLog, "X", lacks, write(tmp_path / "a", b"x"), ReadSettings())
    assert caught.value.extra == "matlab"


def test_what_a_library_prints_is_no_part_of_the_recording(tmp_path: Path) -> None:
    """Standard output of the process carries the log alone."""
    assert_same_log(
        apart.parse_apart(CalibrationLog, "X", talks, write(tmp_path / "a", b"x"), ReadSettings()), random_log(3)
    )


def marks(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Stand for a parser that a recording leaves changed."""
    if hasattr(apart, "marked"):
        raise KeyError("marked")
    apart.marked = True  # type: ignore[attr-defined]
    return random_log(0)


def test_recordings_do_not_meet(tmp_path: Path) -> None:
    """What reading one recording changes is not there when the next one is read."""
    for name in ("a", "b"):
        apart.parse_apart(CalibrationLog, "X", marks, write(tmp_path / name, b"x"), ReadSettings())


def test_a_process_that_was_ended_is_started_again(tmp_path: Path) -> None:
    """Reading goes on when somebody has killed the process that is kept between recordings."""
    path = write(tmp_path / "a", b"x")
    apart.parse_apart(CalibrationLog, "X", talks, path, ReadSettings())
    kept = apart._FORKER.process
    assert kept is not None
    kept.kill()
    assert_same_log(apart.parse_apart(CalibrationLog, "X", talks, path, ReadSettings()), random_log(3))
    assert apart._FORKER.process is not kept


def test_threads_and_forks_read_by_processes_of_their_own(tmp_path: Path) -> None:
    """Four threads and a fork of the program read at once, and each gets its own recording."""
    paths = [tmp_path / f"{seed}.parquet" for seed in range(5)]
    for seed, path in enumerate(paths):
        write_log(random_log(seed), path)

    def same(seed: int) -> bool:
        return all(np.array_equal(read_log(paths[seed]).time, random_log(seed).time) for _ in range(5))

    assert same(4)
    child = os.fork()
    if child == 0:
        os._exit(not same(4))
    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(same, range(4)))
    assert os.waitpid(child, 0)[1] == 0


def test_the_process_between_changes_nothing(tmp_path: Path) -> None:
    """A log read apart is the log read here: numbers, gaps, names, remarks."""
    write_log(random_log(1), tmp_path / "a.parquet")
    here = apart.parse("Parquet", parquet_file.read, tmp_path / "a.parquet", ReadSettings())
    there = apart.parse_apart(CalibrationLog, "Parquet", parquet_file.read, tmp_path / "a.parquet", ReadSettings())
    assert_same_log(here, there)
    assert here.remarks == there.remarks
    assert here.static == there.static


@pytest.mark.parametrize("look", [read_log, contents_of])
def test_a_parser_that_crashes_ends_neither_reading_nor_the_listing_of_contents(
    look: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is wanted of a recording that compiled code parses, its crash becomes words."""
    monkeypatch.setattr(reader, "FORMATS", (reader.Format("X", (".x",), (), crashes, libraries=("h5py",)),))
    with pytest.raises(LogError, match=r"a\.x: the X file is damaged: it crashed its reader"):
        look(write(tmp_path / "a.x", b"x"))


@pytest.mark.parametrize("look", [read_log, contents_of])
def test_a_chunk_that_unpacks_to_gigabytes_is_refused(
    look: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few hundred kilobytes that unpack to 3 GB are refused, by the file's size, and never taken in."""
    from rosbags.rosbag2 import storage_mcap

    bomb = storage_mcap.zstd.compress(bytes(1 << 26)) * 48
    made = storage_mcap.McapWriter.__init__

    def make(writer: storage_mcap.McapWriter, *given: object) -> None:
        made(writer, *given)
        writer.compression, writer.compressor = "zstd", lambda _: bomb

    monkeypatch.setattr(storage_mcap.McapWriter, "__init__", make)
    moving = transforms("/tf", [("a", "b", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))], START)
    forged = write_bag(tmp_path / "r", [*robot(), moving], "mcap")
    assert forged.stat().st_size < 1e6
    with pytest.raises(LogError, match=r"asks for more memory than a file of its size may"):
        look(forged)
