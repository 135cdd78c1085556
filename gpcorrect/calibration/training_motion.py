"""What motion the training showed: what cannot be in its units is refused, and what no arm can follow is bridged."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.cleaning import FittedCleaner
from gpcorrect.cleaning.steps import best_chain
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, frozen_array

UNITS = "radians and metres"  # of joints

STRIDE = 5  # samples between which a speed is taken: noise of a tracker then adds little to it
FASTER = 90.0
"""Per cent of the speeds below the one that motions are compared by: rests and faults of the tracker say nothing."""
LONGEST_LOOK = 64  # samples of a stream that are looked at together: at 1 kHz they cover some millimetres
POSSIBLE_FRACTION = 0.7  # least part of a run that must be possible motion, or it is left as it is; chosen by hand


@dataclass(frozen=True, eq=False)
class TrainingMotion:
    """What the training's motion was like, in the quantity that queries are given in."""

    # (k,) each: range of the k coordinates, m or rad
    low: FloatArray
    high: FloatArray
    # (k,) what lengths are measured by in each coordinate, m or rad: the widest range of a position, each joint's own
    size: FloatArray
    speed: float  # sizes per second that the training reached when it moved; NaN for static poses

    def __post_init__(self) -> None:
        for name in ("low", "high", "size"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        if self.low.ndim != 1 or not self.low.shape == self.high.shape == self.size.shape or not (self.size > 0).all():
            raise DataError(
                f"no training moved from {self.low} to {self.high}, measured by {self.size}: the numbers do not fit."
            )

    @classmethod
    def of(cls, path: FloatArray, log: CalibrationLog, keep: BoolArray, *, joints: bool) -> Self:
        """Return what a training's motion was like.

        Parameters
        ----------
        path : (n, k) array, positions or joints, m or rad
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that were not rejected
        joints : bool, whether each coordinate is measured by its own range
        """
        keep = keep & np.isfinite(path).all(axis=1)
        low, high = np.percentile(path[keep], LIMITS.range_quantiles, axis=0)
        size = np.maximum(high - low if joints else np.full(path.shape[1], (high - low).max()), np.finfo(float).tiny)
        speed = np.nan if log.static else _speed(path[keep] / size, log.time[keep], log.trajectory[keep])
        return cls(low, high, size, speed)

    def widened(self, other: Self) -> Self:
        """Return the range that holds both, with the sizes and speed of this one.

        Parameters
        ----------
        other : TrainingMotion, of the same coordinates
        """
        return type(self)(np.minimum(self.low, other.low), np.maximum(self.high, other.high), self.size, self.speed)

    def refuse_far(self, query: FloatArray, unit: str = "metres") -> None:
        """Refuse what lies where no arm of this training can be: millimetres, or degrees.

        Parameters
        ----------
        query : (n, k) or (k,) array, positions or joints, m or rad; NaN where missing
        unit : str, what they are taken for

        Raises
        ------
        DataError
            A coordinate lies beyond the training's by more than `LIMITS.far_sizes` times its size and
            `LIMITS.far_least`.
        """
        beyond = np.maximum(self.low - query, query - self.high)
        far = beyond > np.maximum(LIMITS.far_sizes * self.size, LIMITS.far_least)
        if far.any():
            row, column = np.argwhere(np.atleast_2d(far))[0]
            raise DataError(
                f"coordinate {column + 1} is {np.atleast_2d(query)[row, column]:.6g}, and the training lies between "
                f"{self.low[column]:.3g} and {self.high[column]:.3g}: no arm is so far off what it was trained on.",
                hint=f"Give {unit}, in the frame that the model was trained in.",
            )

    def refuse_slow(self, path: FloatArray, time: FloatArray, labels: IntArray | None = None) -> None:
        """Refuse a path whose times cannot be seconds: milliseconds, taken for seconds, make it 1000 times slower.

        A slow path with the usual rate of samples is none; nor is one that hardly moves.

        Parameters
        ----------
        path : (n, k) array, positions or joints, m or rad; NaN where missing
        time : (n,) array, s
        labels : (n,) int array, optional, unbroken run of each sample; one run without it

        Raises
        ------
        DataError
            The path is both sampled and travelled too slowly.
        """
        labels = np.zeros(len(time), dtype=np.int64) if labels is None else labels
        known = np.isfinite(path).all(axis=1) & np.isfinite(time)
        path, time, labels = path[known] / self.size, time[known], labels[known]
        steps = np.diff(time)[np.diff(labels) == 0] if len(time) else np.empty(0)
        if len(steps) < STRIDE or not np.median(steps) >= LIMITS.slow_step:
            return
        if np.linalg.norm(np.ptp(path, axis=0)) < LIMITS.slow_travel:
            return
        speed = _speed(path, time, labels)
        if speed * LIMITS.slow_ratio < self.speed:
            raise DataError(
                f"the path takes {np.median(steps):.3g} s from sample to sample and is {self.speed / speed:.0f} times "
                "slower than the training: these are no seconds.",
                hint="Times are seconds; divide milliseconds by 1000.",
            )


class StreamGuard:
    """Lets through what can be the next sample of a stream of this training's arm; what is refused leaves no trace.

    Parameters
    ----------
    training : TrainingMotion, what it is compared with
    unit : str, what the samples are taken for
    """

    def __init__(self, training: TrainingMotion, unit: str = "metres") -> None:
        self._training, self._unit = training, unit
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._past: list[tuple[float, FloatArray]] = []

    def admit(self, time: float, point: FloatArray) -> None:
        """Take one more sample, or refuse it.

        Parameters
        ----------
        time : float, s
        point : (k,) array, position or joints, m or rad; NaN where missing

        Raises
        ------
        DataError
            Time does not advance, the point is where no arm of the training can be, or the times cannot be seconds.
        """
        if not np.isfinite(time) or (self._past and time <= self._past[-1][0]):
            raise DataError(
                f"time must advance from sample to sample, got {time!r}.", hint="reset() begins a new path."
            )
        self._training.refuse_far(point, self._unit)
        slow = bool(self._past) and time - self._past[-1][0] >= LIMITS.slow_step
        past = [*(self._past[-LONGEST_LOOK + 1 :] if slow else ()), (time, point)]
        if len(past) > STRIDE:
            times, points = zip(*past, strict=True)
            self._training.refuse_slow(np.array(points), np.array(times))
        self._past = past


def _speed(path: FloatArray, time: FloatArray, labels: IntArray) -> float:
    """Speed of the faster parts of a path `(n, k)`, per second; NaN where no run has two samples."""
    stride = min(STRIDE, max(int(np.bincount(np.unique(labels, return_inverse=True)[1]).max(initial=1)) - 1, 1))
    same = labels[stride:] == labels[:-stride]
    seconds = (time[stride:] - time[:-stride])[same]
    lengths = np.linalg.norm(path[stride:] - path[:-stride], axis=1)[same]
    forward = seconds > 0
    return float(np.percentile(lengths[forward] / seconds[forward], FASTER)) if forward.any() else np.nan


@dataclass(frozen=True)
class MotionLimits:
    """Limits of motion that no working arm exceeds from one sample to another: lone jumps beyond them are bridged.

    A tracker's occlusion, or a planner's slip, shows in a path as impossible speeds into and out of a short stretch.
    Asked to correct such a pose as it stands, a model would move the robot to where nothing ever was. The same limits
    that cleaning learned for recordings hold here.
    """

    speeds: tuple[float, ...]  # largest speed, m/s, and where orientations are observed rad/s
    noise: tuple[float, ...]  # step that noise alone can make, m and rad
    longest: float  # longest stretch that is bridged, s; what lasts longer may be meant

    @classmethod
    def of(cls, cleaner: FittedCleaner) -> Self:
        """Limits that cleaning learned from the training recording.

        Parameters
        ----------
        cleaner : FittedCleaner, cleaning of the training recording
        """
        steps = cleaner.thresholds.steps
        return cls(tuple(steps.speeds.tolist()), tuple(steps.noise.tolist()), cleaner.settings.occlusion_time)

    def bridge(
        self, signal: PoseSignal, reference: PoseSignal, time: FloatArray, labels: IntArray
    ) -> tuple[PoseSignal, BoolArray]:
        """Return the path with its lone jumps replaced by straight motion, and the mask (n,) of replaced samples.

        Parameters
        ----------
        signal : PoseSignal, n desired poses
        reference : PoseSignal, the same in the robot's frame, where the limits were learned
        time : (n,) array, s
        labels : (n,) int array, unbroken run of each sample, -1 for none
        """
        bridged = np.zeros(len(signal), dtype=bool)
        for label in np.unique(labels[labels >= 0]):
            rows = np.flatnonzero(labels == label)
            bridged[rows] = self._jumps(reference[rows], time[rows])
        if not bridged.any():
            return signal, bridged
        position = signal.position.copy()
        quaternion = None if signal.quaternion is None else signal.quaternion.copy()
        for label in np.unique(labels[bridged]):
            good, bad = (np.flatnonzero((labels == label) & mask) for mask in (~bridged, bridged))
            for axis in range(3):
                position[bad, axis] = np.interp(time[bad], time[good], position[good, axis])
            if quaternion is not None:
                turned = se3.interpolate_rotations(time[good], se3.matrix_from_quaternion(quaternion[good]), time[bad])
                quaternion[bad] = se3.quaternion_from_matrix(turned)
        return PoseSignal(position, quaternion), bridged

    def _jumps(self, path: PoseSignal, time: FloatArray) -> BoolArray:
        """Find the samples (n,) of one run that lie off its longest possible motion, between samples that lie on it."""
        cuts = np.flatnonzero(self._too_far(path, time, np.arange(len(time) - 1), np.arange(1, len(time))))
        off, on = np.zeros((2, len(time)), dtype=bool)
        if not len(cuts):
            return off
        first, last = np.concatenate([[0], cuts + 1]), np.concatenate([cuts, [len(time) - 1]])
        chain = best_chain(last - first + 1, first, last, lambda i, j: ~self._too_far(path, time, i, j))
        for k in chain:
            on[first[k] : last[k] + 1] = True
        if on.mean() < POSSIBLE_FRACTION:
            return off
        for a, b in pairwise(chain):
            off[last[a] + 1 : first[b]] = time[first[b]] - time[last[a]] <= self.longest
        return off

    def _too_far(self, path: PoseSignal, time: FloatArray, i: IntArray, j: IntArray) -> BoolArray:
        """Mask (m,) of the steps from samples i to later samples j that are faster than any arm."""
        dt = time[j] - time[i]
        steps = [np.linalg.norm(path.position[j] - path.position[i], axis=1)]
        if path.quaternion is not None and len(self.speeds) > 1:
            steps.append(se3.quaternion_angle(path.quaternion[i], path.quaternion[j]))
        limits = zip(steps, self.speeds, self.noise, strict=False)
        return np.asarray(np.any([step - noise > speed * dt for step, speed, noise in limits], axis=0))
