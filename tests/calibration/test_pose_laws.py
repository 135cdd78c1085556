"""Laws of the corrector: what it must keep whatever it learned, and that nothing happens at +-180 degrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import short_search, small_log

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, FitSettings, evaluate_model, fit_corrector, fit_model
from gpcorrect.errors import DataError
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

POSE = np.array([0.1, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0])


def path_of_poses() -> tuple[FloatArray, FloatArray]:
    log = small_log(noise=0.0)
    assert log.tracker_cp.quaternion is not None
    return np.hstack([log.tracker_cp.position, log.tracker_cp.quaternion])[:60], log.time[:60]


def test_the_planted_miss_is_learned(small_corrector: CommandCorrector) -> None:
    """On other trajectories with the same miss the corrected error is below 5 % of the raw one."""
    errors = evaluate_model(small_corrector, small_log(seed=1)).clean_errors
    assert errors["corrected"]["position_mm"]["norm"]["rmse"] < 0.05 * errors["raw"]["position_mm"]["norm"]["rmse"]
    assert errors["corrected"]["rotation_deg"]["norm"]["rmse"] < 0.2 * errors["raw"]["rotation_deg"]["norm"]["rmse"]


def test_intervals_cover_the_errors_on_other_trajectories(small_corrector: CommandCorrector) -> None:
    """Intervals calibrated on sixteen trajectories hold on sixteen others, give or take what so few can tell."""
    shares = evaluate_model(small_corrector, small_log(seed=2)).clean.coverage95
    assert (shares > 0.85).all()


def test_a_path_is_its_poses_one_by_one(small_corrector: CommandCorrector) -> None:
    """correct_path equals correct at each pose with the path's own velocity."""
    poses, times = path_of_poses()
    path = small_corrector.correct_path(poses, times)
    for row in (0, 17, 59):
        twist = _twist_at(poses, times, row)
        one = small_corrector.correct(poses[row], twist)
        np.testing.assert_allclose(one.position, path.position[row], atol=1e-9)
        np.testing.assert_allclose(one.quaternion, path.quaternion[row], atol=1e-9)
        np.testing.assert_allclose(one.std, path.std[row], rtol=1e-6)
        assert one.in_domain == path.in_domain[row]


def _twist_at(poses: FloatArray, times: FloatArray, row: int) -> FloatArray:
    from gpcorrect.velocity import twists

    return twists(times, poses[:, :3], se3.matrix_from_quaternion(poses[:, 3:]), np.zeros(len(times), dtype=int))[row]


def test_q_and_minus_q_are_the_same_query(small_corrector: CommandCorrector) -> None:
    """The sign of a quaternion changes nothing."""
    flipped = np.concatenate([POSE[:3], -POSE[3:]])
    first, second = (small_corrector.correct(p, np.zeros(6)) for p in (POSE, flipped))
    np.testing.assert_array_equal(first.position, second.position)
    np.testing.assert_array_equal(first.quaternion, second.quaternion)


def test_the_frame_of_the_tracker_does_not_matter() -> None:
    """Turning and shifting the tracker's frame, in training and query alike, gives the same command to rounding."""
    from dataclasses import replace

    from gpcorrect.types import PoseSignal

    log = small_log(trajectories=8, samples=40)
    assert log.tracker_cp.quaternion is not None
    T = se3.exp(np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.7]))
    moved = se3.to_parts(T @ se3.from_parts(log.tracker_cp.position, log.tracker_cp.quaternion))
    other = replace(log, tracker_cp=PoseSignal(*moved))
    query = se3.to_parts(T @ se3.from_parts(POSE[:3], POSE[3:]))
    settings = FitSettings(inducing=150, search_samples=150, marker="none")
    here = fit_corrector(log, settings).correct(POSE)
    there = fit_corrector(other, settings).correct(np.concatenate(query))
    np.testing.assert_allclose(here.position, there.position, atol=2e-5)
    assert here.quaternion is not None
    assert there.quaternion is not None
    np.testing.assert_allclose(here.quaternion, there.quaternion, atol=2e-4)


def test_without_a_twist_the_answer_says_so(small_corrector: CommandCorrector) -> None:
    """A pose alone is answered as at rest, in words."""
    silent = small_corrector.correct(POSE)
    at_rest = small_corrector.correct(POSE, np.zeros(6))
    np.testing.assert_array_equal(silent.position, at_rest.position)
    assert "at rest" in silent.reason
    assert "at rest" not in at_rest.reason


@pytest.mark.parametrize(
    "pose",
    [
        [0.1, 0, -0.1],
        [0.1, 0, -0.1, 0, 0, 0, 0],
        [0.1, 0, -0.1, 1.5, 0, 0, 0],
        [np.nan, 0, -0.1, 1, 0, 0, 0],
        [0.1, np.inf, -0.1, 1, 0, 0, 0],
        [1e200, 0, -0.1, 1, 0, 0, 0],
        np.eye(4),
    ],
)
def test_bad_poses_are_refused(small_corrector: CommandCorrector, pose: object) -> None:
    """Wrong length, a quaternion off the unit sphere, NaN, infinity and absurd sizes are errors, not answers."""
    with pytest.raises(DataError):
        small_corrector.correct(pose)


@pytest.mark.parametrize("twist", [1e5, 1e6])
def test_whatever_is_answered_is_finite(small_corrector: CommandCorrector, twist: float) -> None:
    """The largest poses and twists that are not refused still get a command of numbers, and are out of domain."""
    answer = small_corrector.correct([1.0, 0, 0, 1, 0, 0, 0], np.full(6, twist))
    assert np.isfinite([*answer.position, *answer.quaternion, *answer.interval95]).all()
    assert not answer.in_domain


