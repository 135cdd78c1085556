"""Record cameras into videos and the times of their pictures, as :mod:`gpcorrect.vision.sources` reads them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gpcorrect.atomic import make_folder, write_file
from gpcorrect.errors import GpCorrectError
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.sources import TIMES, USUAL_FPS


def record(
    cameras: Sequence[str],
    folder: str | Path,
    seconds: float,
    fps: float = USUAL_FPS,
    clock: Callable[[], float] = time.monotonic,
    on_pictures: Callable[[Sequence[Image]], None] | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> int:
    """Record until the time is over or video files are at their end; return the number of frames.

    All cameras are asked to hold their picture before the first is decoded: as near in time as they can be.

    Parameters
    ----------
    cameras : sequence of str, numbers of devices (0, 1, ...) or their paths, or video files that stand for cameras
    folder : str or Path
        Gets camera0.avi, camera1.avi, ... and times.csv, of video files by their own rate; made when missing.
    seconds : float
    fps : float, asked of the devices, and written into the videos
    clock : callable, seconds
    on_pictures : callable, optional, called with the pictures of every moment: for showing them
    stopped : callable, asked before every moment; the recording ends where it answers True

    Raises
    ------
    GpCorrectError
        The folder holds a recording already, a camera cannot be opened or gives no picture, or no more (what it gave is
        written), or a video cannot be written.
    """
    make_folder(folder)
    if any(Path(folder).glob("camera*.avi")) or (Path(folder) / TIMES).exists():
        raise GpCorrectError(f"{folder} holds a recording already.", hint="Name another folder, or move it away.")
    opened = [_opened(camera, fps) for camera in cameras]
    names = [f"camera{k}" for k in range(len(cameras))]
    files = [Path(folder) / f"{name}.avi" for name in names]
    writers: list[Any] = []
    times: list[list[float]] = []
    gone: list[str] = []
    try:
        first = clock()
        while not stopped() and (not times or times[-1][-1] < seconds):
            grabbed = [(one.grab(), clock() - first if rate is None else len(times) / rate) for one, rate in opened]
            gone = [camera for camera, (good, _) in zip(cameras, grabbed, strict=True) if not good]
            pictures = [] if gone else [one.retrieve() for one, _ in opened]
            gone = gone or [camera for camera, (good, _) in zip(cameras, pictures, strict=True) if not good]
            if gone:
                break
            writers = writers or [_writer(file, p, fps) for file, (_, p) in zip(files, pictures, strict=True)]
            for writer, (_, picture) in zip(writers, pictures, strict=True):
                writer.write(picture)
            times.append([stamp for _, stamp in grabbed])
            if on_pictures is not None:
                on_pictures([picture for _, picture in pictures])
    finally:
        for one in (*(one for one, _ in opened), *writers):
            one.release()
        if times:
            rows = [names, *([f"{stamp:.6f}" for stamp in row] for row in times)]
            write_file(Path(folder) / TIMES, "".join(",".join(row) + "\n" for row in rows))
    hint = "Close other programs that use them; try fewer at once."
    if not times:
        raise GpCorrectError("the cameras gave no picture.", hint=hint)
    if lost := [camera for camera, (_, rate) in zip(cameras, opened, strict=True) if rate is None and camera in gone]:
        words = f"camera {', '.join(lost)} gave no more pictures after {times[-1][0]:.1f} s; what came is in {folder}."
        raise GpCorrectError(words, hint=hint)
    return len(times)


def _opened(camera: str, fps: float) -> tuple[Any, float | None]:
    """Open a device by its number or path, or a video file, which has a rate instead of a clock."""
    number = camera.isdecimal() and not Path(camera).exists()
    device = number or Path(camera).is_char_device()
    opened = cv2.VideoCapture(int(camera) if number else camera)
    if not opened.isOpened():
        hint = "Give numbers of devices (on Linux 0 is /dev/video0) or video files; look who may read /dev/video*."
        raise GpCorrectError(f"camera {camera} cannot be opened.", hint=hint)
    if not device:
        return opened, float(opened.get(cv2.CAP_PROP_FPS)) or fps
    opened.set(cv2.CAP_PROP_FPS, fps)
    opened.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return opened, None


def _writer(path: Path, picture: Any, fps: float) -> Any:
    height, width = picture.shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (width, height))
    if not writer.isOpened():
        raise GpCorrectError(f"cannot write the video {path}.", hint="Name another folder, or make room.")
    return writer
