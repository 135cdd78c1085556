"""What sensors say of a machine: encoders, outside joint sensors and a tracker, with their noise.

A recording is read as one stretch, an arm that runs live sample by sample: the same operator, which remembers.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from gpcorrect import se3
from gpcorrect.sim.effects import ReadingEffect, of_kind
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Motion, Readings
from gpcorrect.types import FloatArray


class SensorNoise:
    """White noise plus a stationary first-order autoregression, for one stretch of samples after the other.

    Parameters
    ----------
    rng : numpy.random.Generator
    white, slow : (d,) arrays or float, standard deviations of the two parts
    phi : float, correlation of the slow part from one log sample to the next
    rate_hz : float, log samples a second
    """

    def __init__(
        self, rng: np.random.Generator, white: FloatArray | float, slow: FloatArray | float, phi: float, rate_hz: float
    ) -> None:
        self._rng, self._white, self._slow, self._phi, self._rate = rng, white, slow, phi, rate_hz
        self._last: FloatArray | None = None
        self._time = 0.0

    def draw(self, time: FloatArray, width: int) -> FloatArray:
        """Return noise `(n, N, width)` at times `(n, N)`, s, at the log's rate and not before the last ones.

        Parameters
        ----------
        time : (n, N) array, s
        width : int, numbers that are measured at each
        """
        fresh = self._rng.standard_normal((*time.shape, width))
        slow = math.sqrt(1.0 - self._phi**2) * fresh
        slow[0] = fresh[0]
        if self._last is not None:
            left = self._phi ** ((float(time[0, 0]) - self._time) * self._rate)
            slow[0] = left * self._last + math.sqrt(max(0.0, 1.0 - left**2)) * fresh[0]
        if len(slow) > 1:
            slow = lfilter([1.0], [1.0, -self._phi], slow, axis=0)
        self._last, self._time = slow[-1], float(time[-1, 0])
        return self._slow * slow + self._white * self._rng.standard_normal(fresh.shape)


class Sensors:
    """Everything that measures a machine: effects on readings, then noise, stretch by stretch.

    Parameters
    ----------
    machine : Machine
    rng : numpy.random.Generator
    """

    def __init__(self, machine: Machine, rng: np.random.Generator) -> None:
        noise, rate = machine.noise, machine.log_rate_hz
        white, slow = np.asarray(noise.external_jp_white or 0.0), np.asarray(noise.external_jp_ar_std or 0.0)
        phi = noise.tracker_ar_phi
        self._machine = machine
        self._effects = [effect.operator(rng) for effect in of_kind(machine.effects, ReadingEffect)]
        self._external = SensorNoise(rng, white, slow, noise.external_jp_ar_phi, rate)
        self._shift = SensorNoise(rng, noise.tracker_white, noise.tracker_ar_std, phi, rate)
        self._turn = SensorNoise(rng, noise.tracker_rotation_white, noise.tracker_rotation_ar_std, phi, rate)

    def read(self, motion: Motion, torque: FloatArray, q: FloatArray, T_base_tip: FloatArray | None) -> Readings:
        """Return what is measured.

        Parameters
        ----------
        motion : Motion, a stretch of n samples of N runs
        torque, q : (n, N, dof) arrays, commanded torque, and true joints when outside sensors see them
        T_base_tip : (n, N, 4, 4) array or None
            True tool poses; None for bare joints, and where the tracker is not asked.
        """
        marker = None if T_base_tip is None else self._marker(T_base_tip)
        readings = Readings(motion.position, motion.velocity, torque, q, marker)
        for effect in self._effects:
            readings = effect(readings, motion)
        external = readings.external_jp + self._external.draw(motion.time, q.shape[-1])
        marker = readings.T_tracker_marker
        return Readings(
            measured_jp=self._quantised(readings.measured_jp),
            measured_jv=readings.measured_jv,
            measured_jf=readings.measured_jf,
            external_jp=external,
            T_tracker_marker=None if marker is None else self._noisy(marker, motion.time),
        )

    def track(self, time: FloatArray, T_base_tip: FloatArray) -> FloatArray:
        """Return marker poses `(n, N, 4, 4)` as the tracker alone sees them, without the effects on readings.

        Parameters
        ----------
        time : (n, N) array, s
        T_base_tip : (n, N, 4, 4) array, true tool poses
        """
        return self._noisy(self._marker(T_base_tip), time)

    def _marker(self, T_base_tip: FloatArray) -> FloatArray:
        return se3.compose(self._machine.T_tracker_base, T_base_tip, self._machine.T_tip_marker)

    def _noisy(self, T: FloatArray, time: FloatArray) -> FloatArray:
        shift, turn = self._shift.draw(time, 3), self._turn.draw(time, 3)
        return se3.pose(T[..., :3, :3] @ se3.matrix_from_rotvec(turn), T[..., :3, 3] + shift)

    def _quantised(self, q: FloatArray) -> FloatArray:
        """Positions rounded to the encoders' steps; a step of 0, or no steps, is none."""
        if not self._machine.noise.encoder_step:
            return q
        sizes = np.asarray(self._machine.noise.encoder_step)
        steps = np.where(sizes > 0, sizes, 1.0)
        return np.where(sizes > 0, np.round(q / steps) * steps, q)
