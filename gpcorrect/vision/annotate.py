"""Draws on the pictures what the tracker saw, and writes them as one video of all cameras."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from gpcorrect.atomic import atomic_path, require_folder
from gpcorrect.errors import GpCorrectError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.filtering import Status
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.target import Target
from gpcorrect.vision.tracker import Frame

WHITE, GREY, BLACK = (255, 255, 255), (150, 150, 150), (40, 40, 40)  # effective, suspended, shadow; blue green red
STATUS_INK = {Status.MEASURED: (80, 200, 80), Status.COASTING: (0, 190, 255), Status.LOST: (60, 60, 230)}
AXIS_INK = ((60, 60, 230), (80, 200, 80), (230, 130, 50))  # x red, y green, z blue
AXIS_LENGTH = 0.03  # m: about that of the fixture's arms
LIVE_EVERY = 0.2  # s between pictures of a live view: as often as the monitor's page looks
LIVE_WIDTH, LIVE_QUALITY = 960, 70  # px, and of JPEG, of a live view: some 80 kB with four cameras; chosen by hand
CODECS = {".mp4": "mp4v", ".avi": "MJPG"}


def annotated(frame: Frame, images: Sequence[Image | None], cameras: Sequence[Camera], target: Target) -> Image:
    """Return all pictures of a frame side by side, with outlines, axes and words on them.

    Parameters
    ----------
    frame : Frame, what the tracker found
    images : sequence of (height, width, 3) uint8 arrays, one a camera; None where there is none
    cameras : sequence of Camera, that took them
    target : Target

    Returns
    -------
    (height, width, 3) uint8 array
        A grid as square as it gets; smaller pictures are padded.
    """
    tiles = []
    for k, (camera, image) in enumerate(zip(cameras, images, strict=True)):
        lens = camera.intrinsics
        tile = np.zeros((lens.height, lens.width, 3), np.uint8) if image is None else np.array(image)
        _draw_views(tile, frame, k, target)
        if frame.pose.status != Status.LOST and target.has_pose:
            _draw_axes(tile, frame.pose.T_tracker_tool, camera)
        title = f"{camera.name}  {frame.time:.2f} s  {frame.pose.status}" + ("  no picture" if image is None else "")
        _write(tile, title, (8, 20), STATUS_INK[frame.pose.status])
        tiles.append(tile)
    return side_by_side(tiles)


def side_by_side(tiles: Sequence[Image]) -> Image:
    """Return pictures as one, in a grid as square as it gets; smaller ones are padded.

    Parameters
    ----------
    tiles : sequence of (height, width, 3) uint8 arrays
    """
    columns = math.ceil(math.sqrt(len(tiles)))
    height, width = (max(tile.shape[i] for tile in tiles) for i in (0, 1))
    sheet = np.zeros((math.ceil(len(tiles) / columns) * height, columns * width, 3), np.uint8)
    for k, tile in enumerate(tiles):
        top, left = (k // columns) * height, (k % columns) * width
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet


class LiveView:
    """Gives pictures away as small JPEGs, no more than a few a second: for people who look on.

    Parameters
    ----------
    send : callable, takes a JPEG
    """

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send, self._next = send, -math.inf

    def show(self, picture: Callable[[], Image]) -> None:
        """Make a picture and send it, unless it is too soon after the one before.

        Parameters
        ----------
        picture : callable, returns it; called only when it is sent
        """
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + LIVE_EVERY
        image = picture()
        scale = min(1.0, LIVE_WIDTH / image.shape[1])
        small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        self._send(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, LIVE_QUALITY])[1].tobytes())


def _draw_views(tile: Image, frame: Frame, camera: int, target: Target) -> None:
    row = tile.shape[0] - 8
    for ball, view in zip(target.names, frame.views[camera], strict=True):
        if view.outline is not None:
            at = tuple(round(float(v) * 8) for v in view.outline.pixel)
            ink = WHITE if view.effective else GREY
            cv2.circle(tile, at, round(view.outline.radius * 8), ink, 1, cv2.LINE_AA, 3)
            cv2.drawMarker(tile, (at[0] // 8, at[1] // 8), ink, cv2.MARKER_CROSS, 7, 1)
        if not view.effective:
            _write(tile, f"{ball}: {view.reason}", (8, row), WHITE)
            row -= 18


def _draw_axes(tile: Image, T: FloatArray, camera: Camera) -> None:
    pixels = camera.project(T[:3, 3] + AXIS_LENGTH * np.vstack([np.zeros(3), T[:3, :3].T]))
    if not np.isfinite(pixels).all() or np.abs(pixels).max() > 1e5:
        return
    start, *others = [tuple(round(float(v)) for v in p) for p in pixels]
    for end, ink in zip(others, AXIS_INK, strict=True):
        cv2.line(tile, start, end, ink, 2, cv2.LINE_AA)


def _write(tile: Image, words: str, at: tuple[int, int], ink: tuple[int, int, int]) -> None:
    for place, colour in (((at[0] + 1, at[1] + 1), BLACK), (at, ink)):
        cv2.putText(tile, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)


class AnnotatedVideo:
    """Writes annotated frames to a video, which appears whole or not at all.

    Parameters
    ----------
    path : str or Path, .mp4 or .avi, in a folder that is there; GpCorrectError otherwise
    cameras : sequence of Camera, for the drawing
    target : Target, for the drawing
    fps : float, frames a second
    """

    def __init__(self, path: str | Path, cameras: Sequence[Camera], target: Target, fps: float) -> None:
        self._path, self._cameras, self._target, self._fps = Path(path), cameras, target, fps
        self._writer: Any = None
        if self._path.suffix not in CODECS:
            raise GpCorrectError(f"an annotated video ends in .mp4 or .avi; got {self._path.name}.")
        require_folder(self._path)

    def __enter__(self) -> Self:
        self._context = atomic_path(self._path)
        self._temporary = self._context.__enter__()
        return self

    def add(self, frame: Frame, images: Sequence[Image | None]) -> None:
        """Draw a frame and write it.

        Parameters
        ----------
        frame, images : as :func:`annotated`

        Raises
        ------
        GpCorrectError
            This build of OpenCV cannot write such a video.
        """
        sheet = annotated(frame, images, self._cameras, self._target)
        if self._writer is None:
            code = cv2.VideoWriter_fourcc(*CODECS[self._path.suffix])
            self._writer = cv2.VideoWriter(str(self._temporary), code, self._fps, (sheet.shape[1], sheet.shape[0]))
            if not self._writer.isOpened():
                raise GpCorrectError(f"this build of OpenCV cannot write {self._path.name}.", hint="Try .avi.")
        self._writer.write(sheet)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.release()
        self._context.__exit__(kind, error, trace)
