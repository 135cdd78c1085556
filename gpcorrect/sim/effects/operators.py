"""Operators with memory that effects share, compiled; time runs along the first axis, each column on its own.

They act on the sequence of samples: between two samples the input is taken as monotone or linear, however far apart
they are. A missing sample stays missing and is forgotten. Each takes a path `(n, ...)`, every column on its own, and
returns an array of its shape; and a `memory`, which it moves on: calls with the same memory on one stretch of a path
after the other give what one call on the whole path gives.
"""

from __future__ import annotations

from itertools import pairwise
from math import cos, exp, expm1, isfinite, isnan, sin, sqrt

import numpy as np
from numba import njit

from gpcorrect.types import FloatArray, IntArray

Memory = dict[str, FloatArray]
"""What an effect remembers from one stretch of a motion to the next: empty at the start."""

PAUSES = ("linear", "held", "at_once")
"""What an input does in a pause that is not logged: it moves over evenly, at its end, or at its beginning."""
HELD, AT_ONCE = 1, 2  # of them
CRITICAL = 1e-6  # relative distance from critical damping inside which its limit is used: both agree there to rounding


def play(path: FloatArray, radius: float, memory: Memory | None = None) -> FloatArray:
    """Play (backlash) of half width `radius`: the output moves only when the input pushes an edge of the gap.

    `w_i = min(max(w_{i-1}, u_i - r), u_i + r)`, exact for any input that is monotone between samples; it starts in the
    middle of the gap (Krasnosel'skii and Pokrovskii 1989, Sec. 2).

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    radius : float
        Half width of the gap, in the unit of the path.
    memory : dict, optional
        Moved on; see the module.

    Returns
    -------
    (n, ...) array
        Output.
    """
    return plays(path, np.array([radius]), memory)


def plays(path: FloatArray, radii: FloatArray, memory: Memory | None = None) -> FloatArray:
    """Mean of plays of several half widths: a Prandtl-Ishlinskii operator (Brokate and Sprekels 1996, Sec. 2.4).

    Parameters
    ----------
    path : (n, ...) array
    radii : (k,) array, half widths >= 0, in the unit of the path
    memory : dict, optional
    """
    columns, half_widths = as_columns(path), np.asarray(radii, dtype=np.float64)
    return _plays(columns, half_widths, remembered(memory, len(radii), columns)).reshape(path.shape)


def upright(size: float, phase: float) -> tuple[float, float]:
    """Return the positive size and the phase within half a turn of the same wave, size sin(x + phase).

    Parameters
    ----------
    size : float, of either sign
    phase : float, in rad
    """
    turned = phase + (np.pi if size < 0 else 0.0)
    return abs(size), float(np.angle(np.exp(1j * turned)))


def lag(
    path: FloatArray,
    time: FloatArray,
    time_constant: float,
    session: IntArray | None = None,
    memory: Memory | None = None,
    pause: str = "linear",
    balance: float = 1.0,
) -> FloatArray:
    """First-order lag `T x' + x = u`, exact for an input that is linear between samples; it starts in balance.

    With sessions it goes on from run to run. The first run of a session starts in balance, of an input that is held
    with the last one of the session before, and so does one that does not begin later than the one before it.

    Parameters
    ----------
    path : (n, ...) array
        Input, each column on its own.
    time : array of the path's shape
        s; steps may be uneven.
    time_constant : float
        T >= 0, s.
    session : (N,) int array, optional
        Session of each column; without it the columns know nothing of each other.
    memory : dict, optional
        Moved on; see the module.
    pause : str
        What the input does between two runs, one of `PAUSES`.
    balance : float
        Part of its balance at which it starts.

    Returns
    -------
    (n, ...) array
        Output.
    """
    columns, times = as_columns(path), as_columns(time)
    order = np.arange(columns.shape[1])
    before, settled = np.full((2, len(order)), -1)
    if session is not None:
        order = np.lexsort((times[0], session))
        for a, b in pairwise(order.tolist()):
            if session[a] == session[b] and times[0, b] > times[0, a]:
                before[b] = a
            elif session[a] != session[b] and pause == PAUSES[HELD]:
                settled[b] = a
    state = remembered(memory, 3, columns)
    links = order, before, settled
    return _lag(columns, times, time_constant, *links, PAUSES.index(pause), balance, state).reshape(path.shape)


