"""The tracker: pictures of all cameras at one moment in, where the tool is out."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.acquire import acquire
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.filtering import Filtered, FilterSettings, PoseFilter
from gpcorrect.vision.opencv import Image
from gpcorrect.vision.pose import PoseFit, Sightings, pose_closed_form, pose_from_sightings
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.search import Expected, Found, look_everywhere, look_near
from gpcorrect.vision.target import Target
from gpcorrect.vision.triangulate import Located, triangulate
from gpcorrect.vision.views import BallMemory, FrameRules, View

__all__ = ["Frame", "Tracker", "ViewState"]

TURN_UNKNOWN = 1e-6  # rad^2: variance of the rotation that a position-only target is given, which never turns


@dataclass(frozen=True, eq=False)
class ViewState:
    """One ball in one camera in one frame: effective or suspended (and why), and its outline if one was found."""

    effective: bool
    reason: str
    outline: Outline | None


@dataclass(frozen=True, eq=False)
class Frame:
    """What one moment told.

    Parameters
    ----------
    time : float
        Seconds.
    pose : Filtered
        Where the tool is believed to be, and whether that was measured.
    measured : PoseFit or None
        What was measured in this very frame.
    balls : (b, 3) array
        Centres of the balls, tracker frame, m; NaN for a ball that fewer than two cameras see.
    balls_std : (b, 3) array
        Their standard deviations, m.
    views : tuple (cameras) of tuple (balls) of ViewState
        What each camera saw.
    reprojection_px : float
        RMS over the sightings that were used; NaN without any.
    """

    time: float
    pose: Filtered
    measured: PoseFit | None
    balls: FloatArray
    balls_std: FloatArray
    views: tuple[tuple[ViewState, ...], ...]
    reprojection_px: float

    def cameras_seeing(self, ball: int) -> int:
        """Return the number of cameras that were trusted with a ball."""
        return sum(views[ball].effective for views in self.views)


@dataclass(eq=False)
class Tracker:
    """Follows a target through synchronised pictures; :meth:`step` once a frame.

    Parameters
    ----------
    cameras : sequence of Camera
        Calibrated; at least two.
    target : Target
        What is tracked.
    rules : FrameRules, optional
        When a view is trusted.
    motion : FilterSettings, optional
        How the tool may move.
    workers : int
        Pictures that are searched at the same time.
    """

    cameras: Sequence[Camera]
    target: Target
    rules: FrameRules = field(default_factory=FrameRules)
    motion: FilterSettings = field(default_factory=FilterSettings)
    workers: int = 2

    def __post_init__(self) -> None:
        if len(self.cameras) < 2:
            raise DataError(f"tracking in space needs two cameras or more, got {len(self.cameras)}.")
        self._filter = PoseFilter(self.motion)
        self._views = [[View() for _ in self.target.balls] for _ in self.cameras]
        self._memory = [BallMemory(ball.radius) for ball in self.target.balls]
        self._patience = 0
        self._pool = ThreadPoolExecutor(self.workers) if self.workers > 1 else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def step(self, images: Sequence[Image | None], time: float) -> Frame:
        """Take in one picture a camera; None where a camera has none.

        Raises
        ------
        DataError
            The number of pictures is not that of the cameras, or a picture has another size than its calibration.
        """
        self._check(images)
        located, fit = self._followed(images, time)
        anew = fit is None and self._patience == 0
        if anew:
            located, fit = self._acquired(images, time)
        self._patience = 0 if fit is not None else (self._patience or self.rules.patience) - 1
        measured = (None, None) if fit is None else (fit.T_tracker_tool, fit.covariance)
        pose = self._filter.step(time, *measured, found_anew=anew or self._sure())
        for b, memory in enumerate(self._memory):
            memory.seen_by(sum(views[b].effective for views in self._views), self.rules)
        return self._frame(time, pose, fit, located)

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

    def _followed(self, images: Sequence[Image | None], time: float) -> tuple[list[Located | None], PoseFit | None]:
        """Look where the balls should be; nothing when the tool is lost."""
        T = self._filter.predicted(time)
        if T is None:
            return [None] * len(self.target.balls), None
        points = self.target.places @ T[:3, :3].T + T[:3, 3]
        expected = [[self._seen_from(camera, b, points[b]) for b in range(len(points))] for camera in self.cameras]
        self._follow(images, expected)
        located = self._agree(settled=True)
        return located, self._fitted(located, time)

    def _acquired(self, images: Sequence[Image | None], time: float) -> tuple[list[Located | None], PoseFit | None]:
        """Look everywhere."""
        self._acquire(images)
        located = self._agree(settled=False)
        return located, self._fitted(located, time)

    def _seen_from(self, camera: Camera, ball: int, point: FloatArray) -> Expected | None:
        radius = self._memory[ball].radius
        pixel = camera.project(point)[0]
        if radius is None or not np.isfinite(pixel).all():
            return None
        distance = float(np.linalg.norm(point - camera.position))
        size = camera.intrinsics.focal * radius / np.sqrt(max(distance**2 - radius**2, 1e-9))
        if not camera.sees(pixel, -size):
            return None
        return Expected(pixel, float(size), self._memory[ball].tolerance)

    def _map(self, job: Any, items: Sequence[Any]) -> list[Any]:
        return list(map(job, items) if self._pool is None else self._pool.map(job, items))

    def _follow(self, images: Sequence[Image | None], expected: list[list[Expected | None]]) -> None:
        """Look for every ball where it should be."""

        def camera_job(k: int) -> list[Found]:
            image = images[k]
            return [
                Found(None, "not found")
                if image is None or where is None
                else look_near(image, self.cameras[k], ball, where, self.rules)
                for ball, where in zip(self.target.balls, expected[k], strict=True)
            ]

        for views, found in zip(self._views, self._map(camera_job, range(len(images))), strict=True):
            for view, result in zip(views, found, strict=True):
                view.outline = result.outline
                if result.outline is None:
                    view.suspend(result.reason)

    def _acquire(self, images: Sequence[Image | None]) -> None:
        """Look for every ball everywhere; what several cameras agree on is trusted at once."""

        def camera_job(k: int) -> list[list[Outline]]:
            image = images[k]
            if image is None:
                return [[] for _ in self.target.balls]
            return [look_everywhere(image, self.cameras[k], ball) for ball in self.target.balls]

        candidates = self._map(camera_job, range(len(images)))
        for b, hypothesis in enumerate(acquire(self.cameras, self.target, candidates)):
            for k, views in enumerate(self._views):
                views[b].outline = None if hypothesis is None else hypothesis.views.get(k)
                if views[b].outline is None:
                    views[b].suspend("not found")
                else:
                    views[b].admit()

    def _agree(self, *, settled: bool) -> list[Located | None]:
        """Locate every ball from its trusted views; suspend those against the others, and count good frames."""
        located = []
        for b in range(len(self.target.balls)):
            seen = [(k, views[b]) for k, views in enumerate(self._views) if views[b].outline is not None]
            trusted = [(k, view) for k, view in seen if view.effective]
            few = len(trusted) < 2  # too few to judge the others by: all that see the ball are heard
            trusted = self._consensus(seen if few and settled else trusted)
            point = self._located(trusted)
            located.append(point)
            if point is not None:
                self._judge(b, seen, [k for k, _ in trusted], point)
        return located

    def _consensus(self, seen: list[tuple[int, View]]) -> list[tuple[int, View]]:
        """Leave out the worst view until the others agree; two that disagree cannot be told apart and both go."""
        seen = list(seen)
        while len(seen) >= 2:
            point = self._located(seen)
            if point is None:
                return []
            off = np.linalg.norm(point.residuals, axis=1)
            if float(off.max()) <= self.rules.reprojection_px:
                return seen
            if len(seen) == 2:
                for _, view in seen:
                    view.suspend("against the other cameras")
                return []
            seen.pop(self._worst(seen, off))
        return []

    def _worst(self, seen: list[tuple[int, View]], off: FloatArray) -> int:
        """Find the view without which the others agree best."""
        left = []
        for i in range(len(seen)):
            point = self._located(seen[:i] + seen[i + 1 :])
            left.append(np.inf if point is None else float(np.linalg.norm(point.residuals, axis=1).max()))
        return int(np.argmin(left)) if np.isfinite(left).any() else int(np.argmax(off))

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

    def _judge(self, ball: int, seen: list[tuple[int, View]], trusted: list[int], point: Located) -> None:
        """Admit, count or suspend every view that found something, by what the trusted ones say."""
        sizes = []
        for k, view in seen:
            assert view.outline is not None
            camera = self.cameras[k]
            if k in trusted:
                view.admit()
                sizes.append(float(np.linalg.norm(point.position - camera.position) * np.sin(view.outline.half_angle)))
                continue
            miss = float(np.linalg.norm(camera.project(point.position)[0] - view.outline.pixel))
            if miss > self.rules.reprojection_px:
                view.suspend("against the other cameras")
            else:
                view.count_good(self.rules.good_frames)
        if sizes and self.target.balls[ball].radius is None:
            self._memory[ball].learn_size(float(np.mean(sizes)))

    def _fitted(self, located: list[Located | None], time: float) -> PoseFit | None:
        """Fit the tool's pose to everything that is trusted in this frame; None when that is too little."""
        if not self.target.has_pose:
            return self._position(located)
        start = self._start(located, time)
        sightings = self._sightings()
        if start is None or sightings is None:
            return None
        try:
            fit = pose_from_sightings(self.cameras, self.target.places, sightings, start)
        except (DegenerateError, np.linalg.LinAlgError):
            return None
        limit = 2.0 * self.rules.reprojection_px
        return fit if float(np.sqrt(np.mean((fit.residuals**2).sum(axis=1)))) < limit else None

    def _sure(self) -> bool:
        """Whether three cameras agree on every ball: a jump that they all see is one."""
        return all(sum(views[b].effective for views in self._views) >= 3 for b in range(len(self.target.balls)))

    def _start(self, located: list[Located | None], time: float) -> FloatArray | None:
        known = [b for b, point in enumerate(located) if point is not None]
        if len(known) >= 3:
            points = np.array([point.position for point in located if point is not None])
            try:
                return pose_closed_form(points, self.target.places[known]).T_tracker_tool
            except DegenerateError:
                return None
        return self._filter.predicted(time) if known else None

    def _sightings(self) -> Sightings | None:
        """Trusted views of this frame; None unless three balls are seen, and by two cameras."""
        rows = [
            (k, b, view.outline)
            for k, views in enumerate(self._views)
            for b, view in enumerate(views)
            if view.effective and view.outline is not None
        ]
        if len({b for _, b, _ in rows}) < 3 or len({k for k, _, _ in rows}) < 2 or len(rows) < 4:
            return None
        return Sightings(
            np.array([k for k, _, _ in rows]),
            np.array([b for _, b, _ in rows]),
            np.array([o.ray for _, _, o in rows]),
            np.array([o.covariance for _, _, o in rows]),
        )

    def _position(self, located: list[Located | None]) -> PoseFit | None:
        """Without orientation: the mean of the balls, which all must be seen."""
        points = [point for point in located if point is not None]
        if len(points) < len(located):
            return None
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = sum(p.covariance for p in points) / len(points) ** 2
        covariance[3:, 3:] = TURN_UNKNOWN * np.eye(3)
        T = se3.pose(np.eye(3), np.mean([p.position for p in points], axis=0))
        return PoseFit(T, covariance, np.concatenate([p.residuals for p in points]))

    def _frame(self, time: float, pose: Filtered, fit: PoseFit | None, located: list[Located | None]) -> Frame:
        none = np.full(3, np.nan)
        return Frame(
            time,
            pose,
            fit if pose.status == "measured" else None,
            np.array([none if p is None else p.position for p in located]),
            np.array([none if p is None else np.sqrt(np.diag(p.covariance)) for p in located]),
            tuple(tuple(ViewState(v.effective, v.reason, v.outline) for v in views) for views in self._views),
            float("nan") if fit is None else float(np.sqrt(np.mean((fit.residuals**2).sum(axis=1)))),
        )
