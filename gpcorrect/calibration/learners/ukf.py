"""Unscented Kalman filter on an elastic-cable joint: the motor drags the joint through a spring, friction holds it.

The state of a joint is its true position. Between samples the cable drags it when it is stretched by more than friction
bears, `q' = clip(q, m - r, m + r)` about the corrected motor position m, and it moves with noise. The effort, where it
is logged, shows the stretch: `q = p + a(p) - kappa tau`, with noise, of the encoder's p, a line a and the compliance
kappa, fitted together. Efforts that show friction say where in its play the joint is: the filter measures with them.
Those that show the load say where the play is: they are part of m. Which of the two, gap r and noises are tuned on
training data alone. A sample is passed over that lacks its motor position, or an effort that is part of it, so the
filter never sees a NaN.
Julier and Uhlmann 1997; cable model after Haghighipanah et al. 2016, IROS, cut down to what encoders can show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.learners.learner import Fitted
from gpcorrect.calibration.learners.polynomial import RIDGE, PolynomialMap
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.errors import DataError
from gpcorrect.gpr import LeftOut
from gpcorrect.types import BoolArray, FloatArray, Progress

GAPS = (0.0, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.08, 0.15)
"""Half gap over half the range, to choose from: up to the slack of the dVRK wrist recorded in `dvrk_random`."""
PROCESS = (0.01, 0.1, 1.0)  # standard deviation a step over what the play leaves, to choose from; chosen by hand
OTHERS = 1e12  # penalty, as :data:`RIDGE`, on what another joint's effort does to a cable: nothing
ALPHA, BETA, KAPPA = 0.5, 2.0, 2.0  # of Merwe's scaled sigma points (van der Merwe 2004, Sec. 3.2.2); chosen by hand
FACTOR = ALPHA**2 * (1.0 + KAPPA)  # of the variance, in the square of a sigma point's distance
MIDDLE = 1.0 - 1.0 / FACTOR + 1.0 - ALPHA**2 + BETA  # weight of the middle one in the variance
TINY = 1e-9  # m or rad: keeps variances positive, far below the resolution of any encoder


@dataclass(frozen=True, eq=False)
class CableModel:
    """Elastic cable of every joint."""

    # from positions, and from positions and efforts (where there are none, the same), to the error that coupling, gain,
    # offset and stretch make; the deviations of the second are what the filter leaves in training
    motor: PolynomialMap
    shown: PolynomialMap
    loaded: BoolArray  # (d,) whether the play is about where the efforts show the joint
    gap: FloatArray  # (d,) half gap, rad or m
    # (d,) each: standard deviations of the joint's step, and of where the efforts show it; infinite where that is not
    # measured with
    process: FloatArray
    measurement: FloatArray

    def __post_init__(self) -> None:
        d, laws = self.gap.size, (self.motor.std, self.shown.std)
        parts = (self.gap, self.process, self.measurement, self.loaded, *laws)
        if {part.shape for part in parts} != {(d,)} or self.shown.scaler.centre.size not in (d, 2 * d):
            raise DataError("the stored cable model is damaged: its numbers are not one a joint.")
        if not (np.isfinite(self.gap).all() and np.greater_equal(self.noises, 0).all()):
            raise DataError("the stored cable model is damaged: no cable has its numbers.")

    def errors(self, samples: Samples) -> tuple[FloatArray, FloatArray]:
        """Return what is to be added to the joints of a path `(n, d)`, and its standard deviation.

        Parameters
        ----------
        samples : Samples, n samples, in order, with their path of d joints
        """
        motor, stretch = self.inputs(samples.path, samples.effort)
        mean, std = _filtered(motor, stretch, samples.new, self.noises)
        return mean - samples.path, np.hypot(std, self.shown.std)

    def inputs(self, q: FloatArray, effort: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Return positions that plays are about, and the stretch that efforts show beside, `(n, d)`, NaN where unknown.

        Parameters
        ----------
        q : (n, d) array, joints, rad or m
        effort : (n, d) array or None, N m or N
        """
        motor, shown = q + self.motor.mean(q), q + self.shown.mean(_inputs(q, effort, self.shown.scaler.centre.size))
        return np.where(self.loaded, shown, motor), motor - shown

    @property
    def compliance(self) -> FloatArray:
        """(d,) stretch for an effort of the joint's own, rad/(N m) or m/N; zero where there are no efforts."""
        slopes = -self.shown.weights[1:] / self.shown.scaler.spread[:, None]
        return np.diagonal(slopes[len(slopes) - self.gap.size :]) * (len(slopes) > self.gap.size)

    @property
    def noises(self) -> FloatArray:
        """(3, d) half gaps and deviations of the joint's step and of the stretch, as :func:`follow` reads them."""
        return np.array([self.gap, self.process, self.measurement])


