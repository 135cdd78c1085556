"""Laws of poses corrected in the joints: they come nearer, a stream is its path, what is lacking is said."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support import real_data, sealed_file, short_search, small_log

from gpcorrect import se3
from gpcorrect.arms import Chain, Joint
from gpcorrect.calibration import (
    CommandCorrector,
    FitResult,
    FitSettings,
    compare,
    evaluate_model,
    fit_model,
    load,
    reached_path,
    run_experiment,
    save,
    update_model,
)
from gpcorrect.calibration.arm_kinematics import ArmKinematics
from gpcorrect.calibration.model_file import _digest, read_parts
from gpcorrect.errors import ArtifactError, DataError, DegenerateError, LogError
from gpcorrect.logs import read_log
from gpcorrect.rigid import pose_residual
from gpcorrect.sim import random_reaches_log
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

SETTINGS = FitSettings(inducing=100, search_samples=100, marker="none", clean=False)
BY_NAME = replace(SETTINGS, features=("pose", "velocity", "joints"))


@cache
def reaches(seed: int, n: int = 24) -> CalibrationLog:
    """Return a recording of a simulated dVRK, whose wrist has slack."""
    return random_reaches_log("dvrk_psm", n, seed, faults=False)


@pytest.fixture(scope="module")
def learned() -> FitResult:
    """Return what a fit finds that was not asked for joints."""
    return fit_model(reaches(0), SETTINGS)


def poses_of(log: CalibrationLog, n: int) -> tuple[FloatArray, FloatArray]:
    """Return the first n observed poses of a log's first trajectory and their times."""
    rows = np.flatnonzero(log.trajectory == log.trajectory_ids[0])[:n]
    assert log.tracker_cp.quaternion is not None
    return np.hstack([log.tracker_cp.position, log.tracker_cp.quaternion])[rows], log.time[rows]


def test_a_clock_that_starts_again_at_each_motion_is_well() -> None:
    """Logs may have one; joints were left out of account in such a recording, and asked for by name refused."""

    def restarted(log: CalibrationLog) -> CalibrationLog:
        starts = {number: log.time[rows][0] for number, rows in log.trajectories()}
        return replace(log, time=log.time - np.array([starts[number] for number in log.trajectory]))

    model = fit_model(restarted(reaches(0)), BY_NAME).corrector
    assert model.route is not None
    other = reaches(1, 6)
    found, plain = (evaluate_model(model, one).clean_errors["corrected"] for one in (restarted(other), other))
    assert found["position_mm"]["norm"]["rmse"] < 1.5 * plain["position_mm"]["norm"]["rmse"]


def test_a_tracker_without_orientations_is_fitted_without_joints() -> None:
    """Joints are of whole poses: such a recording ended in an error of our own, and by name it is refused in words."""
    log = reaches(0)
    bare = replace(log, tracker_cp=PoseSignal(log.tracker_cp.position))
    said = [remark for remark in fit_model(bare, SETTINGS).remarks if "joints are not used" in remark]
    assert ["no orientation" in remark for remark in said] == [True]
    with pytest.raises(DataError, match="no orientation"):
        fit_model(bare, BY_NAME)


def test_joints_are_taken_where_they_help(learned: FitResult) -> None:
    """On other motion of the same machine they leave less in position and rotation; intervals hold; the fit says so."""
    with_joints, alone = (
        evaluate_model(c, reaches(0, 32), held=np.isin(reaches(0, 32).trajectory, range(24, 32)))
        for c in (learned.corrector, replace(learned.corrector, route=None))
    )
    for part, share in (("position_mm", 0.85), ("rotation_deg", 0.6)):
        errors = [e.dirty_errors["corrected"][part]["norm"]["rmse"] for e in (with_joints, alone)]
        assert errors[0] < share * errors[1]
    assert with_joints.dirty.coverage95.mean() > 0.9
    assert any("in the arm's joints" in remark for remark in learned.remarks)


