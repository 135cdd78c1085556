"""Where pictures come from: videos or folders of images, each read once and in order."""

from __future__ import annotations

import csv
import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.types import FloatArray
from gpcorrect.vision.opencv import Image, cv2

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm"}
VIDEOS = {".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm"}
TIMES = "times.csv"  # beside videos: when each picture was taken, s; a column a camera
STAMP = re.compile(r"\d+\.\d+")  # a file name that is a time in seconds, as recorders of ROS write them
# Of the numbers from the first to the last that images in any folder have: fewer are no frame numbers. Times of day
# (60 seconds of 100 numbers) and milliseconds have fewer; where each of four cameras lost half, 94 % remain.
LEAST_NUMBERED = 0.7
EPOCH = {13: 1e-3, 16: 1e-6, 19: 1e-9}  # s, the unit of a name of so many digits: a time since 1970, no number
USUAL_FPS = 30.0  # frames a second where nothing says it: what webcams do


@dataclass(eq=False)
class Source:
    """One camera's pictures.

    Parameters
    ----------
    path : Path, the video, or the folder
    count : int, pictures that it says it has
    fps : float or None, pictures a second, where it says so
    times : (count,) array or None, seconds, where the names of the images are times
    files : tuple of Path or None, the images; empty for a video, None for a frame without a picture
    read_so_far : int, pictures that were read, or tried
    unreadable : list of int, those that could not be read
    repeated : int, those that are the one before again
    """

    path: Path
    count: int
    fps: float | None = None
    times: FloatArray | None = None
    files: tuple[Path | None, ...] = ()
    _video: Any = field(default=None, repr=False)
    read_so_far: int = 0
    unreadable: list[int] = field(default_factory=list)
    repeated: int = 0
    _last: Image | None = field(default=None, repr=False)

    @property
    def ended(self) -> bool:
        """Whether no picture is left."""
        return self.read_so_far >= self.count

    def read(self) -> Image | None:
        """Return the next picture, or None when it cannot be read or none is left."""
        if self.ended:
            return None
        there = True
        if self._video is None:
            image, there = self.peek(self.read_so_far), self.files[self.read_so_far] is not None
        else:
            good, image = self._video.read()
            if not good:  # a video cannot be read beyond a break: the rest of what its header says is not there
                image, self.count = None, self.read_so_far + 1
        if there and image is None:
            self.unreadable.append(self.read_so_far)
        if image is not None:  # no sensor's noise is the same twice
            self.repeated += self._last is not None and np.array_equal(image, self._last)
            self._last = image
        self.read_so_far += 1
        return image

    def goes_on(self) -> bool:
        """Whether a video that was read as far as its header says holds more pictures; one is lost by asking."""
        return self._video is not None and self.ended and bool(self._video.grab())

    def peek(self, index: int) -> Image | None:
        """Return one picture out of order; reading in order goes on as before.

        Parameters
        ----------
        index : int, from 0
        """
        if self._video is None:
            file = self.files[index] if index < len(self.files) else None
            return None if file is None else cv2.imread(str(file))
        other = cv2.VideoCapture(str(self.path))
        other.set(cv2.CAP_PROP_POS_FRAMES, index)
        good, image = other.read()
        other.release()
        return image if good else None

    def again(self) -> Source:
        """Return the same recording, to be read from its beginning."""
        return replace(open_source(self.path), count=self.count, times=self.times, files=self.files)


def open_source(path: str | Path) -> Source:
    """Open a video file or a folder of images.

    Parameters
    ----------
    path : str or Path, whose images are taken in the order of the times or numbers in their names

    Raises
    ------
    LogError
        There is nothing of that name, no image in the folder, or no video that can be opened.
    """
    path = Path(path)
    if path.is_dir():
        files = [file for file in path.iterdir() if file.suffix.lower() in IMAGES and not file.name.startswith(".")]
        if not files:
            hint = f"Known endings: {', '.join(sorted(IMAGES))}."
            raise LogError("the folder holds no images.", path=str(path), hint=hint)
        times = {file: seconds for file in files if (seconds := _seconds(file.stem)) is not None}
        if len(times) == len(files):
            files.sort(key=lambda file: (times[file], file.name))
            return Source(path, len(files), times=np.array([times[file] for file in files]), files=tuple(files))
        files.sort(key=_in_order)
        return Source(path, len(files), files=tuple(files))
    if not path.is_file():
        raise LogError("there is no such video or folder of images.", path=str(path))
    video = cv2.VideoCapture(str(path))
    count = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
    if count <= 0:
        hint = "Copy it again, or convert it: ffmpeg -i VIDEO frames/%06d.png"
        raise LogError("it cannot be opened as a video: truncated, or of another kind.", path=str(path), hint=hint)
    fps = float(video.get(cv2.CAP_PROP_FPS))
    return Source(path, count, fps if np.isfinite(fps) and fps > 0 else None, _video=video)


