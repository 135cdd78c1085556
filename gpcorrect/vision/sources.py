"""Where pictures come from: videos or folders of images, each read once and in order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
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
USUAL_FPS = 30.0  # frames a second where nothing says it: what webcams do


@dataclass(eq=False)
class Source:
    """One camera's pictures.

    Parameters
    ----------
    path : Path, the video, or the folder
    count : int, pictures that it says it has
    fps : float or None, pictures a second, where it says so
    times : (count,) array or None
        Seconds, where the names of the images are times.
    files : tuple of Path, the images; empty for a video
    read_so_far : int, pictures that were read, or tried
    unreadable : list of int, those that could not be read
    """

    path: Path
    count: int
    fps: float | None = None
    times: FloatArray | None = None
    files: tuple[Path, ...] = ()
    _video: Any = field(default=None, repr=False)
    read_so_far: int = 0
    unreadable: list[int] = field(default_factory=list)

    @property
    def ended(self) -> bool:
        """Whether no picture is left."""
        return self.read_so_far >= self.count

    def read(self) -> Image | None:
        """Return the next picture, or None when it cannot be read or none is left."""
        if self.ended:
            return None
        if self._video is None:
            image = cv2.imread(str(self.files[self.read_so_far]))
        else:
            good, image = self._video.read()
            if not good:  # a video cannot be read beyond a break: the rest of what its header says is not there
                image, self.count = None, self.read_so_far + 1
        if image is None:
            self.unreadable.append(self.read_so_far)
        self.read_so_far += 1
        return image

    def peek(self, index: int) -> Image | None:
        """Return one picture out of order; reading in order goes on as before.

        Parameters
        ----------
        index : int, from 0
        """
        if self._video is None:
            return cv2.imread(str(self.files[index])) if index < len(self.files) else None
        other = cv2.VideoCapture(str(self.path))
        other.set(cv2.CAP_PROP_POS_FRAMES, index)
        good, image = other.read()
        other.release()
        return image if good else None


def open_source(path: str | Path) -> Source:
    """Open a video file or a folder of images.

    Parameters
    ----------
    path : str or Path
        Images are taken in the order of the times or numbers in their names.

    Raises
    ------
    LogError
        There is nothing of that name, no image in the folder, or no video that can be opened.
    """
    path = Path(path)
    if path.is_dir():
        files = [file for file in path.iterdir() if file.suffix.lower() in IMAGES and not file.name.startswith(".")]
        if not files:
            raise LogError(
                "the folder holds no images.", path=str(path), hint=f"Known endings: {', '.join(sorted(IMAGES))}."
            )
        if all(STAMP.fullmatch(file.stem) for file in files):
            files.sort(key=lambda file: (float(file.stem), file.name))
            return Source(path, len(files), times=np.array([float(file.stem) for file in files]), files=tuple(files))
        numbers = re.compile(r"(\d+)")  # 2 before 10
        files.sort(key=lambda file: [int(p) if p.isdigit() else p for p in numbers.split(file.name)])
        return Source(path, len(files), files=tuple(files))
    if not path.is_file():
        raise LogError("there is no such video or folder of images.", path=str(path))
    video = cv2.VideoCapture(str(path))
    count = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
    if count <= 0:
        raise LogError(
            "it cannot be opened as a video: truncated, or of another kind.",
            path=str(path),
            hint="Copy it again, or convert it: ffmpeg -i VIDEO frames/%06d.png",
        )
    fps = float(video.get(cv2.CAP_PROP_FPS))
    return Source(path, count, fps if np.isfinite(fps) and fps > 0 else None, _video=video)


def open_sources(paths: Sequence[str | Path], names: Sequence[str]) -> list[Source]:
    """Open recordings, one a camera; a single folder of videos or of folders stands for what it holds.

    Parameters
    ----------
    paths : sequence of str or Path
        As :func:`open_source`.
    names : sequence of str
        Of the cameras: recordings in a folder that are named as they are put in their order, others in order of name.

    Raises
    ------
    LogError
        As :func:`open_source`.
    """
    folder = Path(paths[0])
    if len(paths) > 1 or not folder.is_dir():
        return [open_source(path) for path in paths]
    found = sorted(file for file in folder.iterdir() if file.suffix.lower() in VIDEOS or _holds_images(file))
    if not found:
        return [open_source(folder)]
    by_name = {file.stem: file for file in found}
    sources = [open_source(file) for file in ([by_name[n] for n in names] if set(names) <= set(by_name) else found)]
    if (folder / TIMES).is_file():
        table = np.genfromtxt(folder / TIMES, delimiter=",", names=True, deletechars="", replace_space=" ")
        for source in sources:
            if source.path.stem in (table.dtype.names or ()):
                source.times = np.atleast_1d(table[source.path.stem])[: source.count]
    return sources


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


def frame_times(sources: Sequence[Source], fps: float | None, count: int) -> FloatArray:
    """Return the times of the frames `(count,)`, s, from the images' names where these are times, else from a rate.

    Parameters
    ----------
    sources : sequence of Source
    fps : float or None, frames a second; the videos' own, or 30, when None
    count : int
    """
    if fps is None:
        stamped = next((s.times for s in sources if s.times is not None and len(s.times) == count), None)
        if stamped is not None and bool((np.diff(stamped) > 0).all()):
            return stamped
        fps = next((s.fps for s in sources if s.fps), USUAL_FPS)
    return np.arange(count) / fps
