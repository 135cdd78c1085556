"""Sensor noise: white and slowly varying (AR) on outside sensors, steps on the encoders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from gpcorrect import se3
from gpcorrect.sim.motion import Readings
from gpcorrect.sim.settings import NonNegative, Settings, Share
from gpcorrect.types import FloatArray

__all__ = ["Noise", "ar_noise", "noisy", "quantised"]


class Noise(Settings):
    """Standard deviations of the sensors' noise; zero, or nothing, is none.

    Parameters
    ----------
    external_jp_white, external_jp_ar_std : tuples of float
        White and AR part on the outside joint sensors, for each joint, rad or m.
    external_jp_ar_phi, tracker_ar_phi : float
        Correlation of the AR parts from one sample to the next.
    tracker_white, tracker_ar_std : float
        On each axis of the tracked position, m.
    tracker_rotation_white, tracker_rotation_ar_std : float
        On each axis of the tracked orientation, rad.
    encoder_step : tuple of float
        Resolution of the motor encoders at the joint, rad or m.
    """

    external_jp_white: tuple[NonNegative, ...] = ()
    external_jp_ar_std: tuple[NonNegative, ...] = ()
    external_jp_ar_phi: Share = 0.95
    tracker_white: NonNegative = 0.0
    tracker_ar_std: NonNegative = 0.0
    tracker_ar_phi: Share = 0.95
    tracker_rotation_white: NonNegative = 0.0
    tracker_rotation_ar_std: NonNegative = 0.0
    encoder_step: tuple[NonNegative, ...] = ()


def noisy(readings: Readings, noise: Noise, rng: np.random.Generator) -> Readings:
    """Return the readings with the noise."""
    external = readings.external_jp
    white, slow = np.asarray(noise.external_jp_white or 0.0), np.asarray(noise.external_jp_ar_std or 0.0)
    tracker = readings.T_tracker_marker
    return replace(
        readings,
        measured_jp=quantised(readings.measured_jp, noise.encoder_step),
        external_jp=external + ar_noise(rng, external.shape, white, slow, noise.external_jp_ar_phi),
        T_tracker_marker=None if tracker is None else _noisy_poses(tracker, noise, rng),
    )


def ar_noise(
    rng: np.random.Generator,
    shape: tuple[int, ...],
    white: FloatArray | float,
    ar_std: FloatArray | float,
    phi: float,
) -> FloatArray:
    """White noise plus a stationary first-order autoregression along the first axis, for given deviations."""
    drive = np.sqrt(1.0 - phi**2) * rng.standard_normal(shape)
    drive[0] /= np.sqrt(1.0 - phi**2)
    slow: FloatArray = lfilter([1.0], [1.0, -phi], drive, axis=0)
    return ar_std * slow + white * rng.standard_normal(shape)


def _noisy_poses(T: FloatArray, noise: Noise, rng: np.random.Generator) -> FloatArray:
    lead, phi = T.shape[:-2], noise.tracker_ar_phi
    shift = ar_noise(rng, (*lead, 3), noise.tracker_white, noise.tracker_ar_std, phi)
    turn = ar_noise(rng, (*lead, 3), noise.tracker_rotation_white, noise.tracker_rotation_ar_std, phi)
    return se3.pose(T[..., :3, :3] @ se3.matrix_from_rotvec(turn), T[..., :3, 3] + shift)


def quantised(q: FloatArray, step: tuple[float, ...]) -> FloatArray:
    """Return positions `(..., dof)` rounded to the encoders' steps; a step of 0, or no steps, is none."""
    if not step:
        return q
    sizes = np.asarray(step)
    steps = np.where(sizes > 0, sizes, 1.0)
    return np.where(sizes > 0, np.round(q / steps) * steps, q)