def test_a_stream_is_its_path_and_a_file_keeps_it(learned: FitResult, tmp_path: Path) -> None:
    """Pose by pose, after a reset, and from the model's file: the same answers."""
    poses, times = poses_of(reaches(3), 60)
    corrector: CommandCorrector = learned.corrector
    save(corrector, tmp_path / "m.gpc")
    path, stream = corrector.correct_path(poses, times), load(tmp_path / "m.gpc").stream()
    for _ in range(2):
        stream.reset()
        answers = [stream.correct(t, pose) for t, pose in zip(times, poses, strict=True)]
        np.testing.assert_allclose([a.position for a in answers], path.position, atol=1e-9)
        np.testing.assert_allclose([a.interval95 for a in answers], path.interval95, atol=1e-9)
    assert "just begun" in answers[0].reason
    assert answers[1].reason == ""


def test_a_path_of_commands_ends_where_it_says(learned: FitResult, tmp_path: Path) -> None:
    """On other motion, by the joints' slack along the path: far nearer than pose by pose, and intervals hold it."""
    log, corrector = reaches(0, 32), learned.corrector
    held = np.isin(log.trajectory, range(24, 32))
    save(corrector, tmp_path / "m.gpc")
    sent, seen = log.setpoint_cp.table[held], log.tracker_cp[np.flatnonzero(held)]
    path = reached_path(load(tmp_path / "m.gpc"), sent, log.time[held])
    alone = reached_path(replace(corrector, route=None), sent, log.time[held])
    errors = [pose_residual(PoseSignal(a.position, a.quaternion), seen) for a in (path, alone)]
    for part, share in ((slice(0, 3), 0.7), (slice(3, 6), 0.5)):
        assert np.linalg.norm(errors[0][:, part]) < share * np.linalg.norm(errors[1][:, part])
    assert (np.abs(errors[0]) <= path.interval95).mean() > 0.9
    with pytest.raises(DataError, match="increas"):
        reached_path(corrector, sent[:3], [0.0, 0.2, 0.1])
    with pytest.raises(DataError, match="slower"):
        reached_path(corrector, sent, 1e3 * log.time[held])


def test_a_single_pose_is_answered_without_joints_and_says_so(learned: FitResult) -> None:
    """Nothing is known of the path: the answer is that of pose and velocity."""
    pose = poses_of(reaches(3), 1)[0][0]
    alone = replace(learned.corrector, route=None)
    one, plain = learned.corrector.correct(pose, np.zeros(6)), alone.correct(pose, np.zeros(6))
    np.testing.assert_array_equal(one.position, plain.position)
    assert "no history" in one.reason
    assert "no history" not in plain.reason


def test_where_the_arm_comes_not_near_poses_alone_answer(learned: FitResult) -> None:
    """A pose beyond the inverse is answered within bounds, outside the training, with an interval no narrower."""
    poses, times = poses_of(reaches(3), 6)
    short = replace(learned.corrector.route, kinematics=replace(learned.corrector.route.kinematics, reach=-1.0))
    stream = replace(learned.corrector, route=short).stream()
    alone = replace(learned.corrector, route=None).stream()
    for t, pose in zip(times, poses, strict=True):
        told, plain = stream.correct(t, pose), alone.correct(t, pose)
        np.testing.assert_array_equal(told.position, plain.position)
        assert told.status == "EXTRAPOLATING"
        assert (told.interval95 >= plain.interval95).all()


def test_a_correction_stays_within_the_bounds_of_poses(learned: FitResult) -> None:
    """Whatever the joints say, no pose moves further than the training's commands justify."""
    poses, times = poses_of(reaches(3), 40)
    bounds = replace(learned.corrector.law.bounds, largest=np.array([1e-4, 1e-3]))
    tight = replace(learned.corrector, law=replace(learned.corrector.law, bounds=bounds))
    reference = tight.rigid.apply(PoseSignal(poses[:, :3], poses[:, 3:]))
    answer = tight.correct_path(poses, times)
    assert np.linalg.norm(answer.position - reference.position, axis=1).max() <= 1e-4 * (1 + 1e-9)
    assert set(answer.status) == {"LIMITED"}


