"""Unscented Kalman filter on an elastic-cable joint: the motor drags the joint through a spring, friction holds it.

The state of a joint is its true position. Between samples the cable drags it when it is stretched by more than friction
bears, `q' = clip(q, m - r, m + r)` about the corrected motor position m, and it moves with noise; the effort, where it
is logged, shows the stretch: `tau = kappa (m - q) + tau_0`, with noise. Gap r, compliance and both noises are tuned on
training data alone. A sample whose motor position or effort is missing is passed over, so the filter never sees a NaN.
Julier and Uhlmann 1997; cable model after Haghighipanah et al. 2016, IROS, cut down to what encoders can show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.learners.learner import Fitted
from gpcorrect.calibration.learners.polynomial import PolynomialMap
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.errors import DataError
from gpcorrect.gpr import LeftOut
from gpcorrect.types import BoolArray, FloatArray, Progress

GAPS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15)
"""Half gap over half the range, to choose from: up to the slack of the dVRK wrist recorded in `dvrk_random`."""
PROCESS = (0.01, 0.1, 1.0)  # standard deviation a step over that of the play's residual, to choose from; chosen by hand
TUNING_ROWS = 1500  # samples that the process noise is tuned on; chosen by hand
LEAST_EXPLAINED = 0.05
"""Part of the stretch's variance that the effort must explain to be a measurement; chosen by hand."""
ALPHA, BETA, KAPPA = 0.5, 2.0, 2.0  # of Merwe's scaled sigma points (van der Merwe 2004, Sec. 3.2.2); chosen by hand
FACTOR = ALPHA**2 * (1.0 + KAPPA)  # of the variance, in the square of a sigma point's distance
MIDDLE = 1.0 - 1.0 / FACTOR + 1.0 - ALPHA**2 + BETA  # weight of the middle one in the variance
TINY = 1e-9  # m or rad: keeps variances positive, far below the resolution of any encoder


