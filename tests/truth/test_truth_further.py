"""A further recording: the same machine with the same hidden cause, along the plan that was asked for."""

from __future__ import annotations

import numpy as np
from truth import Spec, further_recording, joined, make_truth

from gpcorrect.sim.plan import Plan, Segment, plan_of
from gpcorrect.types import FloatArray

START, REACH = np.array([0.7, 1.4, 0.37]), np.array([0.2, 0.2, 0.02])


def stroke(n: int = 300) -> FloatArray:
    s = np.linspace(0.0, 1.0, n)[:, None]
    return START + s**3 * (10 - 15 * s + 6 * s * s) * REACH


def plan() -> Plan:
    q = stroke()
    runs = [(q, 0, 0.0, 0.0), (q[::-1], 0, 30.0, 0.3), (q, 1, 0.0, None)]
    return plan_of([Segment(p, np.full(len(p), k), s, t, m) for k, (p, s, t, m) in enumerate(runs)], 100.0)


def test_the_plan_is_followed_after_the_first_recording() -> None:
    """Commands are the plan's, payloads too; clock, sessions and trajectories go on from the case's."""
    truth = make_truth(Spec("advised", ("homing_offset",), 1.0, trajectories=4, seconds=4.0), 5)
    log = further_recording(truth, plan(), np.random.default_rng(0))
    before = truth.case.log
    assert log.payload is not None
    first = log.trajectory == before.trajectory.max() + 1
    np.testing.assert_allclose(log.setpoint_jp[first], stroke()[: first.sum()], atol=1e-12)
    assert list(np.unique(log.session)) == [0, 1]
    assert set(log.payload) == {0.0, 0.3}
    both = joined([before, log])
    assert (np.diff(both.time) > 0).all()
    assert len(both) == len(before) + len(log)


def test_the_hidden_cause_is_still_there_and_a_homing_renews_it() -> None:
    """An offset stays until the arm is homed again; the third run has another one."""
    truth = make_truth(Spec("advised", ("homing_offset",), 30.0, trajectories=4, seconds=4.0), 6)
    log = further_recording(truth, plan(), np.random.default_rng(1))
    (hidden,) = truth.hidden
    error = (log.measured_jp - log.external_jp)[:, hidden.column]
    each = [np.nanmedian(error[log.trajectory == k]) for k in np.unique(log.trajectory)]
    offset = float(np.atleast_1d(hidden.params["offset"])[0])
    np.testing.assert_allclose(each[:2], offset, rtol=0.1)
    assert abs(each[2] - offset) > 0.02 * abs(offset)
