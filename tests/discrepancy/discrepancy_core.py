"""Recordings with what the tests of the statistical core hide in them, mostly of two bare joints."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.signal import lfilter

from gpcorrect.sim import Model, machine_of, model_from_dict, simulate
from gpcorrect.sim.effect_paths import joint_path
from gpcorrect.sim.effects import CoulombFriction, Effect, GainError, in_order
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plan import Plan, Segment, plan_of
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

RATE_HZ = 20.0
NOISE = 1e-3
RUNS, SAMPLES = 15, 160


def motors(rng: np.random.Generator, runs: int = RUNS, samples: int = SAMPLES) -> tuple[FloatArray, FloatArray]:
    """Time `(n, N)` and path `(n, N, 2)` of two joints that swing at several speeds."""
    time = np.arange(samples)[:, None] / RATE_HZ + np.zeros(runs)
    rate, phase = rng.uniform(0.4, 2.5, (2, runs, 2)), rng.uniform(0, 2 * np.pi, (2, runs, 2))
    return time, 0.4 * np.sin(rate[0] * time[..., None] + phase[0]) + 0.2 * np.sin(rate[1] * time[..., None] + phase[1])


def noise(rng: np.random.Generator, shape: tuple[int, ...], tail: float = np.inf) -> FloatArray:
    """White noise, perhaps with heavy tails, and slow noise of 0.3 s beside it; time runs along the first axis."""
    white = rng.standard_normal(shape) if np.isinf(tail) else rng.standard_t(tail, shape) / np.sqrt(tail / (tail - 2))
    phi = np.exp(-1.0 / RATE_HZ / 0.3)
    slow = lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], rng.standard_normal(shape), axis=0)
    return NOISE * (0.9 * white + 0.4 * slow)


def joint_log(
    seed: int, *effects: Effect, tail: float = np.inf, sessions: int = 1, more: FloatArray | None = None
) -> CalibrationLog:
    """Motors as reported, and joints as seen from outside with these effects (and `more`, `(n, N, 2)`) and noise."""
    rng = np.random.default_rng(seed)
    time, q = motors(rng)
    session: IntArray = np.arange(RUNS) * sessions // RUNS
    start = np.arange(RUNS) * 60.0
    nothing = np.zeros(q.shape)
    velocity = np.gradient(q, 1.0 / RATE_HZ, axis=0)
    motion = Motion((1, 2), time + start, session, q, velocity, nothing, nothing)
    seen = joint_path(in_order(effects), motion) + noise(rng, q.shape, tail) + (0.0 if more is None else more)
    number = np.broadcast_to(np.arange(RUNS), time.shape)
    return CalibrationLog(
        time=(time + start).T.ravel(),
        trajectory=number.T.ravel(),
        session=session[number].T.ravel(),
        measured_jp=q.transpose(1, 0, 2).reshape(-1, 2),
        external_jp=seen.transpose(1, 0, 2).reshape(-1, 2),
        name="two joints",
    )


def raven_swings(seed: int, runs: int, seconds: float) -> Plan:
    """Return motions in which a RAVEN-II's first three joints swing, each at a speed of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.01)[:, None]
    middle, swing = np.array([0.3, 1.4, -0.38]), np.array([0.7, 0.6, 0.05])
    segments = []
    for run in range(runs):
        rate, phase = rng.uniform(0.5, 2.0, 3), rng.uniform(0.0, 2 * np.pi, 3)
        path = middle + swing * np.sin(rate * t + phase)
        segments.append(Segment(path, np.full(len(path), run), 0, 0.0, 0.2))
    return plan_of(segments, 100.0)


def held_up_raven(*external_jp_white: float, rate_hz: float = 100.0) -> Model:
    """Return a RAVEN-II's first three joints, held up by their controller, with such noise of outside encoders."""
    return model_from_dict(
        {
            "arm": "raven2_left",
            "joints": [1, 2, 3],
            "log_rate_hz": rate_hz,
            "controller": {"kp": [200.0, 200.0, 3000.0], "kd": [10.0, 10.0, 150.0], "feedforward": "gravity"},
            "noise": {"external_jp_white": list(external_jp_white)},
        }
    )


def swings_of(model: Model, *hidden: Effect) -> CalibrationLog:
    """Return a recording of its swings with these effects, without a tracker."""
    log = simulate(machine_of(model).with_effects(*hidden), raven_swings(5, 8, 4.0), seed=7)
    return replace(log, tracker_cp=None)


EVERY = 5  # samples of the fine recording to one of a log
SERVO_MODEL = model_from_dict(
    {
        "arm": "raven2_left",
        "joints": [1, 2, 3],
        "controller": {"kp": [120.0, 120.0, 8000.0], "kd": [12.0, 12.0, 400.0]},
        "transmission": {"motor_inertia": [0.05, 0.05, 2.0]},
    }
)
IN_SERVO: tuple[Effect, ...] = (CoulombFriction(1, torque=0.5, side="motor"), GainError(2, proportional=-0.3))


@cache
def fine(hidden: tuple[Effect, ...] = IN_SERVO, runs: int = 3, hz: float = 500.0) -> CalibrationLog:
    """Return motions at 500 Hz without noise, in which a motor sticks and another's gain is too low."""
    rng, t = np.random.default_rng(1), np.arange(0.0, 8.0, 1.0 / hz)[:, None]
    middle, swing = np.array([0.3, 1.4, -0.38]), np.array([0.5, 0.4, 0.05])
    eased = t - (1.0 - np.exp(-2.0 * t)) / 2.0  # from rest
    segments = []
    for i in range(runs):
        rate, phase = rng.uniform(0.5, 2.5, 3), rng.uniform(0.0, 2 * np.pi, 3)
        path = middle + swing * (np.sin(rate * eased + phase) - np.sin(phase))
        segments.append(Segment(path, np.full(len(path), i), 0, 20.0 * i, 0.2))
    return simulate(machine_of(SERVO_MODEL).with_effects(*hidden), plan_of(segments, hz))
