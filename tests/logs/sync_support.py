"""Planted motions: one path that two clocks saw, in frames that have nothing to do with each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from gpcorrect import se3
from gpcorrect.logs.sync import Motion, MotionPair
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

Path = Callable[[FloatArray], FloatArray]


def wandering(rng: np.random.Generator, size: float = 0.03) -> Path:
    """Return a smooth random path in space that does not repeat: eight sines of 0.1 to 0.8 Hz an axis."""
    frequency, phase = rng.uniform(0.1, 0.8, (8, 3)), rng.uniform(0, 2 * np.pi, (8, 3))
    amplitude = rng.normal(size=(8, 3)) * size / np.sqrt(8) / (frequency / 0.3)

    def path(t: FloatArray) -> FloatArray:
        return (amplitude * np.sin(2 * np.pi * frequency * t[:, None, None] + phase)).sum(axis=1)

    return path


def sines(amplitude: tuple[float, float, float], rate: tuple[float, float, float], turn: float = 0.0) -> Path:
    """Return a path of one cosine an axis, of `rate` in rad/s, the second axis `turn` rad behind."""

    def path(t: FloatArray) -> FloatArray:
        return np.asarray(amplitude) * np.cos(np.outer(t, rate) - np.array([0.0, turn, 0.0]))

    return path


def one_run(time: FloatArray, **signals: PoseSignal | FloatArray) -> CalibrationLog:
    """Return a log of one trajectory."""
    return CalibrationLog(time, np.zeros(len(time)), np.zeros(len(time)), **signals)


@dataclass(frozen=True)
class Recording:
    """How two clocks record a path; rates in Hz, noise in m."""

    seconds: float = 30.0
    reference_rate: float = 100.0
    observed_rate: float = 60.0
    noise: float = 1.5e-4
    jitter: float = 0.0
    outliers: float = 0.0
    dropout: float = 0.0
    correlation: float = 0.0
    scale: float = 1.0

    def pair(self, path: Path, offset: float, rng: np.random.Generator, start: float = 0.0) -> MotionPair:
        """Record a path; the observer's stamps run `offset` s ahead, its frame is random."""
        t = start + np.arange(0.0, self.seconds, 1 / self.reference_rate)
        s = start + np.arange(0.0, self.seconds, 1 / self.observed_rate) + rng.uniform(0, 1 / self.observed_rate)
        s = np.sort(s + self.jitter * rng.uniform(-1, 1, len(s)) / self.observed_rate)
        rotation, shift = se3.matrix_from_rotvec(rng.uniform(-1.8, 1.8, 3)), rng.normal(size=3)
        seen = self.scale * (path(s - offset) @ rotation.T + shift) + self._noise(len(s), rng)
        bad = rng.uniform(size=len(s)) < self.outliers
        seen[bad] += 0.05 * rng.normal(size=(int(bad.sum()), 3))
        first = int(rng.integers(len(s) // 2))
        seen[first : first + int(self.dropout * len(s))] = np.nan
        return MotionPair(Motion(t, path(t)), Motion(s, seen))

    def _noise(self, n: int, rng: np.random.Generator) -> FloatArray:
        keep = self.correlation
        series = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=(n, 3)), axis=0)
        return self.noise * self.scale * series
