"""The recipe: pictures of several cameras into a track, with everything that went wrong named."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, PoseSignal, Progress
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.checks import check_fit
from gpcorrect.vision.filtering import FilterSettings
from gpcorrect.vision.opencv import Image
from gpcorrect.vision.recording import Recording, Track
from gpcorrect.vision.sources import Source, frame_times
from gpcorrect.vision.target import Target
from gpcorrect.vision.tracker import Frame, Tracker
from gpcorrect.vision.views import REASONS, FrameRules

__all__ = ["TrackResult", "TrackSettings", "track"]

PROBES = 7  # frames of the first look
OFTEN = 0.3  # of its frames in which a camera contradicts the others: it is named
Pictures = list[Image | None]


@dataclass(frozen=True)
class TrackSettings:
    """How to track.

    Parameters
    ----------
    fps : float or None
        Frames a second; the videos' own, or 30, when None.
    first_look : bool
        Check before tracking that pictures, calibration and target belong together.
    workers : int
        Pictures that are searched at the same time.
    rules : FrameRules
        When a view is trusted.
    motion : FilterSettings
        How the tool may move.
    """

    fps: float | None = None
    first_look: bool = True
    workers: int = 2
    rules: FrameRules = field(default_factory=FrameRules)
    motion: FilterSettings = field(default_factory=FilterSettings)


@dataclass(frozen=True, eq=False)
class TrackResult:
    """What came of it: the track, its log, remarks in words, and how long it took."""

    track: Track
    log: CalibrationLog
    remarks: tuple[str, ...]
    seconds: float

    @property
    def frames_a_second(self) -> float:
        """Speed of the whole job, reading included."""
        return len(self.track.time) / max(self.seconds, 1e-9)

    def log_without_predictions(self) -> CalibrationLog:
        """Return the log with `tracker_cp` only where it was measured: coasting rows are empty too."""
        assert self.log.tracker_cp is not None
        kept = (self.track.status == 0)[:, None]
        quaternion = self.log.tracker_cp.quaternion
        signal = PoseSignal(
            np.where(kept, self.log.tracker_cp.position, np.nan),
            None if quaternion is None else np.where(kept, quaternion, np.nan),
        )
        return replace(self.log, tracker_cp=signal)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `gpcorrect vision track`."""
        errors = self.track.reprojection_px[np.isfinite(self.track.reprojection_px)]
        return {
            "frames": len(self.track.time),
            **{f"{name}_share": share for name, share in self.track.shares().items()},
            "reprojection_px": float(np.sqrt(np.mean(errors**2))) if errors.size else None,
            "seconds": self.seconds,
            "frames_a_second": self.frames_a_second,
            "remarks": list(self.remarks),
        }


def track(
    sources: Sequence[Source],
    cameras: Sequence[Camera],
    target: Target,
    settings: TrackSettings | None = None,
    progress: Progress | None = None,
    on_frame: Callable[[Frame, Sequence[Image | None]], None] | None = None,
) -> TrackResult:
    """Track a target through synchronised recordings, frame by frame.

    Parameters
    ----------
    sources : sequence of Source
        One a camera, in the order of `cameras`.
    cameras : sequence of Camera
        Calibrated.
    target : Target
        What is tracked.
    settings : TrackSettings, optional
        How.
    progress : Progress, optional
        Told of the frames done.
    on_frame : callable, optional
        Called with every frame and its pictures: for drawing.

    Raises
    ------
    LogError
        The numbers of recordings and cameras differ, what is refused by :func:`~gpcorrect.vision.checks.check_fit`,
        or the tool was never found.
    """
    settings, progress = settings or TrackSettings(), progress or Progress()
    if len(sources) != len(cameras):
        raise LogError(
            f"{len(sources)} recordings were given, the calibration has {len(cameras)} cameras: "
            f"{', '.join(camera.name for camera in cameras)}.",
            hint="Give one video or folder for each camera, in this order.",
        )
    begun = time.perf_counter()
    count = max(source.count for source in sources)
    names = [source.path.name for source in sources]
    if settings.first_look:
        probes = np.unique(np.linspace(0, min(s.count for s in sources) - 1, PROBES).astype(int))
        check_fit([[s.peek(int(i)) for s in sources] for i in probes], cameras, target, names)
    times, recording = frame_times(sources, settings.fps, count), Recording()
    with (
        Tracker(cameras, target, settings.rules, settings.motion, settings.workers) as tracker,
        ThreadPoolExecutor(1) as reader,
    ):
        coming: Future[Pictures] = reader.submit(_read, sources)
        for i in range(count):
            images = coming.result()
            coming = reader.submit(_read, sources)
            if all(image is None for image in images) and all(source.ended for source in sources):
                break
            frame = tracker.step(images, float(times[i]))
            recording.add(frame)
            if on_frame is not None:
                on_frame(frame, images)
            progress.step("frames", (i + 1) / count)
    return _result(recording, sources, cameras, target, time.perf_counter() - begun)


def _read(sources: Sequence[Source]) -> Pictures:
    return [source.read() for source in sources]


def _result(
    recording: Recording, sources: Sequence[Source], cameras: Sequence[Camera], target: Target, seconds: float
) -> TrackResult:
    whole = recording.track()
    remarks = (*_breaks(sources, len(whole.time)), *_doubts(whole, cameras, target))
    if not (whole.status == 0).any():
        raise LogError(
            f"the tool was found in none of {len(whole.time)} frames. {' '.join(remarks)}",
            hint="Look at the pictures: every ball must be seen by two cameras at the same time.",
        )
    name = ", ".join(source.path.name for source in sources)
    return TrackResult(whole, whole.log(target, remarks, name), remarks, seconds)


def _breaks(sources: Sequence[Source], frames: int) -> list[str]:
    """Name recordings that ended early, and pictures that could not be read."""
    remarks = []
    for source in sources:
        bad = [i for i in source.unreadable if i < source.count - 1 or source.files]
        readable = source.count - len([i for i in source.unreadable if i >= source.count - 1 and not source.files])
        if readable < frames:
            remarks.append(f"{source.path.name} ends after {readable} of {frames} frames; the others go on without it.")
        if bad:
            remarks.append(f"{source.path.name}: {len(bad)} pictures cannot be read, the first is number {bad[0] + 1}.")
    return remarks


def _doubts(whole: Track, cameras: Sequence[Camera], target: Target) -> list[str]:
    """Cameras that contradict the others, and balls that were hardly seen."""
    remarks = []
    against = whole.views == REASONS.index("against the other cameras")
    for c, camera in enumerate(cameras):
        share = float(against[:, c].mean())
        if share > OFTEN:
            remarks.append(
                f"Camera {camera.name} contradicts the others in {100 * share:.0f} % of its views: was it moved?"
            )
    for b, ball in enumerate(target.names):
        never = float(((whole.views[:, :, b] == 0).sum(axis=1) < 2).mean())
        if never > OFTEN:
            remarks.append(f"Ball {ball} is seen by fewer than two cameras in {100 * never:.0f} % of the frames.")
    lost = int(np.count_nonzero(whole.status == 2))
    if lost:
        remarks.append(f"The tool is lost in {lost} of {len(whole.time)} frames; these rows are empty.")
    return remarks