def test_parts_that_do_not_fit_together_are_refused(learned: FitResult) -> None:
    """A model file whose kinematics or joints are not of one arm ends when it is loaded, not in compiled code."""
    route = learned.corrector.route
    for change in (
        {"starts": route.kinematics.starts[:, :5]},
        {"starts": route.kinematics.starts * np.nan},
        {"length": 0.0},
        {"reach": np.nan},
        {"chain": Chain(route.kinematics.chain.joints[:4], "modified")},
    ):
        with pytest.raises(DataError):
            replace(route, kinematics=replace(route.kinematics, **change))
    with pytest.raises(DataError, match="direction"):
        replace(route, intervals=replace(route.intervals, factor=np.ones(3)))


def test_new_recordings_are_added(learned: FitResult) -> None:
    """An update learns in the joints too, and loses little where nothing changed."""
    update = update_model(learned.corrector, reaches(0, 40).select(reaches(0, 40).trajectory >= 24))
    assert update.corrector.route is not None
    assert update.corrector.route.joints.law is not learned.corrector.route.joints.law
    assert update.before is not None
    assert update.after is not None
    errors = [e.clean_errors["corrected"]["rotation_deg"]["norm"]["rmse"] for e in (update.before, update.after)]
    assert errors[1] < 1.1 * errors[0]


def test_an_update_calibrates_intervals_of_poses_anew(learned: FitResult) -> None:
    """Where the new recordings show that intervals are far too narrow or too wide, updated ones are as they show."""
    log = reaches(0, 40).select(reaches(0, 40).trajectory >= 24)
    factors = []
    for off in (0.1, 10.0):
        wrong = replace(learned.corrector.route, intervals=learned.corrector.route.intervals.widened(off))
        update = update_model(replace(learned.corrector, route=wrong), log)
        assert abs(update.before.clean.coverage95.mean() - 0.95) > 0.04
        assert update.after.clean.coverage95.mean() > 0.85
        factors.append(update.corrector.route.intervals.factor)
    np.testing.assert_allclose(factors[0], factors[1])
    few = update_model(replace(learned.corrector, route=wrong), log.select(log.trajectory < 28), holdout=0.0)
    assert (few.corrector.route.intervals.factor >= wrong.intervals.factor).all()


@pytest.mark.parametrize("part", ["kinematics.chain.base", "joints.view.features.centre", "intervals.factor"])
def test_a_file_is_asked_what_its_joints_answer(learned: FitResult, tmp_path: Path, part: str) -> None:
    """Numbers that only paths and streams depend on cannot be changed under a fresh seal either."""
    save(learned.corrector, tmp_path / "m.gpc")
    header, arrays = read_parts(tmp_path / "m.gpc")
    name = f"model.route.{part}"
    arrays[name] = 1.5 * arrays[name] + 0.2
    header["digests"][name] = _digest(arrays[name])
    with pytest.raises(ArtifactError, match="otherwise than when it was saved"):
        load(sealed_file(tmp_path / "forged.gpc", header, arrays))


def test_models_that_differ_in_their_joints_alone_are_not_the_same(learned: FitResult) -> None:
    """Commands of paths are compared as well: single poses are answered without joints."""
    route = learned.corrector.route
    law = replace(route.joints.law, zero=route.joints.law.zero + 0.01)
    other = replace(learned.corrector, route=replace(route, joints=replace(route.joints, law=law)))
    assert compare(learned.corrector, learned.corrector)["commands"]["max_mm"] == 0.0
    assert compare(learned.corrector, other)["commands"]["max_mm"] > 0.1


