"""Recordings of joint motion, for any model: also three joints of an arm, or bare joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.arms import RemoteCentreArm
from gpcorrect.errors import DataError
from gpcorrect.sim.model import Model
from gpcorrect.sim.plan import Plan, Segment, minimum_jerk, payload_in_turn, plan_of
from gpcorrect.sim.record import simulate
from gpcorrect.sim.resolve import arm_of, machine_of, rehomed
from gpcorrect.types import CalibrationLog, FloatArray

# All chosen by hand, so that a short recording shows every joint at many speeds, with rests and reversals.
REACH = 0.25  # of a joint's range to either side of its home
BARE_RANGE = {"R": 0.5, "P": 0.05}  # rad and m to either side of zero
MOVE_SECONDS = (0.8, 6.0)  # drawn evenly on a logarithmic scale: a speed ladder
RESTING = 0.3  # fraction of the moves that end in a rest
REST_SECONDS = 0.5  # s
ALONE = 0.3  # fraction of the moves in which one joint moves and the others hold
REST_BETWEEN_RUNS = 10.0  # s


def joint_motion_log(
    model: Model,
    trajectories: int = 24,
    seconds: float = 20.0,
    seed: int = 0,
    *,
    sessions: int = 1,
    payloads: Sequence[float] = (),
) -> CalibrationLog:
    """Simulate random joint moves of a model, at many speeds and amplitudes, with rests and single-joint moves.

    Parameters
    ----------
    model : Model
        Any machine.
    trajectories : int
        How many, over all sessions.
    seconds : float
        Length of each.
    seed : int
        Of targets, homings, noise and faults.
    sessions : int
        The arm is homed anew between sessions.
    payloads : sequence of float
        Payloads at the tip, kg, taken in turn; the model's own when empty.

    Raises
    ------
    DataError
        There are more sessions than trajectories, or nothing to simulate.
    """
    if not 1 <= sessions <= trajectories:
        raise DataError(f"{trajectories} trajectories cannot fill {sessions} sessions.")
    if not 4 <= seconds * model.log_rate_hz < np.inf:
        came = f"{seconds:g} s at {model.log_rate_hz:g} Hz"
        raise DataError(f"a motion has at least four samples and an end, got {came}.", hint="Give its length in s: 20.")
    rng = np.random.default_rng([seed, 3])
    machine = machine_of(rehomed(model, sessions, rng))
    plan = joint_motion_plan(
        joint_ranges(model), trajectories, seconds, machine.log_rate_hz, rng, sessions=sessions, payloads=payloads
    )
    return simulate(machine, plan, seed)


def joint_motion_plan(
    ranges: FloatArray,
    trajectories: int,
    seconds: float,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    sessions: int = 1,
    payloads: Sequence[float] = (),
) -> Plan:
    """Plan random trajectories one after the other.

    Parameters
    ----------
    ranges : (dof, 2) array, in which the joints move, rad or m
    trajectories : int, how many, over all sessions
    seconds : float, length of each
    rate_hz : float, samples a second
    rng : numpy.random.Generator
    sessions : int, the trajectories are divided evenly among them
    payloads : sequence of float, kg at the tip, taken in turn; the model's own when empty
    """
    segments: list[Segment] = []
    for session, numbers in enumerate(np.array_split(np.arange(trajectories), sessions)):
        for i, number in enumerate(numbers):
            q = _moves(ranges, round(seconds * rate_hz), rate_hz, rng)
            payload = payload_in_turn(payloads, len(segments))
            labels = np.full(len(q), number)
            segments.append(Segment(q, labels, session, i * (seconds + REST_BETWEEN_RUNS), payload))
    return plan_of(segments, rate_hz)


def joint_ranges(model: Model) -> FloatArray:
    """Return the range `(dof, 2)`, rad or m, in which a model's joints are moved: around home, inside the limits.

    Parameters
    ----------
    model : Model
    """
    arm = arm_of(model)
    types = (model.joint_types or "R" * len(model.joints)) if arm is None else arm.joint_types
    bare = np.array([BARE_RANGE[kind] for kind in types])
    if arm is None:
        return np.stack([-bare, bare], axis=1)
    columns = [number - 1 for number in model.joints]
    limits, home = arm.limits[columns], arm.home[columns]
    reach = REACH * np.ptp(limits, axis=1)
    if not isinstance(arm, RemoteCentreArm):  # wide limits: whole turns at these paces would take any motor's torque
        reach = np.minimum(reach, bare[columns])
    return np.stack([np.maximum(home - reach, limits[:, 0]), np.minimum(home + reach, limits[:, 1])], axis=1)


def _moves(ranges: FloatArray, n: int, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """Path `(n, dof)` of minimum-jerk moves from the middle of the ranges; the last one may be cut short."""
    here = ranges.mean(axis=1)
    parts, length = [here[None]], 1
    while length < n:
        part = _move(here, ranges, rate_hz, rng)
        parts.append(part)
        length += len(part)
        here = part[-1]
    return np.concatenate(parts)[:n]


def _move(here: FloatArray, ranges: FloatArray, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    goal = rng.uniform(ranges[:, 0], ranges[:, 1])
    if rng.random() < ALONE:
        goal = np.where(np.arange(len(here)) == rng.integers(len(here)), goal, here)
    duration = float(np.exp(rng.uniform(*np.log(MOVE_SECONDS))))
    path = here + minimum_jerk(duration, rate_hz)[1:, None] * (goal - here)
    rest = round(REST_SECONDS * rate_hz) if rng.random() < RESTING else 0
    return np.concatenate([path, np.repeat(goal[None], rest, axis=0)])