def ring(
    path: FloatArray, time: FloatArray, frequency_hz: float, damping_ratio: float, memory: Memory | None = None
) -> FloatArray:
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
    memory : dict, optional
        Moved on; see the module.

    Returns
    -------
    (n, ...) array
        Output.
    """
    if np.isinf(frequency_hz):
        return np.array(path)
    columns = as_columns(path)
    state = remembered(memory, 4, columns)
    return _ring(columns, as_columns(time), 2 * np.pi * frequency_hz, damping_ratio, state).reshape(path.shape)


def as_columns(path: FloatArray) -> FloatArray:
    """Return a path (n, ...) as (n, N), as the compiled operators read it.

    Parameters
    ----------
    path : (n, ...) array
    """
    return np.ascontiguousarray(path, dtype=np.float64).reshape(len(path), -1)


def remembered(memory: Memory | None, size: int, columns: FloatArray) -> FloatArray:
    """Return numbers `(size, N)` that an operator goes on from, NaN before the first sample.

    Parameters
    ----------
    memory : dict or None
    size : int
    columns : (n, N) array
    """
    fresh = np.full((size, columns.shape[1]), np.nan)
    return fresh if memory is None else memory.setdefault("state", fresh)


@njit(cache=True)
def _plays(path: FloatArray, radii: FloatArray, state: FloatArray) -> FloatArray:
    output = path.copy()
    for j in range(path.shape[1]):
        for i in range(len(path)):
            u = path[i, j]
            if isnan(u):
                continue
            total = 0.0
            for k in range(len(radii)):
                w = state[k, j]
                w = u if isnan(w) else min(max(w, u - radii[k]), u + radii[k])
                state[k, j] = w
                total += w
            output[i, j] = total / len(radii)
    return output


@njit(cache=True)
def _lag(
    path: FloatArray,
    time: FloatArray,
    time_constant: float,
    order: IntArray,
    before: IntArray,
    settled: IntArray,
    pause: int,
    balance: float,
    state: FloatArray,
) -> FloatArray:
    """Lag of columns taken in an order, each going on from the column `before` it where that is not negative.

    Or from a part of the balance with its first input, or the last one of the column with which it has `settled`.
    """
    output = path.copy()
    for j in order:
        x, u, t = state[0, j], state[1, j], state[2, j]
        for i in range(len(path)):
            u_next, t_next = path[i, j], time[i, j]
            if isnan(u_next):
                continue
            if isnan(x) and before[j] >= 0:
                x, u, t = _end_of(output[:, before[j]], path[:, before[j]], time[:, before[j]], t_next)
                if pause == HELD and time_constant > 0.0:
                    x, t = _linear(x, u, u, t_next - t, time_constant), t_next
                elif pause == AT_ONCE:
                    u = u_next
            elif isnan(x):
                k = settled[j]
                first = u_next if k < 0 else _end_of(path[:, k], path[:, k], time[:, k], np.inf)[1]
                x, u, t = balance * first, u_next, t_next
            x = u_next if time_constant == 0.0 else _linear(x, u, u_next, t_next - t, time_constant)
            u, t, output[i, j] = u_next, t_next, x
        state[0, j], state[1, j], state[2, j] = x, u, t
    return output


@njit(cache=True)
def _end_of(x: FloatArray, u: FloatArray, time: FloatArray, instant: float) -> tuple[float, float, float]:
    """State, input and time of a column's last known sample that is not after an instant, or of its first one."""
    i = max(int(np.searchsorted(time, instant, side="right")) - 1, 0)
    while i > 0 and isnan(u[i]):
        i -= 1
    return x[i], u[i], time[i]


@njit(cache=True)
def _linear(state: float, first: float, last: float, seconds: float, time_constant: float) -> float:
    """State of a lag after an input that went linearly from `first` to `last`."""
    if seconds <= 0.0:
        return state
    left = exp(-seconds / time_constant)
    mean = -expm1(-seconds / time_constant) * time_constant / seconds  # of the exponential over the step
    return state * left + first * (mean - left) + last * (1.0 - mean)


@njit(cache=True)
def _ring(path: FloatArray, time: FloatArray, omega: float, damping: float, state: FloatArray) -> FloatArray:
    output = path.copy()
    for j in range(path.shape[1]):
        x, rate, u, t = state[0, j], state[1, j], state[2, j], state[3, j]
        for i in range(len(path)):
            u_next = path[i, j]
            if isnan(u_next):
                continue
            h = max(time[i, j] - t, 0.0)
            if isnan(x):
                x, rate = u_next, 0.0
            elif h > 0.0:
                slope = (u_next - u) / h
                behind = 2.0 * damping * slope / omega
                away, speed = _swung(x - u + behind, rate - slope, h, omega, damping)
                x, rate = u_next - behind + away, slope + speed
            u, t, output[i, j] = u_next, time[i, j], x
        state[0, j], state[1, j], state[2, j], state[3, j] = x, rate, u, t
    return output


@njit(cache=True)
def _swung(away: float, speed: float, after: float, omega: float, damping: float) -> tuple[float, float]:
    """Place and speed after some time of `x'' + 2 d w x' + w^2 x = 0`, under, at and over critical damping."""
    decay = damping * omega
    lead = speed + decay * away
    split = 1.0 - damping**2
    if abs(split) < CRITICAL:
        fade = exp(-decay * after)
        return fade * (away + lead * after), fade * (lead - decay * (away + lead * after))
    if split > 0.0:
        nu = omega * sqrt(split)
        fade, c, s = exp(-decay * after), cos(nu * after), sin(nu * after)
        x = fade * (away * c + lead / nu * s)
        return x, fade * (lead * c - away * nu * s) - decay * x
    nu = omega * sqrt(-split)
    # The slow root's part and the fast one's, each with its own decay, so that no hyperbolic function overflows.
    slow, fast = exp((nu - decay) * after), exp(-(nu + decay) * after)
    plus, minus = 0.5 * (away + lead / nu), 0.5 * (away - lead / nu)
    return plus * slow + minus * fast, (nu - decay) * plus * slow - (nu + decay) * minus * fast


@njit(cache=True, nogil=True)
def shifted(path: FloatArray, time: FloatArray, delay: float) -> FloatArray:
    """Return paths as they were `delay` seconds before; outside the known time they stand still.

    The curve of :class:`scipy.interpolate.PchipInterpolator`, whose set-up for each path takes ten times as long as the
    walk along it.

    Parameters
    ----------
    path, time : (n, m) arrays
        Values, and seconds that do not fall. Missing values, and rows that repeat a moment, are left out.
    delay : float, s; negative looks ahead
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