def test_six_turning_joints_need_no_sidecar() -> None:
    """Of three, six or seven joints the third is taken to insert, as a surgical arm's does; it need not."""
    rng = np.random.default_rng(0)
    joints = (Joint("R", *rng.uniform(-1, 1, 4) * [2, 0.2, 0.2, 3], -1.0, 1.0) for _ in range(6))
    arm = Chain(tuple(joints), "standard")
    q = rng.uniform(-0.5, 0.5, (120, 6))
    poses = PoseSignal(*se3.to_parts(arm.forward(q)))
    log = CalibrationLog(np.arange(120.0), np.zeros(120), np.zeros(120), setpoint_cp=poses, setpoint_jp=q)
    assert ArmKinematics.of(log).chain.joint_types == "RRRRRR"
    with pytest.raises(DataError, match="RRPRRR"):
        ArmKinematics.of(replace(log, meta=replace(log.meta, joint_types="RRPRRR")))


def test_a_gripper_is_left_out_and_two_fingers_determine_nothing() -> None:
    """A joint that does not move the tip is no part of the arm; two that turn it alike cannot be told apart."""
    log = reaches(1, 6)
    assert log.setpoint_jp is not None
    rng, types = np.random.default_rng(0), log.joint_types(6)
    gripper = replace(
        log,
        setpoint_jp=np.hstack([log.setpoint_jp, rng.uniform(0, 1, (len(log), 1))]),
        measured_jp=None, measured_jv=None, measured_jf=None, external_jp=None,
        meta=replace(log.meta, joint_types=types + "R"),
    )  # fmt: skip
    assert ArmKinematics.of(gripper).chain.dof == 6
    fingers = np.array(log.setpoint_jp)
    open_by = rng.uniform(0.2, 1, len(log))
    two = np.column_stack([fingers[:, :5], fingers[:, 5] - open_by / 2, fingers[:, 5] + open_by / 2])
    with pytest.raises((DegenerateError, DataError)):
        ArmKinematics.of(replace(gripper, setpoint_jp=two))


def test_joints_are_not_learned_where_poses_hardly_tell_them() -> None:
    """A wrist with two axes fallen together turns a small error of a pose into a large one of joints: left out."""
    log = reaches(0, 6)
    kinematics = ArmKinematics.of(log)
    q = np.repeat(log.setpoint_jp[:1], 4, axis=0)
    q[:, 4] = [0.0, np.pi / 2 - 0.005, 0.7, np.nan]
    np.testing.assert_array_equal(kinematics.determined(q), [True, False, True, False])


def test_what_a_log_lacks_is_said() -> None:
    """Asked for by name, joints that are not there are refused; by default the log is learned from without them."""
    with pytest.raises(LogError, match="joints"):
        fit_model(small_log(trajectories=6, samples=40), BY_NAME)
    with pytest.raises(DataError, match="memory"):
        fit_model(reaches(0, 4), replace(BY_NAME, features=("pose", "memory", "joints")))
    with short_search():
        plain = fit_model(small_log(trajectories=6, samples=40), FitSettings(clean=False, inducing=60))
    assert plain.corrector.route is None


@pytest.mark.slow
def test_joints_pay_on_a_real_wrist() -> None:
    """On the held-out last fifth of a real dVRK recording they take a quarter of the rotation error; intervals hold."""
    log = read_log(real_data("dvrk_random.csv"))
    experiment = run_experiment(log, replace(BY_NAME, inducing=200, search_samples=200, marker="auto", clean=True))
    assert experiment.test is not None
    errors = experiment.evaluation.clean_errors["corrected"]["rotation_deg"]["norm"]["rmse"]
    alone = evaluate_model(replace(experiment.corrector, route=None), experiment.test)
    assert errors < 0.75 * alone.clean_errors["corrected"]["rotation_deg"]["norm"]["rmse"]
    assert (experiment.evaluation.clean.coverage95 > 0.9).all()
