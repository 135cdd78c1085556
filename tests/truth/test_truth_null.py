"""Where nothing is hidden, the product's nominal model explains the recording down to its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth import Spec, make_case

from gpcorrect.sim import Outcome, Segment, machine_of, model_from_dict, plan_of, run

SMALL = Spec("null", trajectories=3, seconds=6.0)


def _product(nominal: dict, log) -> Outcome:
    model = model_from_dict(nominal)
    segments = [
        Segment(
            log.setpoint_jp[r], log.trajectory[r], 0, log.time[r[0]], 0.0 if log.payload is None else log.payload[r[0]]
        )
        for _, r in log.trajectories()
    ]
    return run(machine_of(model), plan_of(segments, model.log_rate_hz))


def _rows(values: np.ndarray) -> np.ndarray:
    return np.swapaxes(values, 0, 1).reshape(-1, values.shape[-1])


@pytest.mark.parametrize(
    ("seed", "motion"), [(11, "separating"), (12, "separating"), (13, "separating"), (14, "zigzag")]
)
def test_the_nominal_machine_is_the_same(seed: int, motion: str) -> None:
    """Gravity, inertia, feedforward, gains and table agree: what is left over is a small part of the noise."""
    case = make_case(replace(SMALL, motion=motion), seed)
    outcome = _product(dict(case.nominal), case.log)
    noise = np.array(case.labels["nuisance"]["noise_rms"])
    left = _rows(outcome.motion.position) - case.log.measured_jp
    assert (np.sqrt(np.mean(left**2, axis=0)) < 0.15 * noise).all()
    residual = case.log.external_jp - _rows(outcome.q)
    spread = 1.4826 * np.nanmedian(np.abs(residual), axis=0)
    assert (spread < 1.25 * noise).all()
    assert (np.abs(np.nanmedian(residual, axis=0)) < 0.3 * noise).all()
    effort = _rows(outcome.torque) - case.log.measured_jf
    assert (np.sqrt(np.mean(effort**2, axis=0)) < 0.03 * np.std(case.log.measured_jf, axis=0) + 0.02).all()


def test_every_sort_of_feedforward_is_drawn() -> None:
    """The seeds above cover what a controller may feed forward."""
    drawn = {
        make_case(replace(SMALL, trajectories=1, seconds=5.0), s).nominal["controller"]["feedforward"] for s in range(9)
    }
    assert drawn == {"none", "gravity", "rigid-body"}


def test_a_trackers_poses_are_the_commanded_ones_moved_rigidly() -> None:
    """With a fitted registration the tracker sees the command, up to noise, the loop's lag and its sag."""
    case = make_case(replace(SMALL, signals="tracker"), 4)
    seen, wanted = case.log.tracker_cp.position, case.log.setpoint_cp.position
    good = np.isfinite(seen).all(axis=1)
    a, b = wanted[good] - wanted[good].mean(axis=0), seen[good] - seen[good].mean(axis=0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    assert np.sqrt(np.median(((a @ (U @ Vt) - b) ** 2).sum(axis=1))) < 5e-3
