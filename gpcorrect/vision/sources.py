"""Where pictures come from: videos, or folders of images; each read once, in order, and never trusted to be whole."""

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

__all__ = ["Source", "image_files", "open_source", "read_image"]

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm"}
STAMP = re.compile(r"\d+\.\d+")  # a file name that is a time in seconds, as recorders of ROS write them


@dataclass(eq=False)
class Source:
    """One camera's pictures.

    Parameters
    ----------
    path : Path
        The video, or the folder.
    count : int
        Pictures that it says it has.
    fps : float or None
        Pictures a second, where it says so.
    times : (count,) array or None
        Seconds, where the names of the images are times.
    files : tuple of Path
        The images; empty for a video.
    """

    path: Path
    count: int
    fps: float | None = None
    times: FloatArray | None = None
    files: tuple[Path, ...] = ()
    _video: Any = field(default=None, repr=False)
    _next: int = 0
    unreadable: list[int] = field(default_factory=list)

    @property
    def read_so_far(self) -> int:
        """Pictures that were read, or tried."""
        return self._next

    @property
    def ended(self) -> bool:
        """Whether no picture is left."""
        return self._next >= self.count

    def read(self) -> Image | None:
        """Return the next picture, or None when it cannot be read or none is left."""
        if self.ended:
            return None
        image = self._read_video() if self._video is not None else cv2.imread(str(self.files[self._next]))
        if image is None:
            self.unreadable.append(self._next)
        self._next += 1
        return image

    def _read_video(self) -> Image | None:
        good, image = self._video.read()
        if not good:  # a video cannot be read beyond a break: what it promised and does not hold is not there
            self.count = self._next + 1
            return None
        return image

    def peek(self, index: int) -> Image | None:
        """Return one picture out of order, for a first look; reading in order goes on as before."""
        if self._video is None:
            return cv2.imread(str(self.files[index])) if index < len(self.files) else None
        other = cv2.VideoCapture(str(self.path))
        other.set(cv2.CAP_PROP_POS_FRAMES, index)
        good, image = other.read()
        other.release()
        return image if good else None


def open_source(path: str | Path) -> Source:
    """Open a video file or a folder of images.

    Raises
    ------
    LogError
        There is nothing of that name, no image in the folder, or no video that can be opened.
    """
    path = Path(path)
    if path.is_dir():
        return _folder(path)
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


def _folder(path: Path) -> Source:
    files = image_files(path)
    if not files:
        raise LogError(
            "the folder holds no images.", path=str(path), hint=f"Known endings: {', '.join(sorted(IMAGES))}."
        )
    times = None
    if all(STAMP.fullmatch(file.stem) for file in files):
        times = np.array([float(file.stem) for file in files])
        order = np.argsort(times, kind="stable")
        files, times = [files[i] for i in order], times[order]
    return Source(path, len(files), None, times, tuple(files))


def image_files(path: Path) -> list[Path]:
    """Images of a folder in their natural order: 2 before 10."""
    files = [file for file in path.iterdir() if file.suffix.lower() in IMAGES and not file.name.startswith(".")]
    return sorted(files, key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file.name)])


def read_image(path: Path) -> Image:
    """Read one image.

    Raises
    ------
    LogError
        It cannot be read.
    """
    image = cv2.imread(str(path))
    if image is None:
        raise LogError("it cannot be read as an image.", path=str(path))
    return image


def frame_times(sources: Sequence[Source], fps: float | None, count: int) -> FloatArray:
    """Return times `(count,)` of the frames, s: the images' own names where they are times, else frames at a rate.

    The rate is `fps`, or the videos' own, or 30.
    """
    if fps is None:
        stamped = next((s.times for s in sources if s.times is not None and len(s.times) == count), None)
        if stamped is not None and bool((np.diff(stamped) > 0).all()):
            return stamped
        fps = next((s.fps for s in sources if s.fps), 30.0)
    return np.arange(count) / fps
