"""Recordings of given joint paths: zig-zags and other calibration motions, over sessions, payloads and hours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.sim.model import Model
from gpcorrect.sim.plan import NOT_LOGGED, Segment, plan_of
from gpcorrect.sim.record import simulate
from gpcorrect.sim.resolve import machine_of
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["DrivenPath", "driven_log"]


@dataclass(frozen=True, eq=False)
class DrivenPath:
    """One path to drive.

    Parameters
    ----------
    q : (n, dof) array
        Desired joints at the model's log rate, rad or m.
    session : int
        Index of the homing.
    start : float
        Seconds since the session began.
    payload : float or None
        kg at the tip.
    approach : (k, dof) array or None
        How the arm gets to where `q` begins; driven at the same rate, but not recorded.
    """

    q: FloatArray
    session: int = 0
    start: float = 0.0
    payload: float | None = None
    approach: FloatArray | None = None

    def segment(self, number: int) -> Segment:
        """Return the motion to plan, recorded as trajectory `number`."""
        before = self.q[:0] if self.approach is None else self.approach
        labels = np.repeat([NOT_LOGGED, number], [len(before), len(self.q)])
        return Segment(np.concatenate([before, self.q]), labels, self.session, self.start, self.payload)


def driven_log(model: Model, paths: Sequence[DrivenPath], seed: int = 0) -> CalibrationLog:
    """Simulate a model that drives these paths, a trajectory each, and record it with its outside encoders."""
    segments = [path.segment(k) for k, path in enumerate(paths)]
    log = simulate(machine_of(model), plan_of(segments, model.log_rate_hz), seed)
    # The calibration study has outside encoders only, and no tracker.
    return replace(log, tracker_cp=None, setpoint_cp=None, measured_cp=None)
