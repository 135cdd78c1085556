from __future__ import annotations

import numpy as np
import pytest
from support import real_data

from gpcorrect import se3
from gpcorrect.arms import dvrk_psm
from gpcorrect.logs import read_log
from gpcorrect.rigid import Registration, RigidModel, pose_residual, register
from gpcorrect.types import CalibrationLog, PoseSignal


def split(log: CalibrationLog) -> tuple[CalibrationLog, CalibrationLog]:
    """Training and held-out part: the last fifth of the trajectories is held out."""
    ids = log.trajectory_ids
    held = np.isin(log.trajectory, ids[int(0.8 * len(ids)) :])
    return log.select(~held), log.select(held)


@pytest.fixture(scope="module")
def random_motion() -> tuple[Registration, CalibrationLog]:
    train, test = split(read_log(real_data("dvrk_random.csv")))
    return register(train.tracker_cp, train.setpoint_cp, train.trajectory, "auto"), test


def rmse(model: RigidModel, observed: PoseSignal, command: PoseSignal) -> np.ndarray:
    """Root mean square of position (m) and rotation (rad) errors."""
    residual = pose_residual(model.apply(observed), command)
    return np.sqrt((residual**2).reshape(len(residual), 2, 3).sum(axis=2).mean(axis=0))


def test_auto_is_no_worse_than_nothing_on_held_out_real_motion(
    random_motion: tuple[Registration, CalibrationLog],
) -> None:
    """On unseen trajectories of a real arm neither position nor orientation is worse than untouched."""
    registration, test = random_motion
    after = rmse(registration.model, test.tracker_cp, test.setpoint_cp)
    before = rmse(RigidModel(), test.tracker_cp, test.setpoint_cp)
    assert (after <= before).all(), (registration.reason, before, after)


def test_auto_sees_that_position_and_orientation_are_of_different_points(
    random_motion: tuple[Registration, CalibrationLog],
) -> None:
    """Wrist positions with tip orientations are registered each for itself, and the report says why."""
    registration, _ = random_motion
    assert registration.model.kind == "separate"
    assert "left-out trajectories" in registration.reason
    scores = {c.kind: c.score for c in registration.candidates}
    assert scores["separate"] < min(scores["identity"], scores["pose"], scores["marker"])


def test_positions_of_real_motion_register_alone() -> None:
    """The positions by themselves are no worse than untouched either."""
    train, test = split(read_log(real_data("dvrk_random.csv")))
    model = register(PoseSignal(train.tracker_cp.position), train.setpoint_cp, train.trajectory, "auto").model
    before, after = (
        np.sqrt(((m.apply(test.tracker_cp).position - test.setpoint_cp.position) ** 2).sum(axis=1).mean())
        for m in (RigidModel(), model)
    )
    assert after <= before


@pytest.mark.parametrize("name", ["dvrk_wiggle_1.csv", "dvrk_wiggle_2.csv"])
def test_a_single_real_trajectory_with_jumps_is_registered(name: str) -> None:
    """Raw wrist wiggles with fiducial jumps, one trajectory each, come out no worse than untouched."""
    log = read_log(real_data(name))
    observed, command = (
        PoseSignal(*se3.to_parts(dvrk_psm().chain.forward(q))) for q in (log.external_jp, log.setpoint_jp)
    )
    registration = register(observed, command, log.trajectory, "auto")
    chosen = next(c for c in registration.candidates if c.kind == registration.model.kind)
    assert chosen.score <= registration.candidates[0].score
