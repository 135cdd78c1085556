"""Small machines and plans that the simulator's tests share."""

from __future__ import annotations

import numpy as np

from gpcorrect.arms import arm_named
from gpcorrect.sim import Machine, Plan, Segment, plan_of
from gpcorrect.sim.body import Body, Drive, Feedforward, Links
from gpcorrect.sim.effects import Effect
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import minimum_jerk
from gpcorrect.types import FloatArray

RATE_HZ = 100.0
INERTIA = np.array([0.26, 0.21, 66.0])
INFINITE = float("inf")


def drive(feedforward: Feedforward = "none", bandwidth_hz: float = 8.0, rate_hz: float = 1000.0) -> Drive:
    """PD of that bandwidth, critically damped, on RAVEN-like rotors."""
    omega = 2 * np.pi * bandwidth_hz
    return Drive(INERTIA * omega**2, 2 * omega * INERTIA, INERTIA, rate_hz, feedforward)


def weightless(*effects: Effect, drive: Drive | None = None) -> Machine:
    """Three bare joints, RRP."""
    body = Body((1, 2, 3), "RRP", None, np.zeros(0), Links.none(), np.zeros(3))
    return Machine("joints", body, drive or globals()["drive"](), RATE_HZ, effects)


def raven(*effects: Effect, drive: Drive | None = None, inertia: float = 1e-3) -> Machine:
    """Joints 1 to 3 of the left RAVEN-II with its masses."""
    arm = arm_named("raven2_left")
    links = Links(
        np.array([link.mass for link in arm.links]),
        np.array([link.com for link in arm.links]),
        np.full((3, 3), inertia),
        np.zeros(1),
    )
    body = Body((1, 2, 3), "RRP", arm.chain, np.zeros(3), links, arm.gravity)
    return Machine("raven2_left", body, drive or globals()["drive"](), RATE_HZ, effects)


def moves(seed: int = 0, runs: int = 3, seconds: float = 6.0, payload: float | None = None) -> Plan:
    """Minimum-jerk moves of three joints around RAVEN-II's home, each run one trajectory."""
    rng = np.random.default_rng(seed)
    home, reach = np.array([0.52, 1.57, 0.36]), np.array([0.3, 0.3, 0.04])
    n = round(seconds * RATE_HZ)
    segments = []
    for number in range(runs):
        here, parts = home, [home[None]]
        while sum(map(len, parts)) < n:
            goal = home + reach * rng.uniform(-1, 1, 3)
            parts.append(here + minimum_jerk(rng.uniform(0.8, 2.0), RATE_HZ)[1:, None] * (goal - here))
            here = goal
        segments.append(Segment(np.concatenate(parts)[:n], np.full(n, number), payload=payload))
    return plan_of(segments, RATE_HZ)


def hold(q: FloatArray, seconds: float = 2.0, payload: float | None = None) -> Plan:
    """One run that holds joints `q` (dof,)."""
    n = round(seconds * RATE_HZ)
    return plan_of([Segment(np.tile(q, (n, 1)), np.zeros(n, dtype=np.int64), payload=payload)], RATE_HZ)


def constant_speed(speed: FloatArray, seconds: float = 4.0) -> Plan:
    """One run in which every joint moves at its own constant speed (dof,) from zero."""
    n = round(seconds * RATE_HZ)
    q = np.arange(n)[:, None] / RATE_HZ * speed
    return plan_of([Segment(q, np.zeros(n, dtype=np.int64))], RATE_HZ)


def motion(n: int = 50, runs: int = 2, dof: int = 3, seed: int = 0, sessions: int = 1) -> Motion:
    """Random motor motion with loads, as effects see it."""
    rng = np.random.default_rng(seed)
    shape = (n, runs, dof)
    position, velocity, load, gravity = (rng.standard_normal(shape) for _ in range(4))
    time = np.arange(n)[:, None] / RATE_HZ + np.arange(runs) * 100.0
    return Motion(tuple(range(1, dof + 1)), time, np.arange(runs) % sessions, position, velocity, load, gravity)
