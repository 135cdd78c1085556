"""Where to measure next: the poses and velocities that reduce the uncertainty in the task region most.

Greedy choice by the variance that an observation takes away at all task points together (active learning by Cohn
1996): with the posterior covariance `c` under the model's points, observing at x reduces the variance at t by `c(t,
x)^2 / (c(x, x) + noise)`, whatever is observed; after each choice the covariance is that of the model which has seen
it. The mean of the reductions is taken over outputs, each relative to its own prior variance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.learners import GPMap
from gpcorrect.calibration.poses import inverse_reference_twists
from gpcorrect.errors import DataError
from gpcorrect.gpr import SharedPredictor
from gpcorrect.types import FloatArray, PoseSignal

CANDIDATES = 1500  # bounds the covariance of candidates and so the time of a proposal; chosen by hand
TASK_POINTS = 400  # likewise
JITTER = 0.3  # of a feature's unit spread, for candidates between the training poses; chosen by hand


@dataclass(frozen=True, eq=False)
class Proposal:
    """Poses to visit and velocities to have there, most useful first; in the frame that the corrector is asked in.

    Parameters
    ----------
    positions : (n, 3) array, metres
    quaternions : (n, 4) array or None, wxyz; None for a position-only model
    twists : (n, 6) or (n, 3) array or None, m/s and rad/s; None for a model without velocity
    remaining : (n,) array
        Fraction of today's uncertainty (variance that more data can take away) in the task region that is left after
        each of them and those before.
    """

    positions: FloatArray
    quaternions: FloatArray | None
    twists: FloatArray | None
    remaining: FloatArray


def propose(
    corrector: CommandCorrector, count: int, rng: np.random.Generator, task: FloatArray | None = None
) -> Proposal:
    """Propose `count` observations inside the region that the model knows.

    Parameters
    ----------
    corrector : CommandCorrector
    count : int, at least 1
    rng : numpy.random.Generator, draws the candidates
    task : (t, d) array, optional
        Features of the task region, as :meth:`CommandCorrector.samples` gives them; the training region by default.

    Raises
    ------
    DataError
        `count` is not between 1 and the number of candidates.
    """
    if not 1 <= count <= CANDIDATES:
        raise DataError(f"between 1 and {CANDIDATES} observations can be proposed, got {count}.")
    learned = corrector.law.learned
    if not isinstance(learned, GPMap):
        raise DataError("only a Gaussian process knows where it is unsure.", hint="Fit again: --method gp")
    known = learned.predictor.parts[0].basis
    task = known if task is None else task
    task = task[rng.permutation(len(task))[:TASK_POINTS]]
    candidates = _candidates(corrector, np.concatenate([known, task]), rng)
    parts = [_Covariance.of(part, candidates, task) for part in learned.predictor.parts]
    chosen: list[int] = []
    remaining: list[float] = []
    for _ in range(count):
        gain = np.mean([part.gain() for part in parts], axis=0)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        parts = [part.after(best) for part in parts]
        chosen.append(best)
        remaining.append(float(np.mean([part.left for part in parts])))
    position, rotations, twist = corrector.features.inverse(candidates[chosen])
    quaternion = None if rotations is None else se3.quaternion_from_matrix(rotations)
    poses = corrector.rigid.inverse(PoseSignal(position, quaternion))
    if twist is not None:
        size = twist.shape[1]
        padded = np.hstack([twist, np.zeros((count, 6 - size))])
        twist = inverse_reference_twists(corrector.rigid, poses, padded)[:, :size]
    return Proposal(poses.position, poses.quaternion, twist, np.array(remaining))


@dataclass(frozen=True, eq=False)
class _Covariance:
    """Posterior covariances of candidates with each other `(k, k)` and with the task `(t, k)`, in prior variances."""

    own: FloatArray
    task: FloatArray
    task_variance: FloatArray
    noise: float
    start: float

    @classmethod
    def of(cls, part: SharedPredictor, candidates: FloatArray, task: FloatArray) -> _Covariance:
        """Return the covariances under a predictor, for features of what may be measured and of the task region."""
        explained, basis = part.explained.mean(axis=0), part.basis[: part.projection.shape[1]]
        w_own, w_task = (part.kernel(X, basis) @ part.projection.T for X in (candidates, task))
        own = part.kernel(candidates, candidates) - (w_own * explained) @ w_own.T
        cross = part.kernel(task, candidates) - (w_task * explained) @ w_own.T
        variance = np.maximum(1.0 - (w_task**2) @ explained, 0.0)
        return cls(own, cross, variance, float((part.noise / part.signal).mean()), float(variance.sum()))

    def gain(self) -> FloatArray:
        """Fraction `(k,)` of today's task variance that each candidate takes away."""
        spread = np.maximum(np.diagonal(self.own), 0.0) + self.noise
        return np.asarray((self.task**2).sum(axis=0) / spread / self.start)

    def after(self, index: int) -> _Covariance:
        """Return the covariances once candidate `index` was observed."""
        spread = max(float(self.own[index, index]), 0.0) + self.noise
        column, reach = self.own[:, index] / spread, self.task[:, index]
        return _Covariance(
            self.own - np.outer(column, self.own[index]),
            self.task - np.outer(reach, column),
            self.task_variance - reach**2 / spread,
            self.noise,
            self.start,
        )

    @property
    def left(self) -> float:
        """Fraction of the task variance that is left."""
        return float(np.maximum(self.task_variance, 0.0).sum()) / self.start


def _candidates(corrector: CommandCorrector, known: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Poses near those of training and task with velocities from elsewhere among them, inside each feature's range."""
    drawn = np.empty((CANDIDATES, known.shape[1]))
    for group in corrector.features.groups:
        drawn[:, group] = known[rng.integers(len(known), size=CANDIDATES)][:, group]
    drawn += JITTER * rng.standard_normal(drawn.shape)
    return np.clip(drawn, known.min(axis=0), known.max(axis=0))
