"""Features of a joint path, one sample after the other, for streams."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from gpcorrect.calibration.joint_features import JointFeatures
from gpcorrect.calibration.memory import advance, lag_step
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["PathFollower"]

ALMOST = 0.9
"""Of the training's shortest step, over which a faster stream takes its velocities: clocks jitter; chosen by hand."""
MOST_PAST = 4096
"""Samples stored to take a velocity over: bounds the memory of a stream; chosen by hand."""


class PathFollower:
    """Features of a joint path, sample by sample: as :meth:`JointFeatures.transform` gives them for the whole path.

    A stream that is faster than the training takes velocities over the training's step, not over its own: there
    an encoder's last digit would show as motion.

    Parameters
    ----------
    features : JointFeatures
        What to follow.
    usual_step, shortest_step : float
        Time between samples in training, s.
    """

    def __init__(self, features: JointFeatures, usual_step: float, shortest_step: float) -> None:
        self._features = features
        self._pause = max(LIMITS.pause_steps * usual_step, LIMITS.pause_seconds)
        self._window = ALMOST * shortest_step
        self.reset()

    def reset(self) -> None:
        """Forget the path."""
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=MOST_PAST)
        self._memory: _Slack | None = None
        self._before_memory: _Slack | None = None
        self._lags: _Lags | None = None
        self._before_lags: _Lags | None = None

    @property
    def new(self) -> bool:
        """Whether the next sample begins a path."""
        return not self._past

    def arrive(self, time: float) -> None:
        """Refuse a sample whose time does not advance; forget the path after a pause.

        Parameters
        ----------
        time : float
            Time of the sample, s.

        Raises
        ------
        DataError
            Time stands still or runs back; the past stays.
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
        time : float
            s.
        q : (d,) array
            Joints, rad or m.
        effort : (d,) array or None
            As logged.
        state : (k,) array or None
            Whole state.
        """
        parts = [self._column(kind, time, q, effort, state) for kind in self._features.kinds]
        return np.concatenate(parts)[self._features.used]

    def passed(self, time: float, q: FloatArray, told: FloatArray | None = None) -> None:
        """Note where the joints were, and where the drive was sent.

        Parameters
        ----------
        time : float
            s.
        q : (d,) array
            Joints, rad or m.
        told : (d,) array, optional
            See :class:`JointPath`; `q` itself without it.
        """
        if told is not None:
            self._send(self._features.scaled(told), time)
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
            case "memory":
                return self._remember(features, features.scaled(q))
            case "lags":
                return self._behind(time, features.lagged_signals(features.scaled(q), effort))
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
        before, self._before_memory = self._memory, self._memory
        if before is None:
            motors, joints, lags = path, path, np.zeros(features.ladder.shape)
        else:
            motors = path + (before.motors - before.path)
            joints = features.play.advance(before.joints, motors)
            lags = advance(before.lags, path - before.path, features.ladder)
        self._memory = _Slack(path, motors, joints, lags)
        return np.concatenate([motors - joints, (lags / features.ladder).ravel()])

    def _behind(self, time: float, signals: FloatArray) -> FloatArray:
        """Return by how much the lags are behind their signals `(s,)` now."""
        constants = self._features.lags
        before, self._before_lags = self._lags, self._lags
        if before is None:
            self._lags = _Lags(signals, signals, np.zeros((len(constants), len(signals))))
        else:
            behind = lag_step(before.behind, signals - before.signals, time - self._past[-1][0], constants)
            last = np.where(np.isfinite(signals), signals, before.signals)
            self._lags = _Lags(last, last + (before.told - before.signals), behind)
        return self._lags.behind.ravel()

    def _send(self, told: FloatArray, time: float) -> None:
        """Take back the last step, which was along the path, and go where the drive was told (d,)."""
        if self._memory is not None and self._features.play is not None:
            before, path = self._before_memory, self._memory.path
            if before is None:
                self._memory = _Slack(path, told, told, np.zeros(self._features.ladder.shape))
            else:
                joints = self._features.play.advance(before.joints, told)
                lags = advance(before.lags, told - before.motors, self._features.ladder)
                self._memory = _Slack(path, told, joints, lags)
        if self._lags is not None:
            sent = np.concatenate([told, self._lags.signals[len(told) :]])
            if self._before_lags is None:
                self._lags = _Lags(self._lags.signals, sent, np.zeros(self._lags.behind.shape))
            else:
                step = time - self._past[-1][0]
                moved = sent - self._before_lags.told
                behind = lag_step(self._before_lags.behind, moved, step, self._features.lags)
                self._lags = _Lags(self._lags.signals, sent, behind)


class _Slack(NamedTuple):
    """A path's last place, where the drive was sent, and where that left the joints and the plays (h, d)."""

    path: FloatArray
    motors: FloatArray
    joints: FloatArray
    lags: FloatArray


class _Lags(NamedTuple):
    """Signals where they were last known, what the drive was told then, and how far the lags (t, s) are behind."""

    signals: FloatArray
    told: FloatArray
    behind: FloatArray
