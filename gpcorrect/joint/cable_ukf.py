"""Unscented Kalman filter on an elastic-cable joint: the motor drags the joint through a spring, friction holds it.

The state of a joint is its true position. Between samples the cable drags it when it is stretched by more than friction
bears, `q' = clip(q, m - r, m + r)` about the corrected motor position m, and it moves with noise; the effort, where it
is logged, tells the stretch: `tau = kappa (m - q) + tau_0`, with noise. Gap r, compliance and both noises are tuned on
training data alone. A sample whose motor position or effort is missing is passed over, so the filter never sees a NaN.
Julier and Uhlmann 1997; cable model after Haghighipanah et al. 2016, IROS, cut down to what encoders can tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from gpcorrect.joint.dataset import JointData
from gpcorrect.joint.maps import PolynomialMap
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["CableFilter", "CableModel", "learn_cable"]

GAPS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15)  # half gap over half the range, to choose from
PROCESS = (0.01, 0.1, 1.0)  # standard deviation a step over that of the play's residual, to choose from
TUNING_ROWS = 1500
LEAST_TOLD = 0.05  # of the stretch's variance that the effort must explain to be listened to
TINY = 1e-9


@dataclass(frozen=True, eq=False)
class CableModel:
    """Elastic cable of every joint.

    Parameters
    ----------
    motor : PolynomialMap
        From positions to the error that coupling, gain and offset make.
    gap : (d,) array
        Half gap, rad or m.
    stretch_per_effort, stretch_at_rest : (d,) arrays
        Stretch m - q for an effort: `compliance tau + rest`.
    process, measurement : (d,) arrays
        Standard deviations of the joint's step and of the stretch told by the effort; infinite where it tells nothing.
    """

    motor: PolynomialMap
    gap: FloatArray
    stretch_per_effort: FloatArray
    stretch_at_rest: FloatArray
    process: FloatArray
    measurement: FloatArray

    def estimate(self, data: JointData) -> tuple[FloatArray, FloatArray]:
        """Return true positions `(n, d)` and their standard deviations."""
        motor, told = self.inputs(data.q, data.effort)
        parts = [
            _filtered(motor[:, j], told[:, j], data.new, self.gap[j], self.process[j], self.measurement[j])
            for j in range(motor.shape[1])
        ]
        return np.column_stack([mean for mean, _ in parts]), np.column_stack([std for _, std in parts])

    def inputs(self, q: FloatArray, effort: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Return corrected motor positions and the stretch that efforts tell `(n, d)`, NaN where they tell nothing."""
        motor = q + self.motor.predict(q)[0]
        if effort is None:
            return motor, np.full(q.shape, np.nan)
        told = self.stretch_per_effort * effort + self.stretch_at_rest
        return motor, np.where(np.isfinite(self.measurement), told, np.nan)

    def filters(self) -> list[CableFilter]:
        """Return a filter for every joint, for a live path."""
        noises = zip(self.gap.tolist(), self.process.tolist(), self.measurement.tolist(), strict=True)
        return [CableFilter(*parts) for parts in noises]


def learn_cable(data: JointData, rows: IntArray, motor: PolynomialMap) -> CableModel:
    """Tune a cable model on training rows; `motor` is the linear calibration of the motors there."""
    path = data.q + motor.predict(data.q)[0]
    assert data.truth is not None
    left = data.truth - path
    parts = [_tuned(data, rows, path[:, j], left[:, j], j) for j in range(path.shape[1])]
    return CableModel(motor, *(np.array(column) for column in zip(*parts, strict=True)))


def _tuned(
    data: JointData, rows: IntArray, motor: FloatArray, left: FloatArray, joint: int
) -> tuple[float, float, float, float, float]:
    """Gap, stretch law and noises of one joint."""
    half = float(np.ptp(motor[rows])) / 2
    lags = {share: _clipped(motor, share * half, data.new) - motor for share in GAPS}
    gap = min(lags, key=lambda share: float(np.var(left[rows] - lags[share][rows])))
    spread = max(float(np.std(left[rows] - lags[gap][rows])), TINY)
    compliance, rest, measurement = _stretch_law(data, rows, left, joint)
    told = np.full(len(motor), np.nan)
    if data.effort is not None and np.isfinite(measurement):
        told = compliance * data.effort[:, joint] + rest
    head = rows[:TUNING_ROWS]
    first, last = int(head[0]), int(head[-1]) + 1
    inside = head - first

    def square(share: float) -> float:
        new = data.new[first:last].copy()
        new[0] = True
        mean, _ = _filtered(motor[first:last], told[first:last], new, gap * half, share * spread, measurement)
        return float(np.mean((mean[inside] - (motor + left)[head]) ** 2))

    process = min(PROCESS, key=square) if np.isfinite(measurement) else PROCESS[0]
    return gap * half, compliance, rest, process * spread, measurement


