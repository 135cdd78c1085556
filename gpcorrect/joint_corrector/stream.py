"""Estimates of a live stream of joints: velocity, slack and filters are carried on from sample to sample."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.errors import DataError
from gpcorrect.joint import CableModel, JointFeatures
from gpcorrect.joint_corrector.corrector import JointCorrector, JointEstimate
from gpcorrect.joint_corrector.gp import GPMap
from gpcorrect.play import advance
from gpcorrect.types import FloatArray

__all__ = ["JointStream"]

PAUSE_STEPS = 20.0  # of the training's step: the same pause after which a recorded path begins anew
USUAL_STEP = 1.0 / 30.0  # s, where a model does not say what it was trained on
ALMOST = 0.9  # of the training's step: clocks jitter
MOST_PAST = 4096  # samples kept to take a velocity over


class JointStream:
    """Answers samples one after the other; one stream an arm and thread.

    What it answers is what :meth:`JointCorrector.estimate` answers of the whole path, up to rounding. A stream that is
    faster than the training takes velocities over the training's step, not over its own: an encoder's last digit is
    no motion.

    Parameters
    ----------
    corrector : JointCorrector
        What answers.
    """

    def __init__(self, corrector: JointCorrector) -> None:
        self._corrector = corrector
        self._features = corrector.features
        self._pause = PAUSE_STEPS * float(corrector.summary.get("step_seconds", USUAL_STEP))
        self._window = ALMOST * float(corrector.summary.get("shortest_step_seconds", USUAL_STEP))
        self._dof = len(corrector.types)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after a homing or after the arm was moved by hand."""
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=MOST_PAST)
        self._memory: tuple[FloatArray, FloatArray, FloatArray] | None = None  # path, joints and lags so far
        learned = self._corrector.learned
        self._filters = learned.filters() if isinstance(learned, CableModel) else []

    def estimate(
        self, time: float, q: ArrayLike, effort: ArrayLike | None = None, state: ArrayLike | None = None
    ) -> JointEstimate:
        """Return corrected joints and standard deviations `(d,)` at `time`.

        Parameters
        ----------
        time : float
            Seconds; later than that of the sample before.
        q : (d,) array
            Reported (or, for commands, desired true) joints, rad or m. With a missing number the answer is NaN, and
            the path begins anew.
        effort : (d,) array, optional
            As logged; the answer is NaN where the model looks at efforts and none are given.
        state : (k,) array, optional
            For models of the whole state.

        Raises
        ------
        DataError
            The numbers do not fit the model, or time does not advance; the past is kept.
        """
        joints = self._numbers(q, self._dof, "joints")
        efforts = None if effort is None else self._numbers(effort, self._dof, "efforts")
        rest = None if state is None else self._numbers(state, self._features.n_state, "state columns")
        if not np.isfinite(time) or (self._past and time <= self._past[-1][0]):
            raise DataError(
                f"time must advance from sample to sample, got {time!r}.", hint="reset() begins a new path."
            )
        if self._past and time - self._past[-1][0] > self._pause:
            self.reset()
        if not np.isfinite(joints).all():
            self.reset()
            return self._answer(np.full(self._dof, np.nan), np.full(self._dof, np.nan))
        new = not self._past
        if isinstance(self._corrector.learned, CableModel):
            mean, std = self._filtered(self._corrector.learned, joints, efforts, new)
        else:
            mean, std = self._mapped(time, joints, efforts, rest)
        self._past.append((time, joints))
        return self._answer(mean, std)

    def _filtered(
        self, cable: CableModel, q: FloatArray, effort: FloatArray | None, new: bool
    ) -> tuple[FloatArray, FloatArray]:
        motor, told = cable.inputs(q[None], None if effort is None else effort[None])
        samples = zip(self._filters, motor[0].tolist(), told[0].tolist(), strict=True)
        mean, std = np.array([one.step(m, t, new) for one, m, t in samples]).T
        return mean, std

    def _mapped(
        self, time: float, q: FloatArray, effort: FloatArray | None, state: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        learned = self._corrector.learned
        assert not isinstance(learned, CableModel)
        columns = [self._columns(kind, time, q, effort, state) for kind in self._features.kinds]
        x = self._features.chosen(np.concatenate(columns))
        if not np.isfinite(x).all():
            return np.full(self._dof, np.nan), np.full(self._dof, np.nan)
        if isinstance(learned, GPMap):
            error, std = learned.predict_one(x)
        else:
            error, std = (part[0] for part in learned.predict(x[None]))
        return (error if self._corrector.end_to_end else q + error), std

    def _columns(
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
        given = effort if kind == "effort" else state
        size = self._dof if kind == "effort" else features.n_state
        return np.full(size, np.nan) if given is None else given

    def _velocity(self, time: float, q: FloatArray) -> FloatArray:
        """Over the latest sample that is about a training step old; until there is one, over the first."""
        if not self._past:
            return np.zeros(self._dof)
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

    def _answer(self, q: FloatArray, std: FloatArray) -> JointEstimate:
        return JointEstimate(q + self._corrector.zero, std)

    @staticmethod
    def _numbers(values: ArrayLike, size: int, what: str) -> FloatArray:
        numbers = np.array(values, dtype=np.float64)
        if numbers.shape != (size,):
            raise DataError(f"the model takes {size} {what}, got shape {numbers.shape}.")
        return numbers