def test_a_twist_without_meaning_is_refused(small_corrector: CommandCorrector) -> None:
    """A velocity that overflows the regression is an error, never a command of NaN."""
    with pytest.raises(DataError, match="twist"):
        small_corrector.correct(POSE, [1e200, 0, 0, 0, 0, 0])


def test_nothing_that_was_given_is_changed(small_corrector: CommandCorrector) -> None:
    """Pose, twist and path keep their values."""
    pose, twist = POSE * np.array([1, 1, 1, 1.0005, 1, 1, 1]), np.ones(6) * 0.01
    given = (pose.copy(), twist.copy())
    small_corrector.correct(pose, twist)
    np.testing.assert_array_equal(pose, given[0])
    np.testing.assert_array_equal(twist, given[1])


def test_the_summary_is_plain_data() -> None:
    """What a fit says of itself survives JSON."""
    import json

    result = fit_model(small_log(trajectories=6, samples=40), FitSettings(marker="none"))
    assert json.loads(json.dumps(result.corrector.summary))["fit"]["n_train"] == result.n_train


HALF_TURNS = {"about z": [0, 0, np.pi], "slanted": [2.2, -1.3, 1.8]}


def turned(log: CalibrationLog, R: FloatArray) -> CalibrationLog:
    """Return the log with the tool held differently: every orientation of both signals times R."""
    signals = {}
    for name in ("tracker_cp", "setpoint_cp"):
        signal: PoseSignal = getattr(log, name)
        assert signal.quaternion is not None
        quaternion = se3.quaternion_from_matrix(se3.matrix_from_quaternion(signal.quaternion) @ R)
        signals[name] = PoseSignal(signal.position, quaternion)
    return replace(log, **signals)


@pytest.fixture(scope="module", params=list(HALF_TURNS))
def around_half_a_turn(request: pytest.FixtureRequest) -> tuple[CommandCorrector, FloatArray]:
    """Return a corrector learned around half a turn, and the turn."""
    R = se3.matrix_from_rotvec(np.array(HALF_TURNS[request.param]))
    with short_search():
        return fit_corrector(turned(small_log(), R), FitSettings(marker="none", inducing=300)), R


@pytest.mark.parametrize("axis", range(3))
def test_corrections_are_continuous_across_half_a_turn(
    around_half_a_turn: tuple[CommandCorrector, FloatArray], axis: int
) -> None:
    """Along +-20 degrees in steps of a tenth no correction moves by more than 20 um or 0.05 degrees a step."""
    corrector, R = around_half_a_turn
    path = se3.matrix_from_rotvec(np.deg2rad(np.linspace(-20, 20, 401))[:, None] * np.eye(3)[axis]) @ R
    quaternions = se3.quaternion_from_matrix(path)
    answers = [corrector.correct(np.concatenate([[0.1, 0.0, -0.1], q]), np.zeros(6)) for q in quaternions]
    residual = se3.rotvec_from_matrix(
        se3.matrix_from_quaternion(np.array([a.quaternion for a in answers])) @ np.swapaxes(path, -1, -2)
    )
    positions, widths = np.array([a.position for a in answers]), np.array([a.interval95 for a in answers])
    assert np.abs(np.diff(positions, axis=0)).max() < 2e-5
    assert np.rad2deg(np.abs(np.diff(residual, axis=0)).max()) < 0.05
    assert np.abs(np.diff(np.log(widths), axis=0)).max() < 0.2


def test_the_way_the_tool_is_held_does_not_matter(
    around_half_a_turn: tuple[CommandCorrector, FloatArray], small_corrector: CommandCorrector
) -> None:
    """Learned around half a turn the errors on other trajectories are those learned around none."""
    corrector, R = around_half_a_turn
    there = evaluate_model(corrector, turned(small_log(seed=1), R)).dirty_errors["corrected"]
    here = evaluate_model(small_corrector, small_log(seed=1)).dirty_errors["corrected"]
    for part in ("position_mm", "rotation_deg"):
        assert there[part]["norm"]["rmse"] < 1.2 * here[part]["norm"]["rmse"]


def test_a_turn_that_no_training_pose_was_near_is_outside(small_corrector: CommandCorrector) -> None:
    """Alone and along a path, within the margin of every range and with a variance that says nothing of it."""
    poses, _ = path_of_poses()
    domain = replace(small_corrector.law.domain, novelty=np.inf)
    blind = replace(small_corrector, law=replace(small_corrector.law, domain=domain))
    log = small_log(noise=0.0)
    assert log.tracker_cp.quaternion is not None
    R = se3.matrix_from_quaternion(log.tracker_cp.quaternion)
    mean = se3.rotation_mean(R)
    farthest = np.abs(se3.rotvec_from_matrix(np.swapaxes(mean[None], -1, -2) @ R)).max(axis=0)
    corner, turn = log.tracker_cp.position.max(axis=0), se3.matrix_from_rotvec(1.6 * farthest)
    turned = np.hstack([corner, se3.quaternion_from_matrix((mean @ turn)[None])[0]])[None]
    assert replace(blind, law=replace(blind.law, domain=replace(domain, near=None))).correct(turned[0]).in_domain
    assert not blind.correct(turned[0]).in_domain
    assert not blind.correct_path(turned, [0.0]).in_domain[0]
    assert blind.correct_path(poses, np.arange(60) * 0.1).in_domain.mean() > 0.9
