"""Operators with memory that effects share, compiled; time runs along the first axis, each column on its own.

They act on the sequence of samples: between two samples the input is taken as monotone or linear, however far apart
they are. A missing sample stays missing and is forgotten.
"""

from __future__ import annotations

from math import exp, expm1, isnan

import numpy as np
from numba import njit

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.loading_curve import along_curve, loading_curve
from gpcorrect.sim.effects.oscillator import swung
from gpcorrect.types import FloatArray

__all__ = ["bouc_wen", "lag", "play", "ring", "travelled"]


def play(path: FloatArray, radius: float) -> FloatArray:
    """Play (backlash) of half width `radius`: the output moves only when the input pushes an edge of the gap.

    `w_i = min(max(w_{i-1}, u_i - r), u_i + r)`, exact for any input that is monotone between samples; it starts in the
    middle of the gap (Krasnosel'skii and Pokrovskii 1989, Sec. 2).

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    radius : float
        Half width of the gap, in the unit of the path.

    Returns
    -------
    (n, ...) array
        Output.

    Raises
    ------
    DataError
        The radius is negative.
    """
    if not radius >= 0:
        raise DataError(f"the half width of a play must be >= 0, got {radius}.")
    return _play(_columns(path), radius).reshape(path.shape)


def bouc_wen(path: FloatArray, width: float, sharpness: float) -> FloatArray:
    """Hysteretic part of a path: `dz = (1 - |z / w|^n) du` while it loads, `dz = du` while it unloads.

    The Bouc-Wen element with A = 1 and beta = gamma, written for displacements: it takes up all motion after a reversal
    and ever less of it, `width` at most (Ismail, Ikhouane and Rodellar 2009, Arch. Comput. Methods Eng. 16, Sec. 2). It
    depends on the path alone, not on its speed, and starts relaxed.

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    width : float
        Largest value of the output, w, in the unit of the path.
    sharpness : float
        Exponent n > 0; the larger, the more it is like the part that a play of radius w takes off.

    Returns
    -------
    (n, ...) array
        Output, between -w and w.

    Raises
    ------
    DataError
        The width is negative or the sharpness not above 0.
    """
    if not (width >= 0 and sharpness > 0):
        raise DataError(f"a Bouc-Wen element needs a width >= 0 and a sharpness > 0, got {width} and {sharpness}.")
    if width == 0:
        return np.zeros(path.shape)
    return (width * _bouc_wen(_columns(path) / width, sharpness)).reshape(path.shape)


def lag(path: FloatArray, time: FloatArray, time_constant: float) -> FloatArray:
    """First-order lag `T x' + x = u`, exact for an input that is linear between samples; it starts in balance.

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    time : array of the path's shape
        s; steps may be uneven.
    time_constant : float
        T >= 0, s.

    Returns
    -------
    (n, ...) array
        Output.

    Raises
    ------
    DataError
        The time constant is negative.
    """
    if not time_constant >= 0:
        raise DataError(f"a time constant must be >= 0, got {time_constant}.")
    return _lag(_columns(path), _columns(time), time_constant).reshape(path.shape)


def ring(path: FloatArray, time: FloatArray, frequency_hz: float, damping_ratio: float) -> FloatArray:
    """Second-order response `x'' + 2 d w x' + w^2 x = w^2 u`, exact for an input that is linear between samples.

    It starts at rest on its input.

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    time : array of the path's shape
        s; steps may be uneven.
    frequency_hz : float
        Undamped natural frequency, w / (2 pi), > 0; infinite follows at once.
    damping_ratio : float
        d >= 0.

    Returns
    -------
    (n, ...) array
        Output.

    Raises
    ------
    DataError
        The frequency is not above 0, or the damping ratio is negative.
    """
    if not (frequency_hz > 0 and damping_ratio >= 0):
        raise DataError(
            f"an oscillator needs a frequency > 0 and a damping ratio >= 0, got {frequency_hz} and {damping_ratio}."
        )
    if np.isinf(frequency_hz):
        return np.array(path)
    return _ring(_columns(path), _columns(time), 2 * np.pi * frequency_hz, damping_ratio).reshape(path.shape)


def _columns(path: FloatArray) -> FloatArray:
    return np.ascontiguousarray(path, dtype=np.float64).reshape(len(path), -1)


@njit(cache=True)
def _play(path: FloatArray, radius: float) -> FloatArray:
    output = path.copy()
    for j in range(path.shape[1]):
        state = path[0, j]
        for i in range(1, len(path)):
            u = path[i, j]
            if isnan(u):
                continue
            state = u if isnan(state) else min(max(state, u - radius), u + radius)
            output[i, j] = state
    return output


@njit(cache=True)
def _bouc_wen(path: FloatArray, sharpness: float) -> FloatArray:
    """Of a path in widths."""
    output, curve = np.full(path.shape, np.nan), loading_curve(sharpness)
    for j in range(path.shape[1]):
        last, z = path[0, j], 0.0
        for i in range(len(path)):
            u = path[i, j]
            if isnan(u):
                continue
            z = travelled(curve, z, 0.0 if isnan(last) else u - last)
            last, output[i, j] = u, z
    return output


@njit(cache=True)
def travelled(curve: FloatArray, z: float, travel: float) -> float:
    """Return a Bouc-Wen state after a travel in one direction, in widths: straight back to zero, then the curve."""
    direction = 1.0 if travel > 0 else -1.0
    z, left = z * direction, abs(travel)
    if z < 0.0:
        unloaded = min(-z, left)
        z, left = z + unloaded, left - unloaded
    return direction * (along_curve(curve, z, left) if left > 0.0 else z)


@njit(cache=True)
def _lag(path: FloatArray, time: FloatArray, time_constant: float) -> FloatArray:
    output = path.copy()
    for j in range(path.shape[1]):
        x, u, t = path[0, j], path[0, j], time[0, j]
        for i in range(1, len(path)):
            u_next = path[i, j]
            if isnan(u_next):
                continue
            h = max(time[i, j] - t, 0.0)
            if isnan(x) or time_constant == 0.0:
                x = u_next
            elif h > 0.0:
                kept = exp(-h / time_constant)
                mean = -expm1(-h / time_constant) * time_constant / h  # of the exponential over the step
                x = x * kept + u * (mean - kept) + u_next * (1.0 - mean)
            output[i, j] = x
            u, t = u_next, time[i, j]
    return output


@njit(cache=True)
def _ring(path: FloatArray, time: FloatArray, omega: float, damping: float) -> FloatArray:
    output = path.copy()
    for j in range(path.shape[1]):
        x, rate, u, t = path[0, j], 0.0, path[0, j], time[0, j]
        for i in range(1, len(path)):
            u_next = path[i, j]
            if isnan(u_next):
                continue
            h = max(time[i, j] - t, 0.0)
            if isnan(x):
                x, rate = u_next, 0.0
            elif h > 0.0:
                slope = (u_next - u) / h
                behind = 2.0 * damping * slope / omega
                away, speed = swung(x - u + behind, rate - slope, h, omega, damping)
                x, rate = u_next - behind + away, slope + speed
            output[i, j] = x
            u, t = u_next, time[i, j]
    return output
