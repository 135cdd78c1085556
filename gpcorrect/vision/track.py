"""The recipe: recordings of several cameras into a track and its log, with everything that went wrong named."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, LogMeta, PoseSignal, Progress
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.checks import check_distances, check_fit
from gpcorrect.vision.clocks import Clocks
from gpcorrect.vision.filtering import STATUSES, Status
from gpcorrect.vision.opencv import Image
from gpcorrect.vision.search import REASONS, Reason
from gpcorrect.vision.settings import DEFAULT, VisionSettings
from gpcorrect.vision.sources import Source, frame_times, keep_numbers, pair_by_time
from gpcorrect.vision.target import Target
from gpcorrect.vision.tracker import Frame, Tracker

TRACKER = "cameras and coloured balls"  # what the sidecar of a track's log calls it


@dataclass(frozen=True)
class TrackSettings:
    """How to track.

    Parameters
    ----------
    fps : float or None, frames a second; the videos' own, or 30, when None
    first_look : bool, whether to check before tracking that pictures, calibration and target belong together
    workers : int, whole pictures that are searched at the same time
    vision : VisionSettings, every number that decides
    """

    fps: float | None = None
    first_look: bool = True
    workers: int = 2
    vision: VisionSettings = DEFAULT


@dataclass(frozen=True, eq=False)
class Track:
    """A whole recording, tracked.

    Parameters
    ----------
    time : (n,) array, s
    status : (n,) int array, index into `STATUSES`
    T_tracker_tool : (n, 4, 4) array, m; NaN where lost
    std : (n, 6) array, of position (m) and rotation vector (rad); NaN where lost
    balls : (n, b, 3) array, each ball's centre, m; NaN where fewer than two cameras saw it
    views : (n, c, b) int array, 0: effective; otherwise the reason, an index into `REASONS`
    reprojection_px : (n,) array, RMS over the observations used; NaN without
    chi_squared : (n,) array, the same squared, over what is expected: 1 where all fits; NaN without
    scatter : (n,) array, how far errors of single views may put the position off, m; NaN without
    """

    time: FloatArray
    status: IntArray
    T_tracker_tool: FloatArray
    std: FloatArray
    balls: FloatArray
    views: IntArray
    reprojection_px: FloatArray
    chi_squared: FloatArray
    scatter: FloatArray

    def fractions(self) -> dict[str, float]:
        """Return the fraction of the frames in each status."""
        n = max(len(self.status), 1)
        return {name.value: float(np.count_nonzero(self.status == k)) / n for k, name in enumerate(STATUSES)}

    def log(self, target: Target, remarks: Sequence[str] = (), name: str = "") -> CalibrationLog:
        """Return the native log: `tracker_cp`, empty where lost, and what is known of every sample in extra columns.

        Parameters
        ----------
        target : Target
        remarks : sequence of str, of the recording, for the log's notes
        name : str
        """
        position = self.T_tracker_tool[:, :3, 3]
        quaternion = se3.quaternion_from_matrix(self.T_tracker_tool[:, :3, :3]) if target.has_pose else None
        effective = (self.views == 0).sum(axis=1).astype(np.float64)
        axes = ("x", "y", "z", "rx", "ry", "rz")[: 6 if target.has_pose else 3]
        extra = {"tracking_status": self.status.astype(np.float64), "reprojection_px": self.reprojection_px}
        extra |= {f"tracker_std_{axis}": self.std[:, i] for i, axis in enumerate(axes)}
        for b, ball in enumerate(target.names):
            extra |= {f"ball_{ball}_{axis}": self.balls[:, b, i] for i, axis in enumerate(("x", "y", "z"))}
            extra[f"ball_{ball}_cameras"] = effective[:, b]
        n = len(self.time)
        return CalibrationLog(
            time=self.time,
            trajectory=np.zeros(n, dtype=np.int64),
            session=np.zeros(n, dtype=np.int64),
            tracker_cp=PoseSignal(position, quaternion),
            extra=extra,
            meta=LogMeta(tracker=TRACKER, notes=" ".join(remarks)),
            name=name,
            remarks=tuple(remarks),
        )


@dataclass(frozen=True, eq=False)
class TrackResult:
    """A track with its log.

    Parameters
    ----------
    track : Track, the numbers
    log : CalibrationLog, the same as a log
    remarks : tuple of str, what went wrong, in words
    seconds : float, that it took, reading included
    """

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
        seen, measured = self.log.tracker_cp, (self.track.status == 0)[:, None]
        assert seen is not None
        quaternion = None if seen.quaternion is None else np.where(measured, seen.quaternion, np.nan)
        return replace(self.log, tracker_cp=PoseSignal(np.where(measured, seen.position, np.nan), quaternion))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `gpcorrect vision track`."""
        errors = self.track.reprojection_px[np.isfinite(self.track.reprojection_px)]
        return {
            "frames": len(self.track.time),
            **{f"{name}_share": fraction for name, fraction in self.track.fractions().items()},
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
    sources : sequence of Source, one a camera, in the order of `cameras`
    cameras : sequence of Camera
    target : Target
    settings : TrackSettings, optional
    progress : Progress, optional
    on_frame : callable, optional, called with every frame and its pictures: for drawing

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
    unpaired = keep_numbers(sources) + (pair_by_time(sources) if settings.fps is None else [])
    count, names = max(source.count for source in sources), [source.path.name for source in sources]
    times, rows = frame_times(sources, settings.fps, count), []
    pictures: list[list[Image | None]] = []
    if settings.first_look:
        last = min(source.count for source in sources) - 1
        some = np.unique(np.linspace(0, last, settings.vision.check.frames).astype(int))
        pictures = [[source.peek(int(i)) for source in sources] for i in some]
        check_fit(pictures, cameras, target, names, settings.vision)
    clocks = _clocks(sources, times, cameras, target, settings)
    tracker = Tracker(cameras, target, settings.vision, settings.workers, clocks)
    with tracker, ThreadPoolExecutor(1) as reader:

        def next_pictures() -> Future[list[Image | None]]:
            return reader.submit(lambda: [source.read() for source in sources])

        coming = next_pictures()
        for i in range(count):
            images = coming.result()
            coming = next_pictures()
            if all(image is None for image in images) and all(source.ended for source in sources):
                break
            frame = tracker.step(images, float(times[i]))
            rows.append(_row(frame))
            if on_frame is not None:
                on_frame(frame, images)
            progress.step("frames", (i + 1) / count)
    if not rows:
        raise LogError(f"no picture of {', '.join(names)} can be read.", hint="Copy the recordings again.")
    whole = Track(*(np.array(column) for column in zip(*rows, strict=True)))
    remarks = unpaired + _interruptions(sources, len(whole.time))
    found = zip(cameras, 1e3 * tracker.clocks.delays, 1e3 * tracker.clocks.stds, strict=True)
    late = [f"{c.name} {by:+.1f} ms (±{std:.1f})" for c, by, std in found if c.delay is None and abs(by) > 0.05]
    if late:
        remarks.append(f"Cameras look later than {cameras[0].name}: {', '.join(late)}; taken into account.")
    contradiction = _contradiction(whole, settings.vision.views.doubt)
    remarks += contradiction
    remarks += _doubts(whole, cameras, target, settings.vision.check.often, doubtful=bool(contradiction))
    remarks += _misshapen(whole, target, settings.vision)
    if not (whole.status == 0).any():
        check_distances(pictures, cameras, target, settings.vision)
        hint = (
            "Look at the pictures: every ball must be seen by two cameras at the same time. Where it is, the "
            "calibration or the target file does not fit them."
        )
        raise LogError(f"the tool was found in none of {len(whole.time)} frames. {' '.join(remarks)}", hint=hint)
    log = whole.log(target, remarks, ", ".join(names))
    return TrackResult(whole, log, tuple(remarks), time.perf_counter() - begun)


def _clocks(
    sources: Sequence[Source], times: FloatArray, cameras: Sequence[Camera], target: Target, settings: TrackSettings
) -> Clocks | None:
    """Learn delays from the beginning of the recordings, so that the first frames have them too."""
    look = settings.vision.clocks.look
    if not settings.first_look or min(source.count for source in sources) < look:
        return None
    again = [source.again() for source in sources]
    with Tracker(cameras, target, settings.vision, settings.workers) as tracker:
        for time_ in times[:look]:
            tracker.step([source.read() for source in again], float(time_))
        tracker.clocks.learned_until = float(times[look - 1])
        return tracker.clocks


def _row(frame: Frame) -> tuple[object, ...]:
    """Return what a `Track` holds of a frame, in the order of its fields."""
    lost, fit = frame.pose.status == Status.LOST, frame.measured
    left = (
        (np.nan, np.nan)
        if fit is None or fit.linearised is None
        else (fit.linearised.chi_squared, fit.linearised.scatter)
    )
    return (
        frame.time,
        STATUSES.index(frame.pose.status),
        np.full((4, 4), np.nan) if lost else frame.pose.T_tracker_tool,
        np.full(6, np.nan) if lost else frame.pose.std,
        frame.balls,
        [[REASONS.index(view.reason) for view in views] for views in frame.views],
        frame.reprojection_px,
        *left,
    )


def _interruptions(sources: Sequence[Source], frames: int) -> list[str]:
    """Name recordings that ended early, and pictures that could not be read or are no new ones."""
    remarks = []
    for source in sources:
        bad = [i for i in source.unreadable if i < source.count - 1 or source.files]
        readable = source.count - (len(source.unreadable) - len(bad))
        if readable < frames:
            remarks.append(f"{source.path.name} ends after {readable} of {frames} frames; the others go on without it.")
        if source.goes_on():
            words = f"holds more pictures than the {source.count} that its header, or its times, speak of: left out."
            remarks.append(f"{source.path.name} {words}")
        if bad:
            remarks.append(f"{source.path.name}: {len(bad)} pictures cannot be read, the first is number {bad[0] + 1}.")
        if source.repeated:
            words = "are the one before again: what they show was earlier than their times say."
            remarks.append(f"{source.path.name}: {source.repeated} of {readable} pictures {words}")
    return remarks


def _contradiction(whole: Track, doubt: float) -> list[str]:
    """Say where trusted views do not fit together either: no single camera explains that."""
    found = whole.chi_squared[np.isfinite(whole.chi_squared)]
    left = float(np.median(found)) if found.size else 0.0
    if left <= doubt:
        return []
    return [
        f"The views contradict each other, {np.sqrt(left):.1f} times as much as expected, and which cameras are wrong "
        "cannot be told: the poses may be farther off than they say. Were pictures cropped or zoomed, or recorded in "
        "another mode, or cameras moved since the calibration?"
    ]


def _doubts(whole: Track, cameras: Sequence[Camera], target: Target, often: float, *, doubtful: bool) -> list[str]:
    """Name cameras that contradict the others or add nothing, and balls that were hardly seen.

    Of cameras that contradict each other (`doubtful`) none is named: what a few agree on may be wrong.
    """
    lost = whole.status == STATUSES.index(Status.LOST)
    against = (whole.views[~lost] == REASONS.index(Reason.AGAINST_OTHERS)).sum(axis=(0, 2)) / whole.views[:, 0].size
    hidden = ((whole.views == 0).sum(axis=1) < 2).mean(axis=0)
    measured = whole.status == STATUSES.index(Status.MEASURED)
    unused = (whole.views[measured] != 0).all(axis=2).sum(axis=0) / max(np.count_nonzero(measured), 1)
    remarks = []
    for camera, contrary, part in zip(cameras, against, unused, strict=True):
        if doubtful and contrary > 0.0:
            continue
        if contrary > often:
            words = (
                f"contradicts the others in {100 * contrary:.0f} % of its views: was it moved, or is a picture missing?"
            )
        elif part > often:
            words = f"adds nothing to {100 * part:.0f} % of the measured frames: is it dark, late, or placed wrongly?"
        else:
            continue
        remarks.append(f"Camera {camera.name} {words}")
    remarks += [
        f"Ball {ball} is seen by fewer than two cameras in {100 * part:.0f} % of the frames."
        for ball, part in zip(target.names, hidden, strict=True)
        if part > often
    ]
    if lost.any():
        remarks.append(
            f"The tool is lost in {np.count_nonzero(lost)} of {len(whole.time)} frames; these rows are empty."
        )
    return remarks


def _misshapen(whole: Track, target: Target, settings: VisionSettings) -> list[str]:
    """Name balls that are not as far apart as the target file says: such poses err more than they say."""
    remarks, check, few = [], settings.check, int(settings.views.spread_memory)
    for (i, first), (j, second) in itertools.combinations(enumerate(target.balls), 2):
        apart = np.linalg.norm(whole.balls[:, i] - whole.balls[:, j], axis=1)
        known = float(np.linalg.norm(np.subtract(first.place, second.place)))
        rows = np.flatnonzero(np.isfinite(apart))
        for stretch in np.array_split(rows, len(rows) // few) if len(rows) >= few else ():
            usual, std = float(np.median(apart[stretch])), whole.scatter[stretch]
            if abs(usual - known) > max(check.misshapen * float(np.median(std)), check.misshapen_least):
                remarks.append(
                    f"Balls {first.name} and {second.name} are {1e3 * usual:.1f} mm apart in the pictures from "
                    f"{whole.time[stretch[0]]:.1f} s on, {1e3 * known:.1f} mm in the target file: the poses are "
                    "farther off than they say. Was a ball moved, or the calibration's board of another size?"
                )
                break
    return remarks
