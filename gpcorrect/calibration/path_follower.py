"""Features of a joint path, one sample after the other, for streams."""

from __future__ import annotations

from collections import deque

import numpy as np

from gpcorrect.calibration.joint_features import JointFeatures
from gpcorrect.calibration.memory import advance, lag_step
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

ALMOST = 0.9
"""Of the training's shortest step, over which a faster stream takes its velocities: clocks jitter; chosen by hand."""
MOST_PAST = 4096  # samples stored to take a velocity over: bounds the memory of a stream; chosen by hand


class PathFollower:
    """Features of a joint path, sample by sample: as :meth:`JointFeatures.transform` gives them for the whole path.

    A stream that is faster than the training takes velocities over the training's step, not over its own: there
    an encoder's last digit would show as motion.

    Parameters
    ----------
    features : JointFeatures, what to follow
    usual_step, shortest_step : float, time between samples in training, s
    """

    def __init__(self, features: JointFeatures, usual_step: float, shortest_step: float) -> None:
        self._features = features
        self._pause = max(LIMITS.pause_steps * usual_step, LIMITS.pause_seconds)
        self._window = ALMOST * shortest_step
        self.reset()

    def reset(self) -> None:
        """Forget the path."""
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=MOST_PAST)
        self._memory: tuple[FloatArray, FloatArray, FloatArray] | None = None  # path, joints and plays so far
        self._followed: dict[str, tuple[FloatArray, FloatArray]] = {}  # signals where last known, and lags behind them

    @property
    def new(self) -> bool:
        """Whether the next sample begins a path."""
        return not self._past

    def arrive(self, time: float) -> None:
        """Refuse a sample whose time does not advance; forget the path after a pause.

        Parameters
        ----------
        time : float, time of the sample, s
        """
        if not np.isfinite(time) or (self._past and time <= self._past[-1][0]):
            raise DataError(
                f"time must advance from sample to sample, got {time!r}.", hint="reset() begins a new path."
            )
        if self._past and time - self._past[-1][0] > self._pause:
            self.reset()

    def columns(self, time: float, q: FloatArray, effort: FloatArray | None, state: FloatArray | None) -> FloatArray:
        """Return the features `(k,)` of joints `q` (d,), NaN where the law needs what is not given.

        Parameters
        ----------
        time : float, s
        q : (d,) array, Joints, rad or m
        effort : (d,) array or None, as logged
        state : (k,) array or None, whole state
        """
        parts = [self._column(kind, time, q, effort, state) for kind in self._features.kinds]
        return np.concatenate(parts)[self._features.used]

    def passed(self, time: float, q: FloatArray) -> None:
        """Note where the joints were.

        Parameters
        ----------
        time : float, s
        q : (d,) array, Joints, rad or m
        """
        self._past.append((time, q))

    def _column(
        self, kind: str, time: float, q: FloatArray, effort: FloatArray | None, state: FloatArray | None
    ) -> FloatArray:
        features = self._features
        match kind:
            case "position":
                return features.scaled(q)
            case "velocity":
                return self._velocity(time, q) / features.half
            case "acceleration":
                changes = self._behind(kind, time, self._velocity(time, q) / features.half, features.rates)
                return (changes / features.rates[:, None]).ravel()
            case "memory":
                return self._remember(features, features.scaled(q))
            case "lags":
                signals = features.lagged_signals(features.scaled(q), effort)
                return self._behind(kind, time, signals, features.lags).ravel()
        given = effort if kind == "effort" else state
        size = len(features.centre) if kind == "effort" else features.n_state
        return np.full(size, np.nan) if given is None else given

    def _velocity(self, time: float, q: FloatArray) -> FloatArray:
        """Over the latest sample that is about a training step old; until there is one, over the first."""
        if not self._past:
            return np.zeros(len(q))
        while len(self._past) > 1 and time - self._past[1][0] > self._window:
            self._past.popleft()
        then, before = self._past[0]
        velocity: FloatArray = (q - before) / (time - then)
        return velocity

    def _remember(self, features: JointFeatures, path: FloatArray) -> FloatArray:
        """Advance the slacks to `path` (d,), in units of half the ranges, and return their features."""
        assert features.play is not None
        if self._memory is None:
            joints, lags = path, np.zeros(features.ladder.shape)
        else:
            before, joints, lags = self._memory
            joints, lags = features.play.advance(joints, path), advance(lags, path - before, features.ladder)
        self._memory = path, joints, lags
        return np.concatenate([path - joints, (lags / features.ladder).ravel()])

    def _behind(self, kind: str, time: float, signals: FloatArray, constants: FloatArray) -> FloatArray:
        """Return by how much lags `(t, s)` are behind their signals `(s,)` now."""
        if kind not in self._followed:
            self._followed[kind] = signals, np.zeros((len(constants), len(signals)))
        else:
            last, behind = self._followed[kind]
            behind = lag_step(behind, signals - last, time - self._past[-1][0], constants)
            self._followed[kind] = np.where(np.isfinite(signals), signals, last), behind
        return self._followed[kind][1]