@dataclass(frozen=True, eq=False)
class CableModel:
    """Elastic cable of every joint."""

    # from positions to the error that coupling, gain and offset make; its deviations are what is left beside the play,
    # which the filter takes for none of its own
    motor: PolynomialMap
    gap: FloatArray  # (d,) half gap, rad or m
    # (d,) each: stretch m - q for an effort: `compliance tau + rest`
    stretch_per_effort: FloatArray
    stretch_at_rest: FloatArray
    # (d,) each: standard deviations of the joint's step, and of the stretch that the effort shows; infinite where it
    # shows nothing
    process: FloatArray
    measurement: FloatArray

    def __post_init__(self) -> None:
        law, noises = (self.gap, self.stretch_per_effort, self.stretch_at_rest), (self.process, self.measurement)
        if {part.shape for part in (*law, *noises)} != {self.motor.std.shape}:
            raise DataError("the stored cable model is damaged: its numbers are not one a joint.")
        if not (np.isfinite(law).all() and (self.gap >= 0).all() and np.greater_equal(noises, 0).all()):
            raise DataError("the stored cable model is damaged: no cable has its numbers.")

    def errors(self, samples: Samples) -> tuple[FloatArray, FloatArray]:
        """Return what is to be added to the joints of a path `(n, d)`, and its standard deviation.

        Parameters
        ----------
        samples : Samples, n samples, in order, with their path of d joints
        """
        motor, stretch = self.inputs(samples.path, samples.effort)
        mean, std = _filtered(motor, stretch, samples.new, self.noises)
        return mean - samples.path, np.hypot(std, self.motor.std)

    def inputs(self, q: FloatArray, effort: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Return corrected motor positions and the stretch that efforts show `(n, d)`, NaN where they show nothing.

        Parameters
        ----------
        q : (n, d) array, joints, rad or m
        effort : (n, d) array or None, N m or N
        """
        motor = q + self.motor.mean(q)
        if effort is None:
            return motor, np.full(q.shape, np.nan)
        stretch = self.stretch_per_effort * effort + self.stretch_at_rest
        return motor, np.where(np.isfinite(self.measurement), stretch, np.nan)

    @property
    def noises(self) -> FloatArray:
        """(3, d) half gaps and deviations of the joint's step and of the stretch, as :func:`follow` reads them."""
        return np.array([self.gap, self.process, self.measurement])


def learn_cable(samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> Fitted:
    """Learn a :class:`CableModel`: so few numbers a joint that errors in training stand for left-out ones."""
    if samples.path.shape[1] != samples.target.shape[1]:
        raise DataError("the cable model (ukf) is of joints.", hint="Use: gpcorrect joint fit --method ukf")
    samples.learnable()
    rows = samples.rows
    motor = PolynomialMap.fit(samples.path[rows], samples.target[rows], 1)
    path = samples.path + motor.mean(samples.path)
    left = samples.path + samples.target - path
    parts = [_tuned(samples, path[:, j], left[:, j], j) for j in range(path.shape[1])]
    spread, *cables = (np.array(column) for column in zip(*parts, strict=True))
    learned = CableModel(replace(motor, std=spread), *cables)
    mean, std = learned.errors(samples)
    return Fitted(learned, LeftOut((samples.target - mean)[rows], std[rows], np.zeros(len(rows))))


def _tuned(data: Samples, motor: FloatArray, left: FloatArray, joint: int) -> tuple[float, ...]:
    """Return what the play of one joint leaves, its gap, stretch law and noises."""
    rows = data.rows
    half = float(np.ptp(motor[rows])) / 2
    lags = {fraction: _clipped(motor, fraction * half, data.new) - motor for fraction in GAPS}
    gap = min(lags, key=lambda fraction: float(np.var(left[rows] - lags[fraction][rows])))
    spread = max(float(np.std(left[rows] - lags[gap][rows])), TINY)
    compliance, rest, measurement = _stretch_law(data, left, joint)
    stretch = np.full(len(motor), np.nan)
    if data.effort is not None and np.isfinite(measurement):
        stretch = compliance * data.effort[:, joint] + rest
    head = rows[:TUNING_ROWS]
    first, last = int(head[0]), int(head[-1]) + 1
    inside = head - first

    def _square(fraction: float) -> float:
        new = data.new[first:last].copy()
        new[0] = True
        cable = np.array([[gap * half], [fraction * spread], [measurement]])
        mean, _ = _filtered(motor[first:last, None], stretch[first:last, None], new, cable)
        return float(np.mean((mean[inside, 0] - (motor + left)[head]) ** 2))

    process = min(PROCESS, key=_square) if np.isfinite(measurement) else PROCESS[0]
    return spread, gap * half, compliance, rest, process * spread, measurement


def _stretch_law(data: Samples, left: FloatArray, joint: int) -> tuple[float, float, float]:
    """Compliance, rest and noise of the stretch that the effort shows; infinite noise where it shows too little."""
    if data.effort is None:
        return 0.0, 0.0, np.inf
    rows = data.rows
    effort, stretch = data.effort[rows, joint], -left[rows]
    known = np.isfinite(effort) & np.isfinite(stretch)
    if known.sum() < 3 or np.ptp(effort[known]) == 0:
        return 0.0, 0.0, np.inf
    compliance, rest = np.polyfit(effort[known], stretch[known], 1)
    noise = float(np.std(stretch[known] - compliance * effort[known] - rest))
    explained = 1.0 - noise**2 / max(float(np.var(stretch[known])), TINY**2)
    return float(compliance), float(rest), noise if explained > LEAST_EXPLAINED else np.inf


def _clipped(motor: FloatArray, gap: float, new: BoolArray) -> FloatArray:
    joint = motor.copy()
    for t in range(1, len(motor)):
        if not new[t]:
            joint[t] = min(max(joint[t - 1], motor[t] - gap), motor[t] + gap)
    return joint


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
