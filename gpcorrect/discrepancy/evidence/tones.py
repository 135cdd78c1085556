"""A tone that no variable of the motion explains: a pump, a fan, mains, a floor that shakes.

Cells of variables cannot see it, for its phase is another one in every trajectory. Periodograms are averaged over
trajectories, where noise gives a smooth spectrum and a tone a narrow peak (Percival and Walden 1993, Ch. 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lombscargle
from scipy.special import digamma, polygamma

from gpcorrect.discrepancy.recording.noise import NORMAL_MAD
from gpcorrect.types import FloatArray, IntArray

FEWEST_ROWS, MOST_ROWS = 40, 400  # of a piece
FEWEST_PIECES = 4  # to average a spectrum over; chosen by hand on development cases
CYCLES = 3.0  # in a piece, at least
FINER = 2  # frequencies for each that can be resolved
FEWEST_FREQUENCIES = 40  # to fit a smooth spectrum through; chosen by hand on development cases
DEGREE, ROUNDS = 5, 20  # of the curve through a spectrum, and of fitting it
CLIP = 5.0  # robust standard deviations


@dataclass(frozen=True)
class Tone:
    """A narrow peak of a spectrum between two frequencies, Hz.

    `rms` is of what is above the spectrum around it, `nats` minus the logarithm of a bound on the chance of such a peak
    anywhere in noise of a smooth spectrum.
    """

    low: float
    high: float
    rms: float
    nats: float


def strongest_tone(time: FloatArray, residual: FloatArray, block: IntArray) -> Tone | None:
    """Return the most unlikely peak; None when the recording is too short to say.

    Parameters
    ----------
    time, residual : (n,) arrays, seconds, and residual; NaN is missing
    block : (n,) int array, trajectory of each row; -1 for rows to leave out
    """
    seen = np.where(np.isfinite(residual), block, -1)
    rows = [np.flatnonzero(seen == k) for k in np.unique(seen[seen >= 0])]
    parts = [p for own in rows for p in np.array_split(own, int(np.ceil(len(own) / MOST_ROWS)))]
    pieces = [p for p in parts if len(p) >= FEWEST_ROWS]
    if len(pieces) < FEWEST_PIECES:
        return None
    span = float(np.median([np.ptp(time[p]) for p in pieces]))
    step = float(np.median(np.concatenate([np.diff(time[p]) for p in pieces])))
    frequency = np.arange(CYCLES / span, 0.5 / step, 1.0 / (FINER * span))
    if len(frequency) < FEWEST_FREQUENCIES:
        return None
    scale = float(np.median(np.abs(residual[np.concatenate(pieces)]))) / NORMAL_MAD
    power = np.mean([_power(time[p], residual[p], scale, frequency) for p in pieces], axis=0)
    background = _smooth(power, frequency, len(pieces))
    ratio = np.maximum(power / background, 1.0)
    peak = int(np.argmax(ratio))
    # Chernoff's bound on the chance that the mean of so many exponential variables is as large, at any frequency.
    nats = len(pieces) * float(ratio[peak] - 1.0 - np.log(ratio[peak])) - float(np.log(len(frequency)))
    rms = float(np.sqrt(max(0.0, power[peak] - background[peak])))
    width = 1.0 / span  # of what can be resolved
    return Tone(float(frequency[peak]) - width, float(frequency[peak]) + width, rms, nats)


def _power(time: FloatArray, values: FloatArray, scale: float, frequency: FloatArray) -> FloatArray:
    """Mean square of a sine fitted at each frequency, outliers clipped."""
    values = np.clip(values - values.mean(), -CLIP * scale, CLIP * scale)
    power: FloatArray = np.asarray(lombscargle(time, values, 2.0 * np.pi * frequency)) * (2.0 / len(time))
    return power


def _smooth(power: FloatArray, frequency: FloatArray, pieces: int) -> FloatArray:
    """Spectrum of the noise: a smooth curve of logarithms that peaks hardly move."""
    x = np.log(frequency)
    columns = np.vander((x - x.mean()) / np.ptp(x), DEGREE + 1)
    height = np.log(np.maximum(power, 1e-300)) - (digamma(pieces) - np.log(pieces))  # mean of log Gamma
    spread = np.sqrt(polygamma(1, pieces))
    weight = np.ones(len(x))
    for _ in range(ROUNDS):
        beta = np.linalg.lstsq(columns * weight[:, None], height * weight, rcond=None)[0]
        weight = 1.0 / np.sqrt(1.0 + ((height - columns @ beta) / (2.0 * spread)) ** 2)
    smooth: FloatArray = np.exp(columns @ beta)
    return smooth