def _seconds(name: str) -> float | None:
    """Return the time that a file name says, s."""
    if STAMP.fullmatch(name):
        return float(name)
    return int(name) * EPOCH[len(name)] if name.isdecimal() and len(name) in EPOCH else None


def open_sources(paths: Sequence[str | Path], names: Sequence[str], *, timed: bool = True) -> list[Source]:
    """Open recordings, one a camera; a single folder of videos or of folders stands for what it holds.

    Parameters
    ----------
    paths : sequence of str or Path, as :func:`open_source`
    names : sequence of str
        Of the cameras: recordings in a folder that are named as they are put in their order, others in order of name.
    timed : bool, whether the times of a folder's table are taken

    Raises
    ------
    LogError
        As :func:`open_source`; or the table is none of these recordings.
    """
    if len(paths) != 1 or not Path(paths[0]).is_dir():
        return [open_source(path) for path in paths]
    folder = Path(paths[0])
    found = [file for file in folder.iterdir() if file.suffix.lower() in VIDEOS or _holds_images(file)]
    if not found:
        return [open_source(folder)]
    by_name = {file.stem.lower(): file for file in found}
    named = [by_name[name.lower()] for name in names if name.lower() in by_name]
    sources = [open_source(file) for file in (named if len(named) == len(names) else sorted(found, key=_in_order))]
    if timed and (folder / TIMES).is_file():
        _take_times(sources, folder / TIMES)
    return sources


def _take_times(sources: Sequence[Source], path: Path) -> None:
    """Give pictures the times of a table that has a column a camera, named as its video, and a row a frame."""
    hint = f"Take the {TIMES} of this recording; or say the frames a second with --fps."
    cause = "it is no table of times: names, then lines of as many numbers."
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            head, *rows = [line for line in csv.reader(file) if line]
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(head))
    except ValueError as error:  # no line, lines of other lengths, other things than numbers
        raise LogError(cause, path=str(path), hint=hint) from error
    columns = dict(zip([name.strip().lower() for name in head], table.T, strict=True))
    of = [(source, columns[name]) for source in sources if (name := source.path.stem.lower()) in columns]
    names, pictures = ", ".join(source.path.stem for source in sources), max(source.count for source in sources)
    if not of:
        raise LogError(f"it has columns {', '.join(columns)}; the pictures are {names}.", path=str(path), hint=hint)
    if abs(len(table) - pictures) > 1:  # a recording may break off between a picture and its time
        raise LogError(f"it has {len(table)} times, the recording {pictures} pictures.", path=str(path), hint=hint)
    period = float(np.median(np.diff(of[0][1]))) if len(table) > 1 else np.inf
    for source, times in of:
        source.count = min(source.count, len(table))
        source.times = times[: source.count]
        if (late := abs(float(np.median(times - of[0][1])))) > period:
            raise LogError(
                f"{source.path.name} and {of[0][0].path.name} were looked at {1e3 * late:.0f} ms apart, more than from "
                "one frame to the next: pictures of one line are not of one moment.",
                path=str(path),
                hint="Leave out the pictures that the others lack, so that those of one moment have one number.",
            )


def _in_order(path: Path) -> list[tuple[int, str]]:
    """Sort 2 before 10."""
    return [(int(part or 0), "") if i % 2 else (0, part) for i, part in enumerate(re.split(r"(\d+)", path.name))]


def _holds_images(path: Path) -> bool:
    return path.is_dir() and any(file.suffix.lower() in IMAGES for file in path.iterdir())


def read_image(path: Path) -> Image:
    """Read one image.

    Parameters
    ----------
    path : Path
    """
    image = cv2.imread(str(path))
    if image is None:
        raise LogError("it cannot be read as an image.", path=str(path))
    return image


def pair_by_time(sources: Sequence[Source]) -> list[str]:
    """Pair images that are named by their times: at each of the first camera's, the nearest of every other's.

    Returns which frames lack pictures, in words; LogError where the times of two recordings have nothing in common.
    By their numbers, one picture that a recorder lost would put its camera a frame behind from there on.

    Parameters
    ----------
    sources : sequence of Source, changed in place; those without times in their names stay as they are
    """
    stamped = [(s, s.times) for s in sources if s.files and s.times is not None]
    if len(stamped) < 2 or stamped[0][0].count < 2:
        return []
    (first, times), *others = stamped
    remarks, reach = [], 0.5 * float(np.median(np.diff(times)))  # what is farther belongs to another frame
    for source, own in others:
        files: list[Path | None] = [None] * len(times)
        nearest = np.searchsorted(0.5 * (times[1:] + times[:-1]), own)
        for k in np.argsort(-np.abs(own - times[nearest])):  # the nearest last: it stays
            if abs(own[k] - times[nearest[k]]) <= reach:
                files[nearest[k]] = source.files[k]
        lacking = files.count(None)
        if lacking == len(files):
            raise LogError(
                f"no picture of {source.path.name} was taken at the time of one of {first.path.name}, by their names: "
                f"{own[0]:.3f} to {own[-1]:.3f} s, and {times[0]:.3f} to {times[-1]:.3f} s.",
                hint="Name them by the same clock; or pair them by number, with --fps.",
            )
        if lacking:
            remarks.append(
                f"{source.path.name} has no picture within {1e3 * reach:.0f} ms of {first.path.name}'s in {lacking} of "
                f"{len(files)} frames."
            )
        source.files, source.times, source.count = tuple(files), times, len(files)
    return remarks


