"""A further recording on the same hidden machine: a plan that somebody advised, after what is there already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from gpcorrect.sim.plan import NOT_LOGGED, Plan
from gpcorrect.types import CalibrationLog
from truth.hidden import Hidden
from truth.loop import CONTROL_HZ
from truth.machine import simulate
from truth.recipe import Truth
from truth.record import recorded
from truth.reference import PAUSE, Motion, Reference, laid_out

Array = NDArray[np.float64]

REHOMED = 0.5  # of the spread of what is hidden there, by which a homing moves a zero


def further_recording(truth: Truth, plan: Plan, rng: np.random.Generator) -> CalibrationLog:
    """Let the hidden machine of a case follow a plan, later on in the last of its sessions, and record it.

    Parameters
    ----------
    truth : Truth, the machine, with what is hidden in it; it is restarted at rest at the plan's first pose
    plan : Plan
        Desired paths; each run of it is one trajectory. Its sessions beyond the first are new homings.
    rng : numpy.random.Generator, of noise, and of what a homing changes

    Returns
    -------
    CalibrationLog
        Its clock, sessions and trajectories go on from those of the case.
    """
    setting = truth.setting
    reference = _after(setting.reference, _reference(plan))
    hidden = [_rehomed(h, int(reference.session.max()), rng) for h in truth.hidden]
    _, readings = simulate(setting.machine, reference, hidden)
    return recorded(replace(setting, reference=reference), readings, rng)


def _reference(plan: Plan) -> Reference:
    """Return the reference of a plan, its runs in the order of their clocks."""
    order = np.lexsort((plan.start, plan.session))
    parts, ends = [], []
    for k in order:
        n = int((plan.trajectory[:, k] != NOT_LOGGED).sum())
        parts.append(_motion(plan.q[:n, k], plan.rate_hz))
        ends.append(plan.start[k] + n / plan.rate_hz)
    payload = [0.0 if np.isnan(p) else float(p) for p in plan.payload[order]]
    gaps = [0.0, *(float(plan.start[b] - end) for end, (_, b) in zip(ends, pairwise(order), strict=False))]
    same = [False, *(bool(plan.session[a] == plan.session[b]) for a, b in pairwise(order))]
    waits = [max(0.0, gap - PAUSE) if alike else 0.0 for gap, alike in zip(gaps, same, strict=True)]
    return laid_out(parts, payload, plan.session[order], waits)


def _motion(q: Array, rate_hz: float) -> Motion:
    """Smooth path through samples `(n, 3)`, at the control rate."""
    spline = CubicSpline(np.arange(len(q)) / rate_hz, q)
    steps = np.arange(round((len(q) - 1) / rate_hz * CONTROL_HZ) // 2 * 2) / CONTROL_HZ
    return spline(steps), spline(steps, 1), spline(steps, 2)


def _after(before: Reference, new: Reference) -> Reference:
    """Return a reference whose clocks and numbers go on from another's."""
    wait = before.time[-1] - new.time[0] + PAUSE
    last = int(before.session.max())
    first = new.session == 0
    on = before.session_time[-1] + PAUSE - new.session_time[0]
    since = new.session_time + np.where(first, on, 0.0)
    number = np.where(new.trajectory >= 0, new.trajectory + before.trajectory.max() + 1, -1)
    return replace(new, time=new.time + wait, session_time=since, trajectory=number, session=new.session + last)


def _rehomed(hidden: Hidden, last: int, rng: np.random.Generator) -> Hidden:
    """Return a cause with a new value for every new homing, where it has one a session."""
    if hidden.name != "homing_offset":
        return hidden
    known = np.atleast_1d(hidden.params["offset"])
    more = max(0, last + 1 - len(known))
    if len(known) == 1 and last == 0:
        return hidden
    fresh = known[-1] + REHOMED * np.abs(known).max() * rng.standard_normal(more)
    return replace(hidden, params={"offset": [*known.tolist(), *fresh.tolist()]})


def joined(logs: Sequence[CalibrationLog]) -> CalibrationLog:
    """Return logs of one machine as one, their sessions and trajectories as they are numbered."""
    first = logs[0]
    values = {}
    for name in ("time", "trajectory", "session", "setpoint_jp", "measured_jp", "measured_jf", "external_jp"):
        if getattr(first, name) is not None:
            values[name] = np.concatenate([getattr(log, name) for log in logs])
    for name in ("setpoint_cp", "tracker_cp"):
        signals = [getattr(log, name) for log in logs]
        if signals[0] is not None:
            position = np.concatenate([s.position for s in signals])
            values[name] = replace(
                signals[0], position=position, quaternion=np.concatenate([s.quaternion for s in signals])
            )
    if any(log.payload is not None for log in logs):
        values["payload"] = np.concatenate([np.zeros(len(log)) if log.payload is None else log.payload for log in logs])
    return replace(first, **values)
