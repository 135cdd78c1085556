"""Recordings from cameras to a table of times: nothing is lost, written over, or taken for another recording's."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from vision_support import cameras_of

from gpcorrect.errors import DataError, GpCorrectError, LogError
from gpcorrect.vision import END_EFFECTOR, TrackSettings, open_source, open_sources, record, track
from gpcorrect.vision.opencv import cv2
from gpcorrect.vision.sources import Source, keep_numbers
from gpcorrect_studies.rendering import Stage

FRAMES, RATE = 12, 25.0


def _video(path: Path, frames: int = FRAMES, size: tuple[int, int] = (64, 48)) -> Path:
    """Write a video of noise."""
    writer, rng = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), RATE, size), np.random.default_rng(frames)
    for _ in range(frames):
        writer.write(rng.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8))
    writer.release()
    return path


@pytest.fixture
def videos(tmp_path: Path) -> list[str]:
    """Return two videos that stand for cameras."""
    return [str(_video(tmp_path / f"in{k}.avi")) for k in range(2)]


def _times(folder: Path) -> list[list[str]]:
    return [line.split(",") for line in (folder / "times.csv").read_text().splitlines()]


def test_video_files_are_recorded_by_their_own_rate(videos: Sequence[str], tmp_path: Path) -> None:
    """Not by the speed at which they are decoded; a second recording in the folder is refused, and the first stays."""
    assert record(videos, tmp_path / "run", 60.0) == FRAMES
    head, *rows = _times(tmp_path / "run")
    assert head == ["camera0", "camera1"]
    assert np.allclose(np.array(rows, float), np.arange(FRAMES)[:, None] / RATE, atol=1e-6)
    before = (tmp_path / "run" / "times.csv").read_bytes()
    with pytest.raises(GpCorrectError, match="holds a recording already"):
        record(videos, tmp_path / "run", 0.1)
    assert (tmp_path / "run" / "times.csv").read_bytes() == before
    assert record(videos, tmp_path / "short", 0.2) == 6


def test_a_recording_that_fails_keeps_its_times(videos: Sequence[str], tmp_path: Path) -> None:
    """What shows the pictures breaks down: the videos and their times end together."""

    def fail(_: object) -> None:
        raise RuntimeError("no monitor")

    with pytest.raises(RuntimeError, match="monitor"):
        record(videos, tmp_path / "run", 60.0, on_pictures=fail)
    sources = open_sources([tmp_path / "run"], ["front", "left"])
    assert [source.count for source in sources] == [1, 1]
    assert len(_times(tmp_path / "run")) == 2


def test_ctrl_c_ends_a_recording_and_keeps_it(tmp_path: Path) -> None:
    """A recording of long videos that is interrupted has as many times as pictures."""
    words = [str(_video(tmp_path / f"in{k}.avi", 1500, (640, 480))) for k in range(2)]
    run = tmp_path / "run"
    command = [sys.executable, "-m", "gpcorrect", "vision", "record", *words, "--output", str(run)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        end = time.monotonic() + 60.0
        while not (run / "camera1.avi").exists() and time.monotonic() < end:
            time.sleep(0.01)
        os.kill(process.pid, signal.SIGINT)
        process.communicate(timeout=60.0)
    assert process.returncode == 0
    sources = open_sources([run], ["front", "left"])
    assert sources[0].count == sources[1].count == len(_times(run)) - 1 < 1500


def test_tables_of_times_of_other_recordings_are_refused(videos: Sequence[str], tmp_path: Path) -> None:
    """Other names, other lengths, uneven lines, nothing at all, another moment; with a rate the table is left alone."""
    run = tmp_path / "run"
    record(videos, run, 60.0)
    rows = [f"{i / RATE}" for i in range(FRAMES)]
    for head, lines, words in (
        ("front,left", [f"{t},{t}" for t in rows], ["columns front, left", "camera0, camera1"]),
        ("camera0,camera1", [f"{t},{t}" for t in rows[:5]], ["5 times", "12 pictures"]),
        ("camera0,camera1", [*[f"{t},{t}" for t in rows[:-1]], rows[-1]], ["no table of times"]),
        ("camera0,camera1", [f"{t},soon" for t in rows], ["no table of times"]),
        ("", [], ["no table of times"]),
        ("camera0,camera1", [f"{t},{float(t) + 5.0}" for t in rows], ["5000 ms apart"]),
    ):
        (run / "times.csv").write_text("\n".join([head, *lines]))
        with pytest.raises(LogError) as refused:
            open_sources([run], ["front", "left"])
        assert all(word in str(refused.value) for word in words)
        assert [source.times for source in open_sources([run], ["front", "left"], timed=False)] == [None, None]
    (run / "times.csv").write_text("\n".join(["Camera0 , camera1", *[f"{t},{float(t) + 0.01}" for t in rows[:-1]]]))
    sources = open_sources([run], ["front", "left"])
    assert [source.count for source in sources] == [FRAMES - 1] * 2  # it broke off between a picture and its time
    assert sources[1].times is not None
    assert sources[1].times[1] == pytest.approx(1.0 / RATE + 0.01)


def test_names_of_whole_milli_micro_and_nanoseconds_are_times(tmp_path: Path) -> None:
    """Recorders name pictures 1551939954927515000.png too; five digits are a number, and say no time."""
    for digits in (19, 16, 13, 5):
        folder = tmp_path / str(digits)
        folder.mkdir()
        for i in range(3):
            name = f"{i:05d}" if digits == 5 else str((15_519_399_540 + 2 * i) * 10 ** (digits - 11))
            cv2.imwrite(str(folder / f"{name}.png"), np.zeros((4, 4, 3), np.uint8))
        times = open_source(folder).times
        assert times is None if digits == 5 else times is not None and np.allclose(np.diff(times), 0.2)


def _numbered(folder: Path, *numbers: Sequence[int]) -> list[Source]:
    """Return folders of as many cameras, whose images have these numbers."""
    for k, names in enumerate(numbers):
        (folder / f"cam{k}").mkdir()
        for number in names:
            (folder / f"cam{k}" / f"{number:05d}.png").touch()
    return [open_source(folder / f"cam{k}") for k in range(len(numbers))]


@pytest.mark.parametrize(
    ("numbers", "places"),
    [
        ((range(8), range(0, 8, 2)), (range(8), range(0, 8, 2))),  # half the rate
        ((range(0, 80, 10), (0, 20, 30, 70)), (range(8), (0, 2, 3, 7))),  # every tenth was exported
        ((range(8), (3, 5, 6)), (range(8), (3, 5, 6))),  # begun later, with a gap
        ((range(8), range(1, 9)), (range(8), range(8))),  # counted from 1
        ((range(8), range(100, 108)), (range(8), range(8))),  # of another recording's numbers, no gap
    ],
)
def test_numbers_of_images_are_frames_however_many_are_missing(
    numbers: Sequence[Sequence[int]], places: Sequence[Sequence[int]], tmp_path: Path
) -> None:
    """Every image stands in the frame that its number says, whatever its camera lost."""
    sources = _numbered(tmp_path, *numbers)
    remarks = keep_numbers(sources)
    found = [[i for i, file in enumerate(source.files) if file is not None] for source in sources]
    assert found == [list(one) for one in places]
    assert len(remarks) == sum(None in source.files for source in sources)


@pytest.mark.parametrize("others", [(100, 101, 103, 104), (37, 68, 101, 134)])
def test_numbers_that_count_no_common_frames_are_refused(others: Sequence[int], tmp_path: Path) -> None:
    """Gaps in numbers of another range, or milliseconds: the numbers are named, as no picture says its frame."""
    with pytest.raises(LogError, match=rf"cam1 {others[0]}, {others[1]}, {others[2]} to {others[3]} \(4\)"):
        keep_numbers(_numbered(tmp_path, (0, 33, 67, 100) if others[0] == 37 else range(4), others))


def test_videos_in_a_folder_are_in_the_cameras_order(tmp_path: Path) -> None:
    """Names count whatever their case; without names of cameras, 2 comes before 10."""
    for k in (10, 2, 1):
        _video(tmp_path / f"camera{k}.avi", 2)
    found = open_sources([tmp_path], ["a", "b", "c"])
    assert [source.path.stem for source in found] == ["camera1", "camera2", "camera10"]
    found = open_sources([tmp_path], ["Camera10", "CAMERA1", "camera2"])
    assert [source.path.stem for source in found] == ["camera10", "camera1", "camera2"]
    assert open_sources([], ["a"]) == []


def test_what_a_header_leaves_out_is_seen(tmp_path: Path) -> None:
    """A video whose header says fewer pictures than it holds: it is noticed when all those are read."""
    data = bytearray(_video(tmp_path / "video.avi").read_bytes())
    for chunk, offset in ((b"strh", 40), (b"avih", 24)):
        at = data.find(chunk) + offset
        assert int.from_bytes(data[at : at + 4], "little") == FRAMES
        data[at : at + 4] = (5).to_bytes(4, "little")
    (tmp_path / "cut.avi").write_bytes(data)
    for name, more in (("video.avi", False), ("cut.avi", True)):
        source = open_source(tmp_path / name)
        while not source.ended:
            assert source.read() is not None
        assert source.goes_on() == more


def test_recordings_that_show_nothing_are_refused_in_words(tmp_path: Path) -> None:
    """One camera; pictures that cannot be read, without a first look at them."""
    cameras = cameras_of(Stage.standard(404, pieces=0))
    folders = [tmp_path / f"view{k}" for k in range(len(cameras))]
    for folder in folders:
        folder.mkdir()
        (folder / "0.png").write_bytes(b"no picture")
    sources = open_sources(folders, [camera.name for camera in cameras])
    with pytest.raises(LogError, match="no picture of view0, view1, view2, view3 can be read"):
        track(sources, cameras, END_EFFECTOR, TrackSettings(first_look=False))
    for first_look in (False, True):
        with pytest.raises(DataError, match="two cameras"):
            track(sources[:1], cameras[:1], END_EFFECTOR, TrackSettings(first_look=first_look))
