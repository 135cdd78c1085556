"""Single samples that no arm can have reached, as an encoder's spike: they must not move what a path remembers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from gpcorrect.calibration.settings import LIMITS
from gpcorrect.calibration.training_motion import TrainingMotion
from gpcorrect.types import BoolArray, FloatArray, IntArray


class Step(Enum):
    """What a sample is to the path before it."""

    ON = auto()  # it goes on with it
    LEAP = auto()  # it cannot: the path stays where it was
    ANEW = auto()  # it goes on with the leap just before: the arm is there after all, and the path begins anew


@dataclass(frozen=True, eq=False)
class Pace:
    """How far joints can get from one sample to the next, by the training's motion."""

    training: TrainingMotion
    usual_step: float  # s between samples in training: a faster stream may repeat a reading and then catch up

    @property
    def pause(self) -> float:
        """Wait, s, that ends a path: the arm may have moved."""
        return max(LIMITS.pause_steps * self.usual_step, LIMITS.pause_seconds)

    def too_far(self, moved: FloatArray, seconds: FloatArray | float) -> BoolArray:
        """Return which steps `(...)` no arm of this training makes; none where it is not known how fast it was.

        Parameters
        ----------
        moved : (..., d) array, steps of the joints, rad or m
        seconds : (...) array or float, s that each took
        """
        size = self.training.size
        lengths = np.sqrt(((moved / np.where(size > LIMITS.leap_least, size, np.inf)) ** 2).sum(axis=-1))
        fastest = LIMITS.leap_speeds * self.training.speed
        return np.asarray(lengths > fastest * np.maximum(seconds, self.usual_step))


class Follower:
    """Says of one sample after the other whether it goes on with the path.

    Parameters
    ----------
    pace : Pace, of the arm
    """

    def __init__(self, pace: Pace) -> None:
        self._pace = pace
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._last: tuple[float, FloatArray] | None = None  # where the path was last
        self._leap: tuple[float, FloatArray] | None = None  # the sample before, where it was a leap

    def step(self, time: float, q: FloatArray) -> Step:
        """Return what a sample is; one with a missing number ends the path.

        Parameters
        ----------
        time : float, s, later than before
        q : (d,) array, joints, rad or m
        """
        here = (time, q) if np.isfinite(q).all() else None
        found = Step.ON
        if here and self._last and time - self._last[0] <= self._pace.pause and self._apart(self._last, here):
            found = Step.LEAP if self._leap is None or self._apart(self._leap, here) else Step.ANEW
        if found is Step.LEAP:
            self._leap = here
        else:
            self._last, self._leap = here, None
        return found

    def _apart(self, before: tuple[float, FloatArray], here: tuple[float, FloatArray]) -> bool:
        return bool(self._pace.too_far(here[1] - before[1], here[0] - before[0]))


@dataclass(frozen=True, eq=False)
class Apart:
    """A recording with its leaps behind all other samples, each a session of its own."""

    order: IntArray  # (n,) rows of the recording
    session: IntArray  # (n,) sessions in this order; one more begins where the path begins anew
    leap: BoolArray  # (n,) which samples are leaps, in this order

    @property
    def back(self) -> IntArray:
        """Rows `(n,)` in this order of the recording's samples."""
        return np.argsort(self.order)

    @classmethod
    def of(cls, pace: Pace, q: FloatArray, time: FloatArray, session: IntArray) -> Apart | None:
        """Return a recording so; None where it has no leaps, as almost all.

        Parameters
        ----------
        pace : Pace, of the arm
        q : (n, d) array, joints, rad or m
        time : (n,) array, s
        session : (n,) int array, homing or day
        """
        homed = np.diff(session, prepend=session[:1]) != 0
        step = np.diff(time, prepend=time[:1])
        if not (pace.too_far(np.diff(q, axis=0, prepend=q[:1]), step) & ~homed & (step >= 0)).any():
            return None
        follower, steps = Follower(pace), []
        for row in range(len(q)):
            if homed[row] or step[row] < 0:
                follower.reset()
            steps.append(follower.step(float(time[row]), q[row]))
        leap = np.array([one is Step.LEAP for one in steps])
        begun = np.cumsum(homed | np.array([one is Step.ANEW for one in steps]))
        order = np.argsort(leap, kind="stable")
        parts = np.where(leap, begun[-1] + np.cumsum(leap), begun)
        return cls(order, parts[order], leap[order])
