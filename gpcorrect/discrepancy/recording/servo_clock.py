"""The servo's own even clock: logged commands put on it, and what the loop does read back at the log's stamps.

A log's stamps jitter, and rows are lost; a servo steps evenly. Between its samples the command is the smooth path
through those that were logged. Which clock they were logged on, an even one or the stamps', is told by its smoothness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import isotonic_regression

from gpcorrect.discrepancy.recording.layout import Layout
from gpcorrect.discrepancy.settings import CLOCK
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan, Segment, plan_of
from gpcorrect.sim.plant import Driven
from gpcorrect.types import BoolArray, FloatArray, IntArray

RUN_OUT = 40  # rows that a motion goes on for behind a piece's or a recording's end
LAST = 5  # rows whose parabola it goes on along
SHORTEST, TRIED = 8, 17  # rows of the shortest stretches in which a clock's period is sought, and periods tried there
LONG = 1.5  # usual steps that a hole has at least


@dataclass(frozen=True, eq=False)
class Stamps:
    """Where the n samples of N runs lie on the servo's clock: between four samples of it, read by a cubic."""

    first: IntArray  # (n, N) of the four
    weight: FloatArray  # (4, n, N) of each in the cubic

    @classmethod
    def at(cls, place: FloatArray, length: int) -> Stamps:
        """Return those of places `(n, N)`, in samples since a run's start, among so many samples, at least four."""
        first = np.clip(np.floor(place).astype(np.int64) - 1, 0, length - 4)
        x = place - first
        weight = [-(x - 1) * (x - 2) * (x - 3) / 6, x * (x - 2) * (x - 3) / 2]
        weight += [-x * (x - 1) * (x - 3) / 2, x * (x - 1) * (x - 2) / 6]  # Lagrange's polynomials over 0 to 3
        return cls(first, np.array(weight))

    def of_runs(self, runs: IntArray) -> Stamps:
        """Return those of some of the runs.

        Parameters
        ----------
        runs : (k,) int array
        """
        return Stamps(self.first[:, runs], self.weight[:, :, runs])

    def read(self, driven: Driven) -> Driven:
        """Return what a loop did at these stamps."""
        motion = replace(
            driven.motion,
            position=self.sampled(driven.motion.position),
            velocity=self.sampled(driven.motion.velocity),
            load=self.sampled(driven.motion.load),
            gravity_load=self.sampled(driven.motion.gravity_load),
        )
        return Driven(motion, self.sampled(driven.torque), self.sampled(driven.q))

    def sampled(self, grid: FloatArray) -> FloatArray:
        """Return values `(n, N, k)` at these stamps of values on the servo's clock.

        Parameters
        ----------
        grid : (m, N, k) array
        """
        runs = np.arange(grid.shape[1])
        parts = (w[..., None] * grid[self.first + i, runs] for i, w in enumerate(self.weight))
        return np.asarray(sum(parts))


def holes(time: FloatArray) -> BoolArray:
    """Say before which rows `(n,)` of a motion's stamps too long a time without one lies for its command to be bridged.

    Parameters
    ----------
    time : (n,) array, s, rising
    """
    step = np.diff(time, prepend=time[:1])
    usual = np.median(step[step > 0]) if (step > 0).any() else np.inf
    return np.asarray(step > max(CLOCK.hole, LONG * usual))


def settled_stamps(time: FloatArray, label: IntArray, command: FloatArray) -> FloatArray | None:
    """Return when rows were taken `(n,)`: as stamped, or on the even clock that the stamps jitter about.

    Stamps that jitter say either that samples were taken unevenly, or only that they were stamped so; a servo loop run
    on the wrong of the two finds errors of its own. A command is smooth, so that it is the rougher on the wrong clock.
    None where commands are about as rough on either clock, or there is nothing to tell by.

    Parameters
    ----------
    time : (n,) array, s
    label : (n,) int array, of the continuous motion of each row
    command : (n, k) array
    """
    steps = np.diff(time)[np.diff(label) == 0]
    if len(steps) == 0 or not (steps > 0).all() or np.median(steps) < CLOCK.full * np.mean(steps):
        return None
    if _is_even(steps):
        return time
    steady, usual = _on_even_clock(time, label), float(np.median(steps))
    if np.abs(steady - time).max() < CLOCK.even * usual:
        return steady  # only rows are missing
    as_stamped, as_even = _roughness(time, label, command), _roughness(steady, label, command)
    if as_stamped <= CLOCK.clearly * as_even:
        return time
    return steady if as_even <= CLOCK.clearly * as_stamped else None


def _is_even(steps: FloatArray) -> bool:
    usual = np.median(steps)
    return bool((np.abs(steps - usual) < CLOCK.even * usual).all())


