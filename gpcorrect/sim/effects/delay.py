"""Delay: the outside sensors tell of a moment that has passed."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numba import njit

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import PathEffect, PathOperator, Stage
from gpcorrect.sim.effects.description import Description, Family, Parameter, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

_DELAY = Range("s", -0.5, 0.5, 0.03)


@dataclass(frozen=True)
class Delay(PathEffect):
    """Every joint is seen where it was `delay` seconds ago; outside the recorded time it stood still.

    Between samples the path is a monotone cubic, which never overshoots a play's corners.
    """

    delay: float  # negative where the robot's own reports are the late ones

    stage = Stage.CLOCK
    joint_by_joint = True
    about = Description(
        name="delay",
        number=23,
        family=Family.TIME,
        equation="y(t) = x(t - delay), all joints alike",
        source="Fritsch and Carlson 1980, SIAM J. Numer. Anal. 17(2), for the values between samples",
        parameters=(Parameter("delay", "age of what is seen", revolute=_DELAY, positive=False),),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("viscous_friction", "resonance"),
        separating_runs=(Run.SPEED_LADDER, Run.ONE_JOINT),
        sites=(Site.ALL,),
    )

    def operator(self) -> PathOperator:
        """Refuse a negative delay: an arm that moves now is not seen before it moves."""
        if self.delay < 0:
            raise DataError(
                f"an arm that runs live cannot be seen {-self.delay} s before it moves.",
                hint="Leave the effect `delay` out, or give it a delay of at least 0.",
            )
        return super().operator()

    def advance(self, q: FloatArray, motion: Motion, memory: Memory) -> FloatArray:
        """Return each run's path as it was before; of a stretch, with what is left of the stretches before it."""
        if self.delay == 0:
            return q
        path = np.concatenate([memory["path"], q]) if memory else q
        time = np.concatenate([memory["time"], motion.time]) if memory else motion.time
        rows = np.broadcast_to(time[..., None], path.shape).reshape(len(path), -1)
        behind = shifted(np.ascontiguousarray(path).reshape(len(path), -1), rows, self.delay).reshape(path.shape)
        passed = int((time <= time[-1] - self.delay).sum(axis=0).min())
        memory["path"], memory["time"] = path[max(passed - 2, 0) :], time[max(passed - 2, 0) :]
        return behind[len(path) - len(q) :]


@njit(cache=True, nogil=True)
def shifted(path: FloatArray, time: FloatArray, delay: float) -> FloatArray:
    """Return paths as they were `delay` seconds before; outside the known time they stand still.

    The curve of :class:`scipy.interpolate.PchipInterpolator`, whose set-up for each path takes ten times as long as the
    walk along it.

    Parameters
    ----------
    path, time : (n, m) arrays
        Values, and seconds that do not fall. Missing values, and rows that repeat a moment, are left out.
    delay : float
        s; negative looks ahead.

    Returns
    -------
    (n, m) array
    """
    output = path.copy()
    for j in range(path.shape[1]):
        t, y = _known(path, time, j)
        if len(t) < 2:
            continue
        slopes, k = _slopes(t, y), 0
        for i in range(len(path)):
            at = min(max(time[i, j] - delay, t[0]), t[-1])
            while k < len(t) - 2 and t[k + 1] <= at:
                k += 1
            output[i, j] = _cubic(t, y, slopes, k, at)
    return output


@njit(cache=True)
def _known(path: FloatArray, time: FloatArray, j: int) -> tuple[FloatArray, FloatArray]:
    t, y, count = np.empty(len(path)), np.empty(len(path)), 0
    for i in range(len(path)):
        if isfinite(path[i, j]) and (i == 0 or time[i, j] > time[i - 1, j]):
            t[count], y[count] = time[i, j], path[i, j]
            count += 1
    return t[:count], y[:count]


@njit(cache=True)
def _slopes(t: FloatArray, y: FloatArray) -> FloatArray:
    """Slopes at the samples: weighted harmonic means of the two chords, none where these turn."""
    n = len(t)
    h, chord, slopes = np.empty(n - 1), np.empty(n - 1), np.zeros(n)
    for k in range(n - 1):
        h[k] = t[k + 1] - t[k]
        chord[k] = (y[k + 1] - y[k]) / h[k]
    if n == 2:
        slopes[0] = slopes[1] = chord[0]
        return slopes
    for k in range(1, n - 1):
        if chord[k - 1] * chord[k] > 0.0:
            before, after = 2.0 * h[k] + h[k - 1], h[k] + 2.0 * h[k - 1]
            slopes[k] = (before + after) / (before / chord[k - 1] + after / chord[k])
    slopes[0] = _end(h[0], h[1], chord[0], chord[1])
    slopes[-1] = _end(h[-1], h[-2], chord[-1], chord[-2])
    return slopes


@njit(cache=True)
def _end(h: float, h_next: float, chord: float, chord_next: float) -> float:
    """Slope at an end: the parabola's through three samples, limited so that nothing overshoots."""
    slope = ((2.0 * h + h_next) * chord - h * chord_next) / (h + h_next)
    if slope * chord <= 0.0:
        return 0.0
    if chord * chord_next <= 0.0 and abs(slope) > 3.0 * abs(chord):
        return 3.0 * chord
    return slope


@njit(cache=True)
def _cubic(t: FloatArray, y: FloatArray, slopes: FloatArray, k: int, at: float) -> float:
    h = t[k + 1] - t[k]
    chord, x = (y[k + 1] - y[k]) / h, at - t[k]
    b = (3.0 * chord - 2.0 * slopes[k] - slopes[k + 1]) / h
    c = (slopes[k] + slopes[k + 1] - 2.0 * chord) / h**2
    value: float = y[k] + x * (slopes[k] + x * (b + x * c))
    return value
