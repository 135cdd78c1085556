"""What the arm is asked to do: desired joint paths of parallel runs on the log's clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, IntArray

NOT_LOGGED = -1  # number of a trajectory that is not recorded


@dataclass(frozen=True, eq=False)
class Segment:
    """One continuous motion, best from rest to rest.

    Parameters
    ----------
    q : (n, dof) array, desired joint path at the log's rate, rad or m
    trajectory : (n,) int array, trajectory number of each sample, -1 where nothing is recorded
    session : int, index of the session, from 0
    start : float, seconds since the session began
    payload : float or None, kg at the tip; None is the model's own
    """

    q: FloatArray
    trajectory: IntArray
    session: int = 0
    start: float = 0.0
    payload: float | None = None


@dataclass(frozen=True, eq=False)
class Plan:
    """N runs side by side, the shorter ones holding their last position unrecorded.

    Parameters
    ----------
    rate_hz : float, of the samples
    q : (n, N, dof) array, desired joint paths, rad or m
    trajectory : (n, N) int array, trajectory numbers, -1 where nothing is recorded
    session : (N,) int array, index of the session of each run, from 0
    start : (N,) array, session time at which each run begins, s
    payload : (N,) array, kg at the tip; NaN is the model's own
    begins : (2, N, dof) array or None
        Where the motors are at the start, and how fast, where that is known; held in balance by their controllers when
        None.
    """

    rate_hz: float
    q: FloatArray
    trajectory: IntArray
    session: IntArray
    start: FloatArray
    payload: FloatArray
    begins: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.q.ndim != 3 or len(self.q) < 4:
            raise DataError(f"desired paths must have shape (n >= 4, N, dof), got {self.q.shape}.")
        if not np.isfinite(self.q).all():
            raise DataError("desired paths hold missing numbers.")

    @property
    def session_time(self) -> FloatArray:
        """(n, N) seconds since each run's session began."""
        return np.arange(len(self.q))[:, None] / self.rate_hz + self.start

    def of_runs(self, runs: IntArray) -> Plan:
        """Return the plan of some of the runs.

        Parameters
        ----------
        runs : (k,) int array
        """
        return replace(
            self,
            q=self.q[:, runs],
            trajectory=self.trajectory[:, runs],
            session=self.session[runs],
            start=self.start[runs],
            payload=self.payload[runs],
            begins=None if self.begins is None else self.begins[:, runs],
        )

    def spline(self) -> CubicSpline:
        """Smooth path over seconds since each run's start: what a trajectory interpolator gives the controller."""
        return CubicSpline(np.arange(len(self.q)) / self.rate_hz, self.q)


def plan_of(segments: Sequence[Segment], rate_hz: float) -> Plan:
    """Put segments of any length side by side.

    Parameters
    ----------
    segments : sequence of Segment, of the same joints
    rate_hz : float, samples a second

    Raises
    ------
    DataError
        There is none.
    """
    if not segments:
        raise DataError("a plan needs at least one motion.")
    n = max(len(s.q) for s in segments)
    return Plan(
        rate_hz=rate_hz,
        q=np.stack([np.pad(s.q, ((0, n - len(s.q)), (0, 0)), mode="edge") for s in segments], axis=1),
        trajectory=np.stack(
            [np.pad(s.trajectory, (0, n - len(s.q)), constant_values=NOT_LOGGED) for s in segments], axis=1
        ),
        session=np.array([s.session for s in segments]),
        start=np.array([s.start for s in segments], dtype=np.float64),
        payload=np.array([np.nan if s.payload is None else s.payload for s in segments]),
    )


def payload_in_turn(payloads: Sequence[float], number: int) -> float | None:
    """Return the payload of a motion, kg; None, the model's own, where none are given.

    Parameters
    ----------
    payloads : sequence of float, kg at the tip, taken in turn
    number : int, of the motion, from 0

    Raises
    ------
    DataError
        A payload is no mass.
    """
    if any(not 0.0 <= payload < np.inf for payload in payloads):
        came = ", ".join(f"{payload:g}" for payload in payloads)
        raise DataError(
            f"payloads are masses in kg, 0 or more, got {came}.", hint="Leave them out for the model's own."
        )
    return payloads[number % len(payloads)] if payloads else None


def minimum_jerk(duration: float, rate_hz: float) -> FloatArray:
    """Return the progress `(n,)` of the smoothest motion of a duration: 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985).

    Its peak speed is 1.875 times its mean.

    Parameters
    ----------
    duration : float, s
    rate_hz : float, samples a second
    """
    n = max(2, round(duration * rate_hz) + 1)
    s = np.linspace(0.0, 1.0, n)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def trapezoid(distance: float, speed: float, acceleration: float, rate_hz: float) -> FloatArray:
    """Return the progress `(n,)` over a distance at a cruising speed, with constant acceleration at both ends.

    A distance too short to reach the speed gives a triangle. The duration is rounded up to whole samples.

    Parameters
    ----------
    distance : float, m or rad, >= 0
    speed, acceleration : float, in units of the distance per s and s^2, > 0
    rate_hz : float, samples a second
    """
    if distance == 0:
        return np.array([0.0, 1.0])
    top = min(speed, np.sqrt(distance * acceleration))
    ramp = top / acceleration
    duration = distance / top + ramp
    n = max(2, int(np.ceil(duration * rate_hz - 1e-9)) + 1)
    t = np.linspace(0.0, duration, n)
    rising = 0.5 * acceleration * np.minimum(t, ramp) ** 2
    cruising = top * (np.clip(t, ramp, duration - ramp) - ramp)
    left = np.minimum(duration - t, ramp)
    falling = 0.5 * acceleration * (ramp**2 - left**2)
    progress: FloatArray = np.clip((rising + cruising + falling) / distance, 0.0, 1.0)
    progress[0], progress[-1] = 0.0, 1.0
    return progress
