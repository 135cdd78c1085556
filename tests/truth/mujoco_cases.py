"""MuJoCo's truth for tests: skips where the extra is missing, and small cases, made once."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the second truth needs MuJoCo: pip install 'gpcorrect[mujoco]'")

from truth.history import Readings
from truth_mujoco import Spec
from truth_mujoco.case import Setting, Truth, make_truth, prepared
from truth_mujoco.causes import cause_named
from truth_mujoco.causes.cause import Params
from truth_mujoco.machine import Hidden, simulate
from truth_mujoco.motion import Run

from gpcorrect.sim import Effect, Outcome, Plan, Segment, machine_of, model_from_dict, plan_of, run
from gpcorrect.types import CalibrationLog


@cache
def setting(arm: str = "raven2_left", signals: str = "both", seed: int = 3, feedforward: str = "") -> Setting:
    """Return a machine at its motion, nothing hidden in it: 3 trajectories of 5 s."""
    hidden = {"": (), "none": ("gain_error",), "rigid-body": ("feedforward_error",)}[feedforward]
    spec = Spec("one", arm, hidden, signals=signals, trajectories=3, seconds=5.0)
    return prepared(spec, np.random.default_rng(seed))


@cache
def truth(arm: str, signals: str, seed: int) -> Truth:
    """Return a null case with its recording: 3 trajectories of 6 s."""
    return make_truth(Spec("null", arm, signals=signals, trajectories=3, seconds=6.0), seed)


def with_cause(where: Setting, name: str, column: int, params: Params) -> tuple[Run, Readings]:
    """Run a machine with one cause of given numbers."""
    assert set(cause_named(name).grow + cause_named(name).shrink) <= set(params)
    return simulate(where.machine, where.reference, where.torques, [Hidden(name, column, params)], where.before)


def product_run(nominal: dict, log: CalibrationLog, *effects: Effect) -> Outcome:
    """Let the product's simulator follow the same commands."""
    model = model_from_dict(nominal).with_effects(*effects)
    return run(machine_of(model), plan_along(log, model.log_rate_hz))


def plan_along(log: CalibrationLog, rate_hz: float) -> Plan:
    """Return the commands of a log, a run for each trajectory."""
    payload = np.zeros(len(log)) if log.payload is None else log.payload
    segments = [
        Segment(log.setpoint_jp[r], log.trajectory[r], 0, float(log.time[r[0]]), float(payload[r[0]]))
        for _, r in log.trajectories()
    ]
    return plan_of(segments, rate_hz)


def in_rows(values: np.ndarray) -> np.ndarray:
    """Return values `(n, N, ...)` of equally long runs in the order of a log's rows."""
    swapped = np.swapaxes(values, 0, 1)
    return swapped.reshape(-1, *values.shape[2:])