def _stretch_law(data: JointData, rows: IntArray, left: FloatArray, joint: int) -> tuple[float, float, float]:
    """Compliance, rest and noise of the stretch that the effort tells; infinite noise where it tells too little."""
    if data.effort is None:
        return 0.0, 0.0, np.inf
    effort, stretch = data.effort[rows, joint], -left[rows]
    known = np.isfinite(effort) & np.isfinite(stretch)
    if known.sum() < 3 or np.ptp(effort[known]) == 0:
        return 0.0, 0.0, np.inf
    compliance, rest = np.polyfit(effort[known], stretch[known], 1)
    noise = float(np.std(stretch[known] - compliance * effort[known] - rest))
    told = 1.0 - noise**2 / max(float(np.var(stretch[known])), TINY**2)
    return float(compliance), float(rest), noise if told > LEAST_TOLD else np.inf


def _clipped(motor: FloatArray, gap: float, new: BoolArray) -> FloatArray:
    joint = motor.copy()
    for t in range(1, len(motor)):
        if not new[t]:
            joint[t] = min(max(joint[t - 1], motor[t] - gap), motor[t] + gap)
    return joint


def _filtered(
    motor: FloatArray, told: FloatArray, new: BoolArray, gap: float, process: float, measurement: float
) -> tuple[FloatArray, FloatArray]:
    """One joint through the filter. Where efforts tell nothing, the sigma points alone carry the play along."""
    cable = CableFilter(gap, process, measurement)
    steps = [cable.step(*sample) for sample in zip(motor.tolist(), told.tolist(), new.tolist(), strict=True)]
    mean, std = np.array(steps).reshape(len(motor), 2).T
    return mean, std


class CableFilter:
    """The filter of one joint, sample by sample.

    Parameters
    ----------
    gap : float
        Half gap, rad or m.
    process, measurement : float
        Standard deviations of the joint's step, and of the stretch that the effort tells; infinite where it tells
        nothing.
    """

    def __init__(self, gap: float, process: float, measurement: float) -> None:
        self._scale = max(gap, process, TINY)
        self._drag, self._start = gap / self._scale, max(gap, process, TINY) / self._scale
        self._motor = np.zeros(1)
        points = MerweScaledSigmaPoints(1, alpha=0.5, beta=2.0, kappa=2.0)
        self._ukf = UnscentedKalmanFilter(1, 1, 1.0, hx=self._stretch, fx=self._dragged, points=points)
        self._ukf.Q[:] = (process / self._scale) ** 2
        if np.isfinite(measurement):
            self._ukf.R[:] = max(measurement / self._scale, TINY) ** 2

    def step(self, motor: float, told: float, new: bool) -> tuple[float, float]:
        """Return mean and standard deviation after one sample; NaN where the motor's position is not known."""
        ukf = self._ukf
        if not np.isfinite(motor):
            return np.nan, np.nan
        self._motor[0] = motor / self._scale
        if new:
            ukf.x, ukf.P = self._motor.copy(), np.array([[self._start**2]])
        ukf.predict()  # a new path too: an update takes its sigma points from here
        if np.isfinite(told):
            ukf.update(np.array([told / self._scale]))
        ukf.P = np.clip(ukf.P, TINY**2, max(self._drag, 1.0) ** 2 * 100.0)
        return float(ukf.x[0]) * self._scale, float(np.sqrt(ukf.P[0, 0])) * self._scale

    def _dragged(self, x: FloatArray, dt: float) -> FloatArray:
        return np.clip(x, self._motor - self._drag, self._motor + self._drag)

    def _stretch(self, x: FloatArray) -> FloatArray:
        stretch: FloatArray = self._motor - x
        return stretch