def keep_numbers(sources: Sequence[Source]) -> list[str]:
    """Put images in the frames that the numbers in their names say; return in words which frames lack pictures.

    Taken one after the other, one picture that a recorder lost would put its camera a frame behind from there on.
    Folders without gaps that hold equally many images are paired one after the other, whatever their first numbers.

    Parameters
    ----------
    sources : sequence of Source
        Changed in place; those with times of their own, or whose names do not all have numbers, stay as they are.

    Raises
    ------
    LogError
        The numbers leave some out, and are none of common frames.
    """
    numbered = [(source, numbers) for source in sources if (numbers := _numbers(source))]
    if not numbered:
        return []
    every = sorted(set().union(*(numbers for _, numbers in numbered)))
    regular = len({after - before for _, n in numbered for before, after in itertools.pairwise(n)}) <= 1
    step = math.gcd(*(number - every[0] for number in every)) or 1
    shared = max(n[0] for _, n in numbered) <= min(n[-1] for _, n in numbered)
    shared = shared and len(every) >= LEAST_NUMBERED * len(range(every[0], every[-1] + 1, step))
    if regular and (not shared or len({len(n) for _, n in numbered}) == 1):
        return []
    if not shared:
        if all(numbers == every for _, numbers in numbered):
            return ["The numbers of the images are no frame numbers: taken one after the other."]
        said = "; ".join(f"{s.path.name} {', '.join(map(str, n[:3]))} to {n[-1]} ({len(n)})" for s, n in numbered)
        raise LogError(
            f"the numbers of the images leave some out, and are none of common frames: {said}.",
            hint="Give images of one moment one number, counting frames; or name them by their times (12.345.png, s).",
        )
    remarks = []
    for source, numbers in numbered:
        named = dict(zip(numbers, source.files, strict=True))
        source.files = tuple(named.get(number) for number in range(every[0], numbers[-1] + 1, step))
        source.count = len(source.files)
        if lacking := source.files.count(None):
            first = every[0] + step * source.files.index(None)
            words = f"lacks {lacking} of {source.count} pictures; the first is number {first}."
            remarks.append(f"{source.path.name} {words}")
    return remarks


def _numbers(source: Source) -> list[int]:
    """Return the last number in the name of each of a folder's images; none where they do not count up."""
    if source.times is not None:
        return []
    found = [re.findall(r"\d+", file.stem) for file in source.files if file is not None]
    numbers = [int(parts[-1]) for parts in found if parts]
    return numbers if len(numbers) == len(found) and all(a < b for a, b in itertools.pairwise(numbers)) else []


def frame_times(sources: Sequence[Source], fps: float | None, count: int) -> FloatArray:
    """Return the times of the frames `(count,)`, s, from the images' names where these are times, else from a rate.

    Parameters
    ----------
    sources : sequence of Source
    fps : float or None, frames a second; the videos' own, or 30, when None
    count : int

    Raises
    ------
    LogError
        The rate is none, or nothing says it: times that are too few or do not increase, videos of different rates.
    """
    hint = "Say the frames a second with --fps: pictures are then paired by number."
    if fps is None:
        stamped = [s.times for s in sources if s.times is not None]
        if stamped:
            times = next((t for t in stamped if len(t) == count), stamped[0])
            if len(times) != count or not (np.diff(times) > 0).all():
                raise LogError(f"the {len(times)} times of {count} frames are too few, or do not increase.", hint=hint)
            return times
        rates = {s.path.name: s.fps for s in sources if s.fps}
        # Paired by number, the last pictures are then more than half a frame apart.
        if rates and count * (1.0 - min(rates.values()) / max(rates.values())) > 0.5:
            said = ", ".join(f"{name} {rate:g}" for name, rate in rates.items())
            raise LogError(f"the videos have different frame rates: {said}. Convert them to one.", hint=hint)
        fps = next(iter(rates.values()), USUAL_FPS)
    if not (np.isfinite(fps) and fps > 0):
        raise LogError(f"frames a second are a number above zero; got {fps:g}.")
    return np.arange(count) / fps
