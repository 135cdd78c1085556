"""What the arm is told to do: runs that tell look-alikes apart, or plain zig-zags; of a session parts are logged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truth.arm import RANGES
from truth.loop import CONTROL_HZ, TICK_HZ

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LOG_HZ = 100
SETTLE = 1.0  # s of unlogged rest before each trajectory
TRANSIT = 2.0  # s to the next start, when that is elsewhere
PAUSE = 8.0  # s that the log's clock jumps between trajectories, the arm at rest
SESSION_BREAK = 600.0  # s
ZIGZAG_SPEED = np.array([0.12, 0.16, 0.014])  # rad/s, rad/s, m/s, drawn 20 % about
BLEND = 0.1  # s; width of each of the two windows that round a zig-zag's corners
PAYLOADS = (0.0, 0.18, 0.0, 0.33)  # kg, in turn

Motion = tuple[Array, Array, Array]
Move = tuple[Array, float, float]  # where to, and seconds of the way and of the rest there


@dataclass(frozen=True, eq=False)
class Reference:
    """Desired motion at the control rate `(m, k)`, and what holds at each tick `(n,)`.

    `time` is the log's clock, `session_time` counts from each session's first logged sample; `trajectory` is -1 where
    none is logged.
    """

    position: Array
    speed: Array
    acceleration: Array
    time: Array
    session_time: Array
    trajectory: Ints
    session: Ints
    payload: Array

    @property
    def logged(self) -> Ints:
        """Ticks of the log's samples."""
        stride = TICK_HZ // LOG_HZ
        rows = np.flatnonzero(self.trajectory >= 0)
        first = np.r_[True, np.diff(self.trajectory[rows]) != 0]
        start = rows[first][np.cumsum(first) - 1]
        return rows[(rows - start) % stride == 0]

    def only(self, numbers: Ints) -> Reference:
        """Return the reference of some of its trajectories, each with the unlogged rest before it.

        They must start where the ones before them end.
        """
        owner = self._owner()
        ticks = np.isin(owner, numbers)
        control = np.repeat(ticks, CONTROL_HZ // TICK_HZ)
        return Reference(
            self.position[control], self.speed[control], self.acceleration[control], self.time[ticks],
            self.session_time[ticks], self.trajectory[ticks], self.session[ticks], self.payload[ticks],
        )  # fmt: skip

    def _owner(self) -> Ints:
        """Trajectory that each tick belongs to or leads up to."""
        known = np.flatnonzero(self.trajectory >= 0)
        nearest = known[np.minimum(np.searchsorted(known, np.arange(len(self.time))), len(known) - 1)]
        return self.trajectory[nearest]


def separating(
    rng: np.random.Generator,
    trajectories: int,
    seconds: float,
    sessions: int = 1,
    ranges: Array = RANGES,
    payloads: tuple[float, ...] = PAYLOADS,
) -> Reference:
    """Speed ladder, amplitudes, holds, single joints, load swaps; every trajectory leaves and regains one pose.

    `ranges` (k, 2) are the places, rad or m, that each joint goes to; `payloads`, kg, take turns.
    """
    kinds: tuple[Callable[..., list[Move]], ...] = (
        _ladder, _amplitudes, _wander, _single, _holds, _wander,
    )  # fmt: skip
    home = ranges.mean(axis=1) + 0.1 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, len(ranges))
    parts = [
        _fill(kinds[k % len(kinds)](rng, home, k // len(kinds), ranges), home, seconds) for k in range(trajectories)
    ]
    payload = [payloads[(k + k // len(kinds)) % len(payloads)] for k in range(trajectories)]
    return _session(parts, payload, sessions)


def zigzag(
    rng: np.random.Generator,
    trajectories: int,
    seconds: float,
    sessions: int = 1,
    ranges: Array = RANGES,
    typical: Array = ZIGZAG_SPEED,
) -> Reference:
    """Every joint to and fro at its own constant speed, from new starting points."""
    speeds = typical * rng.uniform(0.8, 1.2, len(ranges))
    parts = [_zigzag(rng, speeds, seconds, ranges) for _ in range(trajectories)]
    return _session(parts, [0.0] * trajectories, sessions)


def _quintic(here: Array, there: Array, seconds: float) -> Motion:
    """Minimum-jerk move without its last sample."""
    s = np.arange(round(seconds * CONTROL_HZ))[:, None] / (seconds * CONTROL_HZ)
    way = there - here
    return (
        here + way * s**3 * (10 - 15 * s + 6 * s * s),
        way * 30 * s**2 * (1 - s) ** 2 / seconds,
        way * 60 * s * (1 - s) * (1 - 2 * s) / seconds**2,
    )


def _rest(here: Array, seconds: float) -> Motion:
    n = round(seconds * CONTROL_HZ)
    return np.tile(here, (n, 1)), np.zeros((n, len(here))), np.zeros((n, len(here)))


def _join(parts: list[Motion]) -> Motion:
    position, speed, acceleration = (np.concatenate(p) for p in zip(*parts, strict=True))
    return position, speed, acceleration


def _fill(moves: list[Move], home: Array, seconds: float) -> Motion:
    """As many of the moves (target, duration, rest) as fit, again and again, then home and rest."""
    here, left, parts, k = home, seconds - 0.4, [_rest(home, 0.4)], 0
    while True:
        target, duration, rest = moves[k % len(moves)]
        if duration + rest + 1.6 > left:
            break
        parts += [_quintic(here, target, duration), _rest(target, rest)]
        here, left, k = target, left - round(duration, 3) - round(rest, 3), k + 1
    back = min(left, 2.5)
    parts.append(_quintic(here, home, back))
    motion = _join(parts)
    missing = seconds - len(motion[0]) / CONTROL_HZ
    return _join([motion, _rest(home, missing)]) if missing > 0 else motion


def _target(rng: np.random.Generator, ranges: Array) -> Array:
    return rng.uniform(ranges[:, 0], ranges[:, 1])


def _ladder(rng: np.random.Generator, home: Array, turn: int, ranges: Array) -> list[Move]:
    """Return the same way out and back at durations on a logarithmic scale."""
    away = _target(rng, ranges)
    return [move for duration in (0.9, 1.4, 2.2, 3.4) for move in ((away, duration, 0.1), (home, duration, 0.1))]


def _amplitudes(rng: np.random.Generator, home: Array, turn: int, ranges: Array) -> list[Move]:
    """To both sides by shrinking amounts: minor loops."""
    reach = 0.45 * np.ptp(ranges, axis=1) * rng.choice([-1.0, 1.0], len(ranges))
    middle = ranges.mean(axis=1)
    return [(middle + sign * share * reach, 0.8 + share, 0.0) for share in (1.0, 0.6, 0.3, 0.1) for sign in (1, -1)]


def _wander(rng: np.random.Generator, home: Array, turn: int, ranges: Array) -> list[Move]:
    return [(_target(rng, ranges), float(np.exp(rng.uniform(0.0, 1.4))), 0.2 * (rng.random() < 0.3)) for _ in range(15)]


def _holds(rng: np.random.Generator, home: Array, turn: int, ranges: Array) -> list[Move]:
    """Quick moves to far poses with long rests: load, hold, unload, recover."""
    return [(_target(rng, ranges), 1.2, 2.8) for _ in range(8)]


def _single(rng: np.random.Generator, home: Array, turn: int, ranges: Array) -> list[Move]:
    """One joint moves while the others hold, at two poses of the others."""
    moves: list[Move] = []
    joint = turn % len(ranges)
    for _ in range(4):
        pose = _target(rng, ranges)
        moves.append((pose, 1.5, 0.2))
        for share in (0.05, 0.95, 0.4):
            pose = pose.copy()
            pose[joint] = ranges[joint, 0] + share * np.ptp(ranges[joint])
            moves.append((pose, 1.4, 0.2))
    return moves


def _zigzag(rng: np.random.Generator, speeds: Array, seconds: float, ranges: Array) -> Motion:
    n = round(seconds * CONTROL_HZ)
    pad = CONTROL_HZ
    t = np.r_[np.zeros(pad // 2), np.arange(n + pad // 2) / CONTROL_HZ][:, None]
    span = np.ptp(ranges, axis=1) * 0.94
    phase = (rng.uniform(0, 2, len(ranges)) * span + speeds * t) % (2 * span)
    q = ranges[:, 0] + 0.03 * np.ptp(ranges, axis=1) + np.minimum(phase, 2 * span - phase)
    window = np.ones(round(BLEND * CONTROL_HZ)) / round(BLEND * CONTROL_HZ)
    for _ in range(2):
        q = np.column_stack([np.convolve(column, window, mode="same") for column in q.T])
    speed = np.gradient(q, 1 / CONTROL_HZ, axis=0)
    rows = slice(pad // 2 - 2 * len(window), pad // 2 - 2 * len(window) + n)
    return q[rows], speed[rows], np.gradient(speed, 1 / CONTROL_HZ, axis=0)[rows]


def _session(parts: list[Motion], payloads: list[float], sessions: int) -> Reference:
    """Lay trajectories one after the other, sharing them evenly among the sessions."""
    groups = np.array_split(np.arange(len(parts)), sessions)
    session = np.concatenate([np.full(len(g), k) for k, g in enumerate(groups)])
    return laid_out(parts, payloads, session)


def laid_out(parts: list[Motion], payloads: list[float], session: Ints, waits: list[float] | None = None) -> Reference:
    """Lay trajectories one after the other, with rests and transits between them.

    Parameters
    ----------
    parts : list of Motion, position, speed and acceleration of each trajectory at the control rate
    payloads : list of float, kg, of each
    session : (N,) int array, of each, from 0; they follow one another
    waits : list of float, optional, seconds of the log's clock before each trajectory, beyond the usual pause
    """
    per_tick = CONTROL_HZ // TICK_HZ
    motions, columns, clock, began, here = [], [], 0.0, 0.0, parts[0][0][0]
    for k, (part, payload) in enumerate(zip(parts, payloads, strict=True)):
        begins = k == 0 or session[k] != session[k - 1]
        if k and begins:
            clock += SESSION_BREAK
        clock += waits[k] if waits else 0.0
        start = part[0][0]
        lead = [_rest(start, SETTLE)]
        if np.abs(start - here).max() > 1e-9:
            lead.insert(0, _quintic(here, start, TRANSIT))
        whole = _join([*lead, part])
        n, n_lead = len(whole[0]) // per_tick, sum(len(m[0]) for m in lead) // per_tick
        time = clock + np.arange(n) / TICK_HZ
        began = time[n_lead] if begins else began
        label = np.where(np.arange(n) < n_lead, -1, k)
        columns.append((time, time - began, label, np.full(n, session[k]), np.full(n, payload)))
        motions.append(whole)
        here = whole[0][-1]
        clock = time[-1] + PAUSE
    time, session_time, trajectory, session_of, payload_of = (np.concatenate(c) for c in zip(*columns, strict=True))
    return Reference(*_join(motions), time, session_time, trajectory, session_of, payload_of)