def learn_cable(samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> Fitted:
    """Learn a :class:`CableModel`: so few numbers a joint that errors in training stand for left-out ones.

    Positions and the joint's own effort explain the error together: gravity goes by position, and a law of positions
    that comes first takes most of the stretch.
    """
    if samples.path.shape[1] != samples.target.shape[1]:
        raise DataError("the cable model (ukf) is of joints.", hint="Use: gpcorrect joint fit --method ukf")
    samples.learnable()
    rows, d = samples.rows, samples.path.shape[1]
    X = _inputs(samples.path, samples.effort, 2 * d if layout.efforts.size else d)
    penalties = np.vstack([np.full((d, d), RIDGE), np.where(np.eye(d), RIDGE, OTHERS)])[: X.shape[1]]
    motor = PolynomialMap.fit(samples.path[rows], samples.target[rows], 1)
    shown = PolynomialMap.fit(X[rows], samples.target[rows], 1, penalties)
    free, carried = samples.path + motor.mean(samples.path), samples.path + shown.mean(X)
    tuned = [_tuned(samples, free[:, j], carried[:, j], float(shown.std[j]), j) for j in range(d)]
    left, *cables = (np.array(column) for column in zip(*tuned, strict=True))
    learned = CableModel(motor, replace(shown, std=np.maximum(left, TINY)), *cables)
    mean, std = learned.errors(samples)
    return Fitted(learned, LeftOut((samples.target - mean)[rows], std[rows], np.zeros(len(rows))))


def _inputs(q: FloatArray, effort: FloatArray | None, size: int) -> FloatArray:
    """Return what a law of so many inputs sees: positions, or positions and efforts, NaN where these are not known."""
    if size == q.shape[1]:
        return q
    return np.hstack([q, np.full(q.shape, np.nan) if effort is None else effort])


def _tuned(data: Samples, free: FloatArray, carried: FloatArray, noise: float, joint: int) -> tuple[float, ...]:
    """Return what the best cable of one joint leaves in training, whether its play is about `carried`, and its noises.

    Efforts may say nothing, or where in its play the joint is (they show friction), or where its play is (a load).
    """
    rows, truth = data.rows, (data.path + data.target)[:, joint]

    def left_by(motor: FloatArray, *cable: float) -> float:
        mean, _ = _filtered(motor[:, None], (free - carried)[:, None], data.new, np.array(cable)[:, None])
        return float(np.sqrt(np.mean((mean[:, 0] - truth)[rows] ** 2)))

    found = []
    for loaded, motor in enumerate((free, carried)):
        half = float(np.ptp(motor[rows])) / 2
        spread, gap = min((left_by(motor, f * half, 0.0, np.inf), f * half) for f in GAPS)
        steps = [max(fraction * spread, TINY) for fraction in PROCESS]
        cables = [(gap, steps[0], np.inf), *((gap, step, noise) for step in steps if not loaded)]
        found += [(left_by(motor, *cable), bool(loaded), *cable) for cable in cables]
    return min(found)


@njit(cache=True)
def _filtered(motor: FloatArray, stretch: FloatArray, new: BoolArray, noises: FloatArray) -> FloatArray:
    """Return means and standard deviations `(2, n, d)` of joints along a path."""
    state, found = np.zeros((2, motor.shape[1])), np.empty((2, *motor.shape))
    for i in range(len(motor)):
        found[:, i] = follow(state, motor[i], stretch[i], new[i], noises)
    return found


@njit(cache=True)
def follow(state: FloatArray, motor: FloatArray, stretch: FloatArray, new: bool, noises: FloatArray) -> FloatArray:
    """Move joints on by one sample; return means and standard deviations `(2, d)`, NaN where a motor is not known.

    Where efforts show nothing, the sigma points alone carry the play along.

    Parameters
    ----------
    state : (2, d) array, means and variances before the sample, and in place after it, rad or m
    motor : (d,) array, corrected positions of the motors, rad or m
    stretch : (d,) array, stretch that efforts show, rad or m; NaN where they show none
    new : bool, whether a path begins here
    noises : (3, d) array, see :attr:`CableModel.noises`
    """
    found = np.full(state.shape, np.nan)
    for j in range(len(motor)):
        if not np.isfinite(motor[j]):
            continue
        gap, process, measurement = noises[:, j]
        size = max(gap, process, TINY)
        mean, variance = (motor[j], size**2) if new else (state[0, j], state[1, j])
        # Merwe's scaled sigma points of one number: the mean, and one to either side of it.
        spread, moved = np.sqrt(FACTOR * variance), np.empty(3)
        for k in range(3):
            moved[k] = min(max(mean + (k - 1) * spread, motor[j] - gap), motor[j] + gap)
        mean = (moved[0] + moved[2]) / (2.0 * FACTOR) + (1.0 - 1.0 / FACTOR) * moved[1]
        squares = (moved - mean) ** 2
        variance = (squares[0] + squares[2]) / (2.0 * FACTOR) + MIDDLE * squares[1] + process**2
        if np.isfinite(stretch[j]):  # linear in the joint: Kalman's own step
            gain = variance / (variance + max(measurement, TINY * size) ** 2)
            mean += gain * (motor[j] - stretch[j] - mean)
            variance -= gain * variance
        state[0, j], state[1, j] = mean, min(max(variance, (TINY * size) ** 2), (10.0 * size) ** 2)
        found[0, j], found[1, j] = state[0, j], np.sqrt(state[1, j])
    return found
