"""Records cameras into one folder: a video each, and when every picture was taken."""

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
) -> int:
    """Record until the time is over or a camera gives no more pictures; return the number of frames.

    All cameras are asked to hold their picture before the first is decoded: as near in time as they can be.

    Parameters
    ----------
    cameras : sequence of str, numbers of devices (0, 1, ...) or their paths, or video files that stand for cameras
    folder : str or Path
        Gets camera0.avi, camera1.avi, ... and times.csv; made when missing.
    seconds : float
    fps : float, asked of the devices, and written into the videos
    clock : callable, seconds
    on_pictures : callable, optional, called with the pictures of every moment: for showing them

    Raises
    ------
    GpCorrectError
        A camera cannot be opened or gives no picture, or a video cannot be written.
    """
    make_folder(folder)
    opened = [_opened(camera, fps) for camera in cameras]
    names = [f"camera{k}" for k in range(len(cameras))]
    writers: list[Any] = []
    times: list[list[float]] = []
    try:
        first = clock()
        while not times or times[-1][-1] < seconds:
            stamps = [(one.grab(), clock() - first) for one in opened]
            pictures = [one.retrieve() for one in opened] if all(good for good, _ in stamps) else [(False, None)]
            if not all(good for good, _ in pictures):
                break
            files = [Path(folder) / f"{name}.avi" for name in names]
            writers = writers or [_writer(file, p, fps) for file, (_, p) in zip(files, pictures, strict=True)]
            for writer, (_, picture) in zip(writers, pictures, strict=True):
                writer.write(picture)
            times.append([stamp for _, stamp in stamps])
            if on_pictures is not None:
                on_pictures([picture for _, picture in pictures])
    finally:
        for one in (*opened, *writers):
            one.release()
    if not times:
        hint = "Close other programs that use them; try fewer at once."
        raise GpCorrectError("the cameras gave no picture.", hint=hint)
    rows = [names, *([f"{stamp:.6f}" for stamp in row] for row in times)]
    write_file(Path(folder) / TIMES, "".join(",".join(row) + "\n" for row in rows))
    return len(times)


def _opened(camera: str, fps: float) -> Any:
    """Open a device by its number or path, or a video file."""
    number = camera.isdecimal() and not Path(camera).exists()
    device = number or Path(camera).is_char_device()
    opened = cv2.VideoCapture(int(camera) if number else camera)
    if not opened.isOpened():
        hint = "Give numbers of devices (on Linux 0 is /dev/video0) or video files; look who may read /dev/video*."
        raise GpCorrectError(f"camera {camera} cannot be opened.", hint=hint)
    if device:
        opened.set(cv2.CAP_PROP_FPS, fps)
        opened.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return opened


def _writer(path: Path, picture: Any, fps: float) -> Any:
    height, width = picture.shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (width, height))
    if not writer.isOpened():
        raise GpCorrectError(f"cannot write the video {path}.", hint="Name another folder, or make room.")
    return writer