def _on_even_clock(time: FloatArray, label: IntArray) -> FloatArray:
    """Put stamps on ticks of an even clock, of one rate for all motions, in their order.

    Its period is that at which the stamps' phases agree best, sought from short stretches to whole motions.
    """
    starts = np.flatnonzero(np.diff(label, prepend=label[0] - 1))
    row = np.arange(len(time)) - np.repeat(starts, np.diff([*starts, len(time)]))
    period, stretch = float(np.median(np.diff(time)[np.diff(label) == 0])), SHORTEST
    while True:
        part = np.unique(np.stack([label, row // stretch]), axis=1, return_inverse=True)[1].ravel()
        periods = period * (1.0 + np.linspace(-1.0, 1.0, TRIED) / stretch)
        period = float(max(periods, key=lambda p: float((np.abs(_agreement(time, p, part)) ** 2).sum())))
        if stretch > row.max():
            break
        stretch *= 2
    motion = np.unique(label, return_inverse=True)[1]
    start = (np.angle(_agreement(time, period, motion)) / (2 * np.pi) * period)[motion]
    ahead = (time - start) / period - row  # grows by one for each row that is lost, and jitters
    for k in range(motion.max() + 1):
        ahead[motion == k] = isotonic_regression(ahead[motion == k]).x
    tick = row + np.rint(ahead)
    middle, number = (np.bincount(motion, of)[motion] / np.bincount(motion)[motion] for of in (time, tick))
    off = tick - number
    return np.asarray(middle + off * (off @ (time - middle)) / (off @ off))  # the line through all motions' stamps


def _agreement(time: FloatArray, period: float, part: IntArray) -> NDArray[np.complex128]:
    """Sum of the unit phases of stamps on a clock of a period, of each part."""
    turn = 2 * np.pi * (time / period)
    total: NDArray[np.complex128] = np.bincount(part, np.cos(turn)) + 1j * np.bincount(part, np.sin(turn))
    return total


def _roughness(time: FloatArray, label: IntArray, path: FloatArray) -> float:
    """Mean square by which rows of a path `(n, k)` miss the cubic through two neighbours on either side.

    In units of what white noise of the size of each joint's motion would have.
    """
    total, size = 0.0, np.maximum(np.var(path, axis=0), np.finfo(np.float64).tiny)
    for rows in (np.flatnonzero(label == k) for k in np.unique(label)):
        n = len(rows) - 4
        if n <= 0:
            continue
        near = [rows[i : i + n] for i in (0, 1, 3, 4)]
        at = [time[r] - time[rows[2 : n + 2]] for r in near]
        ends = [[at[j] / (at[j] - at[i]) for j in range(4) if j != i] for i in range(4)]
        weights = [np.prod(end, axis=0) for end in ends]  # Lagrange's, at the middle row
        missed = path[rows[2 : n + 2]] - sum(w[:, None] * path[r] for w, r in zip(weights, near, strict=True))
        total += float(((missed**2 / size).sum(axis=1) / (1.0 + sum(w**2 for w in weights))).sum())
    return total


def commanded_plan(
    command: FloatArray, layout: Layout, motion: Motion, payload: FloatArray
) -> tuple[Plan, Stamps | None]:
    """Return the plan of logged commands, a run for each column of their layout, and the log's stamps on its clock.

    There are no stamps where the log's own clock is even.

    Parameters
    ----------
    command : (m, k) array, of the log's rows
    layout : Layout, of these rows
    motion : Motion, with their times
    payload : (N,) array, kg
    """
    time = motion.time - motion.time[0]
    length = np.argmax(layout.rows, axis=0) + 1  # behind its end a column repeats its last row
    steps = np.diff(motion.time, axis=0)[layout.valid[1:]]
    step, even = float(np.median(steps)), _is_even(steps)
    place = time / step
    paths = [command[layout.rows[:n, k]] for k, n in enumerate(length)]
    if not even:
        paths = [_on_clock(place[:n, k], path) for k, (n, path) in enumerate(zip(length, paths, strict=True))]
    longest = max(4, *(len(path) for path in paths))
    segments = []
    for k, path in enumerate(_run_out(path, longest) for path in paths):
        trajectory, session, start = np.zeros(len(path), dtype=np.int64), int(motion.session[k]), motion.time[0, k]
        segments.append(Segment(path, trajectory, session, float(start), float(payload[k])))
    plan = plan_of(segments, 1.0 / step)
    return plan, None if even else Stamps.at(place, len(plan.q))


def _on_clock(place: FloatArray, path: FloatArray) -> FloatArray:
    """Put a path `(n, dof)` that was sampled at these places `(n,)` on every whole one, as far as it goes."""
    kept = [0]
    for i in range(1, len(place)):
        if place[i] - place[kept[-1]] >= CLOCK.near:
            kept.append(i)
    on = np.arange(int(np.ceil(place[-1])) + 1)
    return CubicSpline(place[kept], path[kept])(on) if len(kept) > 1 else np.repeat(path[:1], len(on), axis=0)


def _run_out(path: FloatArray, n: int) -> FloatArray:
    """Let a path `(m, dof)` that ends before the grid's n samples swing on, with its last acceleration.

    A hard stop would be an acceleration that no motor was asked for, and the interpolation would spread it backwards.
    """
    more, last = min(RUN_OUT, n - len(path)), path[-LAST:]
    if more <= 0 or len(last) < LAST:
        return path
    t = np.arange(1 - LAST, more + 1)
    on = np.polynomial.polynomial.polyval(t[LAST:], np.polynomial.polynomial.polyfit(t[:LAST], last - last[-1], 2))
    return np.concatenate([path, last[-1] + on.T])
