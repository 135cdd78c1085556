from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from read_support import assert_same_log, random_log, write

from gpcorrect.errors import GpCorrectError, LogError
from gpcorrect.logs import read_log, write_log
from gpcorrect.logs.native import format_sidecar, read_sidecar
from gpcorrect.logs.reader import recording_digest
from gpcorrect.types import CalibrationLog, LogMeta, PoseSignal


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("seed", range(3))
def test_a_written_log_reads_back_as_the_same_numbers(tmp_path: Path, suffix: str, seed: int):
    log = random_log(seed)
    write_log(log, tmp_path / f"a{suffix}")
    assert_same_log(read_log(tmp_path / f"a{suffix}"), log)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_was_read_back_is_written_the_same(tmp_path: Path, suffix: str):
    write_log(random_log(0), tmp_path / f"a{suffix}")
    write_log(read_log(tmp_path / f"a{suffix}"), tmp_path / f"b{suffix}")
    assert recording_digest(tmp_path / f"a{suffix}") == recording_digest(tmp_path / f"b{suffix}")


def test_a_log_of_positions_reads_back_without_orientation(tmp_path: Path):
    zeros = np.zeros(2, dtype=np.int64)
    log = CalibrationLog(np.arange(2.0), zeros, zeros, tracker_cp=PoseSignal(np.ones((2, 3))))
    write_log(log, tmp_path / "a.csv")
    assert read_log(tmp_path / "a.csv").tracker_cp.quaternion is None
    assert not (tmp_path / "a.toml").exists()


def test_an_extra_column_never_takes_the_place_of_a_signal(tmp_path: Path):
    log = replace(random_log(0), extra={"time": np.full(20, -1.0), "own": np.ones(20)})
    write_log(log, tmp_path / "a.csv")
    back = read_log(tmp_path / "a.csv")
    np.testing.assert_array_equal(back.time, log.time)
    assert set(back.extra) == {"own"}


def test_an_old_sidecar_does_not_speak_for_a_new_log(tmp_path: Path):
    write_log(random_log(0), tmp_path / "a.csv")
    write_log(replace(random_log(1), meta=LogMeta()), tmp_path / "a.csv")
    assert read_log(tmp_path / "a.csv").meta == LogMeta()


def test_a_missing_folder_is_an_error_and_nothing_is_written(tmp_path: Path):
    with pytest.raises(GpCorrectError, match="cannot write"):
        write_log(random_log(0), tmp_path / "none" / "a.csv")
    assert list(tmp_path.iterdir()) == []


def test_another_ending_is_refused(tmp_path: Path):
    with pytest.raises(LogError, match=r"ending in \.csv or \.parquet, got a\.xlsx"):
        write_log(random_log(0), tmp_path / "a.xlsx")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_write_leaves_the_old_log_untouched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    target = tmp_path / "a.csv"
    write_log(random_log(0), target)
    before = sorted((p.name, p.read_bytes()) for p in tmp_path.iterdir())

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("gpcorrect.logs.native.csv.write_csv", full)
    with pytest.raises(GpCorrectError, match="No space left"):
        write_log(random_log(1), target)
    assert sorted((p.name, p.read_bytes()) for p in tmp_path.iterdir()) == before


TEXT = st.text(st.characters(codec="utf-8"), max_size=30)


@settings(max_examples=100, deadline=None)
@given(TEXT, TEXT, st.one_of(st.none(), st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 6)))
def test_every_sidecar_reads_back_as_written(tmp_path_factory: pytest.TempPathFactory, a: str, b: str, frame: tuple):
    meta = LogMeta(robot=a, notes=b, tracker_base=frame)
    folder = tmp_path_factory.mktemp("sidecar")
    (folder / "a.toml").write_text(format_sidecar(meta), encoding="utf-8", newline="")
    assert read_sidecar(folder / "a.csv") == meta


def test_unknown_keys_of_a_sidecar_are_passed_over(tmp_path: Path):
    write(tmp_path / "a.toml", 'robot = "dVRK"\nweather = "fine"\n')
    assert read_sidecar(tmp_path / "a.csv") == LogMeta(robot="dVRK")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot = ", "is not TOML"),
        ("robot = 3", "sidecar key robot"),
        (
            "[T_tracker_base]\ntranslation = [0, 0]\nrotvec = [0, 0, 0]",
            "sidecar key T_tracker_base.translation",
        ),
    ],
)
def test_a_bad_sidecar_is_refused_by_name(tmp_path: Path, text: str, message: str):
    write(tmp_path / "a.csv", "time,payload\n0,1\n")
    sidecar = write(tmp_path / "a.toml", text)
    with pytest.raises(LogError, match=message) as caught:
        read_log(tmp_path / "a.csv")
    assert caught.value.path == str(sidecar)


def test_the_digest_is_that_of_the_bytes_of_the_file(tmp_path: Path):
    data = b"time,payload\n0,1\n"
    assert read_log(write(tmp_path / "a.csv", data)).digest == hashlib.sha256(data).hexdigest()


def test_the_digest_of_a_folder_follows_its_contents_and_names(tmp_path: Path):
    write(tmp_path / "one", "1")
    first = recording_digest(tmp_path)
    write(tmp_path / "one", "2")
    second = recording_digest(tmp_path)
    (tmp_path / "one").rename(tmp_path / "two")
    assert len({first, second, recording_digest(tmp_path)}) == 3
