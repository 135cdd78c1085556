"""The tracker: pictures of all cameras at one moment in, the pose of the tool out.

Each ball in each camera is effective or suspended (Peng et al. 2020): a circle that jumps, has the wrong size or is not
found is suspended; five good frames that agree with the other cameras bring it back. While fewer than two cameras see a
ball its search widens, and narrows again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.acquire import acquire
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.filtering import Filtered, PoseFilter, Status
from gpcorrect.vision.opencv import Image
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.search import Found, Reason, detect_everywhere, detect_near
from gpcorrect.vision.settings import DEFAULT, VisionSettings
from gpcorrect.vision.space import (
    Located,
    Observations,
    PoseFit,
    pose_closed_form,
    pose_from_observations,
    triangulate,
)
from gpcorrect.vision.target import Target

__all__ = ["Frame", "Tracker", "View"]

FIXED_TURN = 1e-6  # rad^2: variance of the rotation of a target without orientation, which never turns
Result = TypeVar("Result")


@dataclass
class View:
    """One ball in one camera.

    Parameters
    ----------
    effective : bool
        Whether it is trusted; otherwise it is suspended.
    reason : Reason
        Why it is suspended.
    outline : Outline or None
        What was found in this frame.
    good : int
        Frames in which a suspended view agreed with the others.
    """

    effective: bool = False
    reason: Reason = Reason.NOT_FOUND
    outline: Outline | None = None
    good: int = 0

    def suspend(self, reason: Reason) -> None:
        """Trust this view no more, until it has been good for long enough.

        Parameters
        ----------
        reason : Reason
            Why.
        """
        self.effective, self.reason, self.good = False, reason, 0

    def admit(self) -> None:
        """Trust this view."""
        self.effective, self.reason = True, Reason.NONE


@dataclass
class _BallMemory:
    """What is known of a ball from earlier frames: its size (m), how wide to search, and the last sizes."""

    radius: float | None
    tolerance: float = 1.0
    sizes: list[float] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Frame:
    """The estimate at one moment, and what it rests on.

    Parameters
    ----------
    time : float
        Seconds.
    pose : Filtered
        The estimated pose, and whether it was measured.
    measured : PoseFit or None
        What was measured in this very frame.
    balls : (b, 3) array
        Centres of the balls, tracker frame, m; NaN for a ball that fewer than two cameras see.
    views : tuple (cameras) of tuple (balls) of View
        What each camera saw.
    reprojection_px : float
        RMS over the observations that were used; NaN without any.
    """

    time: float
    pose: Filtered
    measured: PoseFit | None
    balls: FloatArray
    views: tuple[tuple[View, ...], ...]
    reprojection_px: float


class Tracker:
    """Follows a target through synchronised pictures; :meth:`step` once a frame.

    Parameters
    ----------
    cameras : sequence of Camera
        Calibrated; at least two.
    target : Target
    settings : VisionSettings
        When a ball is one, when a view is trusted, how the tool may move.
    workers : int
        Pictures that are searched at the same time.

    Raises
    ------
    DataError
        There are fewer than two cameras.
    """

    def __init__(
        self, cameras: Sequence[Camera], target: Target, settings: VisionSettings = DEFAULT, workers: int = 2
    ) -> None:
        if len(cameras) < 2:
            raise DataError(f"tracking in space needs two cameras or more, got {len(cameras)}.")
        self.cameras, self.target, self.settings = cameras, target, settings
        self._filter = PoseFilter(settings.motion)
        self._views = [[View() for _ in target.balls] for _ in cameras]
        self._memory = [_BallMemory(ball.radius) for ball in target.balls]
        self._wait = 0  # frames until whole pictures are searched again
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def step(self, images: Sequence[Image | None], time: float) -> Frame:
        """Take in one picture a camera.

        Parameters
        ----------
        images : sequence of (height, width, 3) uint8 arrays
            Blue green red, in the order of the cameras; None where a camera has none.
        time : float
            Seconds, increasing.

        Raises
        ------
        DataError
            The number of pictures is not that of the cameras, or a picture has another size than its calibration.
        """
        self._check(images)
        predicted = self._filter.predicted(time)
        located: list[Located | None] = [None] * len(self.target.balls)
        fit = None
        if predicted is not None:
            self._follow(images, predicted)
            located = self._agree(settled=True)
            fit = self._fitted(located, predicted)
        anew = fit is None and self._wait == 0
        if anew:
            self._acquire(images)
            located = self._agree(settled=False)
            fit = self._fitted(located, predicted)
        self._wait = 0 if fit is not None else (self._wait or self.settings.views.patience) - 1
        trusted = [sum(views[b].effective for views in self._views) for b in range(len(self.target.balls))]
        # A jump that three cameras agree on for every ball is one.
        measured = (None, None) if fit is None else (fit.T_tracker_tool, fit.covariance)
        pose = self._filter.step(time, *measured, found_anew=anew or min(trusted) >= 3)
        views = self.settings.views
        for memory, seeing in zip(self._memory, trusted, strict=True):
            factor = views.widen if seeing < 2 else 1.0 / views.widen
            memory.tolerance = float(np.clip(memory.tolerance * factor, 1.0, views.widest))
        none = np.full(3, np.nan)
        return Frame(
            time,
            pose,
            fit if pose.status == Status.MEASURED else None,
            np.array([none if p is None else p.position for p in located]),
            tuple(tuple(replace(view) for view in views) for views in self._views),
            float("nan") if fit is None else fit.rms,
        )

    def _check(self, images: Sequence[Image | None]) -> None:
        if len(images) != len(self.cameras):
            raise DataError(f"{len(self.cameras)} cameras are calibrated, {len(images)} pictures came.")
        for camera, image in zip(self.cameras, images, strict=True):
            lens = camera.intrinsics
            if image is not None and image.shape[:2] != (lens.height, lens.width):
                raise DataError(
                    f"camera {camera.name} was calibrated at {lens.width} x {lens.height}, its picture has "
                    f"{image.shape[1]} x {image.shape[0]}.",
                    hint="Record at the size of the calibration, or calibrate at the size of the recording.",
                )

    def _map(self, job: Callable[[int], Result]) -> list[Result]:
        """Do a job for every camera, several at the same time."""
        cameras = range(len(self.cameras))
        return list(map(job, cameras) if self._pool is None else self._pool.map(job, cameras))

    def _follow(self, images: Sequence[Image | None], T: FloatArray) -> None:
        """Find every ball where a predicted pose puts it."""
        points = self.target.places @ T[:3, :3].T + T[:3, 3]

        def camera_job(k: int) -> list[Found]:
            found = []
            for ball, memory, point in zip(self.target.balls, self._memory, points, strict=True):
                expected = None if images[k] is None else _expected(self.cameras[k], memory, point)
                found.append(
                    Found(None, Reason.NOT_FOUND)
                    if expected is None
                    else detect_near(images[k], self.cameras[k], ball, expected, memory.tolerance, self.settings)
                )
            return found

        for views, found in zip(self._views, self._map(camera_job), strict=True):
            for view, result in zip(views, found, strict=True):
                view.outline = result.outline
                if result.outline is None:
                    view.suspend(result.reason)

    def _acquire(self, images: Sequence[Image | None]) -> None:
        """Find every ball anywhere; what several cameras agree on is trusted at once."""

        def camera_job(k: int) -> list[list[Outline]]:
            if images[k] is None:
                return [[] for _ in self.target.balls]
            return [detect_everywhere(images[k], self.cameras[k], ball, self.settings) for ball in self.target.balls]

        found = acquire(self.cameras, self.target, self._map(camera_job), self.settings.agreement)
        for b, hypothesis in enumerate(found):
            for k, views in enumerate(self._views):
                views[b].outline = None if hypothesis is None else hypothesis.views.get(k)
                if views[b].outline is None:
                    views[b].suspend(Reason.NOT_FOUND)
                else:
                    views[b].admit()

    def _agree(self, *, settled: bool) -> list[Located | None]:
        """Locate every ball from its trusted views; suspend those against the others, and count good frames.

        Where fewer than two views of a tracked ball are trusted, all that see it are taken.
        """
        located = []
        for b in range(len(self.target.balls)):
            seen = [(k, views[b]) for k, views in enumerate(self._views) if views[b].outline is not None]
            trusted = [(k, view) for k, view in seen if view.effective]
            trusted = self._consensus(seen if len(trusted) < 2 and settled else trusted)
            point = self._located(trusted)
            located.append(point)
            if point is not None:
                self._classify(b, seen, [k for k, _ in trusted], point)
        return located

    def _consensus(self, seen: list[tuple[int, View]]) -> list[tuple[int, View]]:
        """Leave out the worst view until the others agree; of two that disagree neither is trusted."""
        while len(seen) >= 2:
            point = self._located(seen)
            if point is None:
                return []
            off = np.linalg.norm(point.residuals, axis=1)
            if float(off.max()) <= self.settings.views.reprojection_px:
                return seen
            if len(seen) == 2:
                for _, view in seen:
                    view.suspend(Reason.AGAINST_OTHERS)
                return []
            rests = [seen[:i] + seen[i + 1 :] for i in range(len(seen))]  # without the worst the others agree best
            left = [
                np.inf if p is None else np.linalg.norm(p.residuals, axis=1).max() for p in map(self._located, rests)
            ]
            seen = rests[int(np.argmin(left)) if np.isfinite(left).any() else int(np.argmax(off))]
        return []

    def _located(self, seen: list[tuple[int, View]]) -> Located | None:
        outlines = [view.outline for _, view in seen if view.outline is not None]
        if len(outlines) < 2:
            return None
        try:
            return triangulate(
                [self.cameras[k] for k, _ in seen],
                np.array([o.ray for o in outlines]),
                np.array([o.covariance for o in outlines]),
            )
        except DegenerateError:
            return None

    def _classify(self, ball: int, seen: list[tuple[int, View]], trusted: list[int], point: Located) -> None:
        """Admit, count or suspend every view that found something, by where the trusted ones put the ball."""
        sizes, settings = [], self.settings.views
        for k, view in seen:
            assert view.outline is not None
            camera = self.cameras[k]
            if k in trusted:
                view.admit()
                sizes.append(float(np.linalg.norm(point.position - camera.position) * np.sin(view.outline.half_angle)))
            elif np.linalg.norm(camera.project(point.position)[0] - view.outline.pixel) > settings.reprojection_px:
                view.suspend(Reason.AGAINST_OTHERS)
            else:
                view.good, view.reason = view.good + 1, Reason.COMING_BACK
                if view.good >= settings.good_frames:
                    view.admit()
        if sizes and self.target.balls[ball].radius is None:
            memory = self._memory[ball]
            memory.sizes = [*memory.sizes[-settings.size_memory :], float(np.mean(sizes))]
            memory.radius = float(np.median(memory.sizes))

    def _fitted(self, located: list[Located | None], predicted: FloatArray | None) -> PoseFit | None:
        """Fit the tool's pose to everything that is trusted in this frame; None when that is too little."""
        if not self.target.has_pose:
            return _mean_position(located)
        known = [b for b, point in enumerate(located) if point is not None]
        observations = self._observations()
        try:
            if len(known) >= 3:
                points = np.array([point.position for point in located if point is not None])
                start = pose_closed_form(points, self.target.places[known]).T_tracker_tool
            elif known and predicted is not None:
                start = predicted
            else:
                return None
            if observations is None:
                return None
            fit = pose_from_observations(self.cameras, self.target.places, observations, start)
        except (DegenerateError, np.linalg.LinAlgError):
            return None
        return fit if fit.rms < 2.0 * self.settings.views.reprojection_px else None

    def _observations(self) -> Observations | None:
        """Trusted views of this frame; None unless three balls are seen, and by two cameras."""
        rows = [
            (k, b, view.outline)
            for k, views in enumerate(self._views)
            for b, view in enumerate(views)
            if view.effective and view.outline is not None
        ]
        if len({b for _, b, _ in rows}) < 3 or len({k for k, _, _ in rows}) < 2 or len(rows) < 4:
            return None
        cameras, balls, outlines = zip(*rows, strict=True)
        rays, covariances = np.array([o.ray for o in outlines]), np.array([o.covariance for o in outlines])
        return Observations(np.array(cameras), np.array(balls), rays, covariances)


def _expected(camera: Camera, memory: _BallMemory, point: FloatArray) -> FloatArray | None:
    """Circle (u, v, radius; px) that a camera should see; None when it is out of sight, or of unknown size."""
    pixel = camera.project(point)[0]
    if memory.radius is None or not np.isfinite(pixel).all():
        return None
    distance = float(np.linalg.norm(point - camera.position))
    size = float(camera.intrinsics.focal * memory.radius / np.sqrt(max(distance**2 - memory.radius**2, 1e-9)))
    limits = np.array([camera.intrinsics.width, camera.intrinsics.height])
    if (pixel < -size).any() or (pixel >= limits + size).any():
        return None
    return np.array([*pixel, size])


def _mean_position(located: Sequence[Located | None]) -> PoseFit | None:
    """Without orientation: the mean of the balls, which all must be seen."""
    points = [point for point in located if point is not None]
    if len(points) < len(located):
        return None
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = sum(p.covariance for p in points) / len(points) ** 2
    covariance[3:, 3:] = FIXED_TURN * np.eye(3)
    T = se3.pose(np.eye(3), np.mean([p.position for p in points], axis=0))
    return PoseFit(T, covariance, np.concatenate([p.residuals for p in points]))
