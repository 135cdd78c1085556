"""The tracker: pictures of all cameras at one moment in, the pose of the tool out.

Each ball in each camera is effective or suspended (Peng et al. 2020): a circle that jumps, has the wrong size or is not
found is suspended; five good frames that agree with the other cameras bring it back. While fewer than two cameras see a
ball its search widens, and narrows again.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray, IntArray
from gpcorrect.vision.agreement import LoneBall, View, acquire, agree, hypotheses, limit_px
from gpcorrect.vision.camera import Camera, require_two
from gpcorrect.vision.clocks import Clocks, Moment
from gpcorrect.vision.filtering import Filtered, PoseFilter, Status
from gpcorrect.vision.opencv import Image
from gpcorrect.vision.pose import (
    Located,
    Motion,
    Observations,
    PoseFit,
    along,
    pose_closed_form,
    pose_from_observations,
)
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.search import Found, Reason, detect_everywhere, detect_near
from gpcorrect.vision.settings import DEFAULT, VisionSettings
from gpcorrect.vision.target import Target


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
    time : float, seconds
    pose : Filtered, the estimated pose, and whether it was measured
    measured : PoseFit or None, what was measured in this very frame
    balls : (b, 3) array, centres of the balls, tracker frame, m; NaN for a ball that fewer than two cameras see
    views : tuple (cameras) of tuple (balls) of View, what each camera saw
    reprojection_px : float, RMS over the observations that were used; NaN without any
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
    cameras : sequence of Camera, calibrated; DataError for fewer than two
    target : Target
    settings : VisionSettings, when a ball is one, when a view is trusted, how the tool may move
    workers : int
        Whole pictures that are searched at the same time. Where the balls are expected they are looked for one by one:
        threads would wait for each other there.
    clocks : Clocks, optional, what is known already of when each camera looks; learned further
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        target: Target,
        settings: VisionSettings = DEFAULT,
        workers: int = 2,
        clocks: Clocks | None = None,
    ) -> None:
        require_two(cameras)
        self.cameras, self.target, self.settings = cameras, target, settings
        self._filter = PoseFilter(settings.motion)
        self._views = [[View() for _ in target.balls] for _ in cameras]
        self._forget_sizes()
        # Two balls leave the turn about their line open: what is followed is their middle, on that line.
        self._places = target.places - (target.places.mean(axis=0) if len(target.balls) == 2 else 0.0)
        self.clocks = clocks or Clocks(cameras, settings.clocks)
        self._past: list[Moment] = []  # frames with whose motion delays are learned
        self._lone = LoneBall(settings.agreement)
        self._spread = 1.0  # running mean of chi squared a degree of freedom, at least 1
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
        time : float, seconds, increasing

        Raises
        ------
        DataError
            The number of pictures is not that of the cameras, or a picture has another size than its calibration.
        """
        self._check(images)
        frame_time, time = time, time + self.clocks.middle  # rows are read about then, and nothing is moved far
        predicted, motion = self._filter.predicted(time), self._filter.motion(time)
        fit = None
        balls: list[Located | None] = []
        sizes: list[list[float]] = []
        if predicted is not None:
            self._follow(images, time)
            balls, sizes = self._agree(motion, predicted, settled=True)
            fit = self._fitted(balls, predicted, motion)
        anew = fit is None and self._wait == 0
        if anew:
            followed = self._copied()
            self._acquire(images, time, predicted)
            balls, sizes = self._agree(motion, predicted, settled=False)
            fit = self._fitted(balls, predicted, motion)
            if fit is None:  # what was found is not the tool, or not enough of it
                self._views = followed if predicted is not None else self._copied()
        self._wait = 0 if fit is not None else (self._wait or self.settings.views.patience) - 1
        trusted = [sum(views[b].effective for views in self._views) for b in range(len(self.target.balls))]
        # A jump that three cameras agree on for every ball is one; of two cameras it must show again.
        measured = (None, None) if fit is None else (fit.T_tracker_tool, fit.covariance)
        pose = self._filter.step(time, *measured, sure=min(trusted) >= 3)
        views = self.settings.views
        for memory, seeing in zip(self._memory, trusted, strict=True):
            factor = views.widen if seeing < 2 else 1.0 / views.widen
            memory.tolerance = float(np.clip(memory.tolerance * factor, 1.0, views.widest))
        none = np.full(3, np.nan)
        if fit is None or pose.status != Status.MEASURED:  # a ball is reported as part of the tool, or not at all
            fit, balls = None, [None] * len(self.target.balls)
        else:
            self._remember(sizes)
            if motion is None:
                self._past = []
            else:
                self._learn(fit, time)
        if pose.status == Status.LOST:
            self._forget_sizes()
        if self.clocks.middle and pose.status != Status.LOST:
            back = self._filter.predicted(frame_time)
            assert back is not None
            change = se3.compose(back, se3.invert(pose.T_tracker_tool))
            pose = replace(pose, T_tracker_tool=back)
            fit = None if fit is None else replace(fit, T_tracker_tool=se3.compose(change, fit.T_tracker_tool))
            balls = [p and replace(p, position=change[:3, :3] @ p.position + change[:3, 3]) for p in balls]
        return Frame(
            frame_time,
            pose,
            fit,
            np.array([none if p is None else p.position for p in balls]),
            tuple(tuple(replace(view) for view in row) for row in self._views),
            float("nan") if fit is None else fit.rms,
        )

    def _forget_sizes(self) -> None:
        """Know of each ball what the target says: a size that was seen may have been another thing's."""
        self._memory = [_BallMemory(ball.radius) for ball in self.target.balls]

    def _remember(self, sizes: Sequence[Sequence[float]]) -> None:
        """Learn the sizes that the target leaves open from a pose that was believed."""
        for ball, memory, seen in zip(self.target.balls, self._memory, sizes, strict=True):
            if seen and ball.radius is None:
                memory.sizes = [*memory.sizes[-self.settings.views.size_memory :], float(np.mean(seen))]
                memory.radius = float(np.median(memory.sizes))

    def _copied(self) -> list[list[View]]:
        """Return the views as they are, none of them seen in this frame yet."""
        return [[replace(view, outline=None) for view in row] for row in self._views]

    def _check(self, images: Sequence[Image | None]) -> None:
        if len(images) != len(self.cameras):
            raise DataError(f"{len(self.cameras)} cameras are calibrated, {len(images)} pictures came.")
        for camera, image in zip(self.cameras, images, strict=True):
            if image is not None:
                camera.intrinsics.require_size(image, camera.name)

    def _follow(self, images: Sequence[Image | None], time: float) -> None:
        """Find every ball where a camera should see it by the time of its own picture."""
        rows = zip(self.cameras, images, self._views, self.clocks.delays, strict=True)
        for camera, image, views, delay in rows:
            T = self._filter.predicted(time + delay)
            for ball, place, memory, view in zip(self.target.balls, self._places, self._memory, views, strict=True):
                expected = None
                if image is not None and T is not None:
                    expected = _expected(camera, memory, T[:3, :3] @ place + T[:3, 3])
                found = Found(None, Reason.NOT_FOUND)
                if expected is not None:
                    found = detect_near(image, camera, ball, expected, memory.tolerance, self.settings)
                view.outline = found.outline
                if found.outline is None:
                    good = self.settings.views.good_frames if view.effective else view.good
                    view.suspend(found.reason)
                    view.good = good if image is None else 0  # a lost picture says nothing against its camera

    def _acquire(self, images: Sequence[Image | None], time: float, predicted: FloatArray | None) -> None:
        """Find every ball anywhere; what several cameras agree on is trusted at once."""

        def camera_job(k: int) -> list[list[Outline]]:
            if images[k] is None:
                return [[] for _ in self.target.balls]
            return [detect_everywhere(images[k], self.cameras[k], ball, self.settings) for ball in self.target.balls]

        cameras = range(len(self.cameras))
        candidates = list(map(camera_job, cameras) if self._pool is None else self._pool.map(camera_job, cameras))
        if len(self.target.balls) == 1:
            options = hypotheses(
                self.cameras, [c[0] for c in candidates], self._memory[0].radius, self.settings.agreement
            )
            found = [self._lone.choose(options, time, None if predicted is None else predicted[:3, 3])]
        else:
            found = acquire(self.cameras, self.target, candidates, self.settings.agreement)
        for b, hypothesis in enumerate(found):
            for k, views in enumerate(self._views):
                views[b].outline = None if hypothesis is None else hypothesis.views.get(k)
                if views[b].outline is None:
                    views[b].suspend(Reason.NOT_FOUND)
                else:
                    views[b].admit()

    def _agree(
        self, motion: Motion | None, predicted: FloatArray | None, *, settled: bool
    ) -> tuple[list[Located | None], list[list[float]]]:
        """Locate every ball at the frame's time, and its size in each view; `settled`: too few trusted, try all."""
        located, sizes = [], []
        for b, place in enumerate(self._places):
            row = [views[b] for views in self._views]
            if predicted is not None:
                self._shift(row, place, predicted, motion)
            point, seen = agree(row, self.cameras, self.settings.views, settled=settled)
            located.append(point)
            sizes.append(seen)
        return located, sizes

    def _shift(self, row: list[View], place: FloatArray, T: FloatArray, motion: Motion | None) -> None:
        """Say of a ball's views by how much later than the frame they were taken, and what it moved by then."""
        arm, stds, start = T[:3, :3] @ place, self.clocks.stds, self.settings.clocks.start_speed
        speed = np.zeros(3) if motion is None else motion.twist[:3] + np.cross(motion.twist[3:], arm)
        unsure = 0.0 if motion is None else float(np.sqrt(np.trace(motion.covariance[:3, :3])))
        for k, view in enumerate(row):
            if view.outline is not None:
                camera, rows = self.cameras[k], view.outline.pixel[1:]
                view.delay = 0.0 if motion is None else float(self.clocks.of_views(np.array([k]), rows)[0])
                before, after = camera.local(np.stack([arm + T[:3, 3], arm + T[:3, 3] + view.delay * speed]))
                view.shift = after[:2] / after[2] - before[:2] / before[2]
                lag = (start if motion is None else np.linalg.norm(speed)) * stds[k] + unsure * abs(view.delay)
                view.slack_px = camera.intrinsics.focal * float(lag / max(before[2], 1e-9))

    def _fitted(
        self, located: list[Located | None], predicted: FloatArray | None, motion: Motion | None
    ) -> PoseFit | None:
        """Fit the tool's pose to everything that is trusted in this frame; None when that is too little."""
        observations, start = self._observations(), self._start(located, predicted)
        if observations is None or start is None:
            return None
        try:
            fit = pose_from_observations(self.cameras, self._places, observations, start, motion)
        except (DegenerateError, np.linalg.LinAlgError):
            return None
        seen = [view for row in self._views for view in row if view.effective and view.outline is not None]
        limit = float(np.mean([limit_px(view, self.settings.views) for view in seen]))
        return self._judged(fit, observations.camera, motion) if fit.rms < limit else None

    def _start(self, located: list[Located | None], predicted: FloatArray | None) -> FloatArray | None:
        """Return a pose near that of the balls that were located, else the predicted one."""
        found = [(p.position, place) for p, place in zip(located, self._places, strict=True) if p is not None]
        if not found:
            return None
        points, places = map(np.array, zip(*found, strict=True))
        if len(found) >= 3:
            try:
                return pose_closed_form(points, places).T_tracker_tool
            except DegenerateError:  # these lie on a line
                return predicted
        if len(found) < len(located):
            return predicted
        R = np.eye(3) if predicted is None else predicted[:3, :3]
        if len(found) == 2:
            R = along(points[1] - points[0], places[1] - places[0], R)
        return se3.pose(R, points.mean(axis=0))

    def _judged(self, fit: PoseFit, cameras: IntArray, motion: Motion | None) -> PoseFit:
        """Fit with what the covariances of single views do not hold: what all leave together, and the clocks."""
        assert fit.linearised is not None
        now, memory = fit.linearised.chi_squared, self.settings.views.spread_memory
        self._spread = max(1.0, self._spread + (now - self._spread) / memory)
        covariance = fit.covariance * max(now, self._spread)
        covariance = covariance + fit.linearised.shifted(cameras, max(now, self._spread) - 1.0, self._against(fit))
        covariance = covariance + self.clocks.spread(fit.linearised, cameras)
        if motion is None:  # by how much the tool moved until these views is not known yet
            rows = [v.outline.pixel[1] for row in self._views for v in row if v.effective and v.outline is not None]
            late = float(np.mean(np.abs(self.clocks.of_views(cameras, np.array(rows))))) + self.clocks.middle
            covariance[:3, :3] += (self.settings.clocks.start_speed * late) ** 2 * np.eye(3)
        usual = self.settings.motion  # what a constant velocity leaves until the middle of the readout
        change = np.array([usual.usual_acceleration] * 3 + [usual.usual_angular_acceleration] * 3)
        return replace(fit, covariance=covariance + np.diag((change * self.clocks.middle**2) ** 2))

    def _against(self, fit: PoseFit) -> float:
        """Return the mean square by which suspended views miss a pose, a coordinate, on the plane before the lens.

        Zero where those that are trusted agree: the others are wrong then. Where they do not, nothing tells which are.
        """
        if self._spread < self.settings.views.doubt:
            return 0.0
        T, missed = fit.T_tracker_tool, []
        for camera, views in zip(self.cameras, self._views, strict=True):
            for place, view in zip(self._places, views, strict=True):
                if view.outline is not None and not view.effective:
                    local = camera.local(T[:3, :3] @ place + T[:3, 3])[0]
                    missed.append(view.outline.ray - view.shift - local[:2] / local[2])
        return float(np.mean(np.square(missed))) if missed else 0.0

    def _learn(self, fit: PoseFit, time: float) -> None:
        """Learn the delays from the middle one of the last frames: how the tool moved on from it is known by now."""
        observations, reach = self._observations(), self.settings.clocks.reach
        if observations is not None:
            moment = Moment(time, fit.T_tracker_tool, observations, self.clocks.delays)
            self._past = [*self._past[-2 * reach :], moment]
            if len(self._past) in range(3, 2 * reach + 2, 2):
                self.clocks.learn(self._past, self._places)

    def _observations(self) -> Observations | None:
        """Trusted views of this frame; None when they are too few for all that is to be found."""
        rows = [
            (k, b, view.outline, view.delay)
            for k, views in enumerate(self._views)
            for b, view in enumerate(views)
            if view.effective and view.outline is not None
        ]
        least = min(3, len(self.target.balls))
        if len({b for _, b, *_ in rows}) < least or len({k for k, *_ in rows}) < 2 or len(rows) <= least:
            return None
        cameras, balls, outlines, delays = zip(*rows, strict=True)
        rays, covariances = np.array([o.ray for o in outlines]), np.array([o.covariance for o in outlines])
        return Observations(np.array(cameras), np.array(balls), rays, covariances, np.array(delays))


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
