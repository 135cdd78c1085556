"""Each check of the signals speaks up for its planted fault, and names the signal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import real_data
from sync_support import one_run
from validate_support import clean_log, codes, findings, pose

from gpcorrect import se3
from gpcorrect.arms import arm_named
from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.logs.checks.signals import held_rows
from gpcorrect.logs.validate import refuse_misread, validate_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog, LogMeta, PoseSignal


def findings_of(log, check):
    """Return the errors of one check."""
    return validate_log(log, (check,)).errors


def test_a_tracker_on_rows_of_its_own_is_no_use_to_a_robot():
    """One row that holds both is enough to be silent; a tracker's own file holds nothing to stand apart from."""
    log, even = clean_log(), np.arange(len(clean_log())) % 2 == 0
    seen = PoseSignal.of(np.where(even[:, None], log.tracker_cp.table, np.nan))
    robot = {name: np.where(even[:, None], np.nan, getattr(log, name)) for name in log.JOINTS if name in log.signals}
    poses = {
        n: PoseSignal.of(np.where(even[:, None], np.nan, getattr(log, n).table)) for n in ("setpoint_cp", "measured_cp")
    }
    apart = replace(log, tracker_cp=seen, **robot, **poses, payload=None, temperature=None)
    (found,) = findings_of(apart, "rows_apart")
    assert "--tracker-log" in found.hint
    with pytest.raises(LogError, match="rows of their own"):
        refuse_misread(apart)
    assert not findings_of(replace(apart, setpoint_cp=log.setpoint_cp), "rows_apart")
    assert not findings_of(CalibrationLog(log.time, log.trajectory, log.session, tracker_cp=seen), "rows_apart")


def test_missing_samples_grade_from_information_to_error():
    """One lost sample is information, a fifth is a warning, all is an error; rows and runs are named."""
    for lost, severity in ((slice(40, 41), "info"), (slice(0, 320), "warning"), (slice(None), "error")):

        def blank(p, lost=lost):
            p[lost] = np.nan
            return p

        log = replace(clean_log(), tracker_cp=pose(clean_log().tracker_cp, blank))
        (finding,) = findings(log, "missing")
        assert finding.severity == severity
        assert finding.signal == "tracker_cp"
        count = len(range(*lost.indices(1600)))
        assert finding.count == count
        assert f"at most {count} in a row" in finding.message


def test_a_log_without_command_or_truth_says_so():
    """No setpoint, and no outside measurement, are each warned about."""
    log = clean_log()
    assert findings(replace(log, setpoint_cp=None, setpoint_jp=None), "no_command")
    assert findings(replace(log, tracker_cp=None, external_jp=None), "no_observation")


def test_a_constant_signal_is_an_error_while_others_move():
    """A tracker that shows one pose for ever is an error, and frozen throughout."""
    log = replace(clean_log(), tracker_cp=clean_log().tracker_cp[np.zeros(1600, dtype=int)])
    (constant,) = findings(log, "constant")
    assert (constant.severity, constant.signal) == ("error", "tracker_cp")
    assert findings(log, "frozen")


def test_a_copy_of_the_command_is_no_measurement():
    """Measured equal to setpoint is a warning, a tracker equal to setpoint an error."""
    log = clean_log()
    (robot,) = findings(replace(log, measured_jp=log.setpoint_jp), "loopback")
    assert (robot.severity, robot.signal) == ("warning", "measured_jp")
    (outside, *_) = findings(replace(log, tracker_cp=log.setpoint_cp), "loopback")
    assert (outside.severity, outside.signal) == ("error", "tracker_cp")


def test_a_frozen_tracker_is_found_with_its_rows():
    """Forty repeats while the robot moves are one frozen stretch from its first repeat on."""

    def hold(p):
        p[200:240] = p[199]
        return p

    frozen = pose(clean_log().tracker_cp, hold, hold)
    (finding,) = findings(replace(clean_log(), tracker_cp=frozen), "frozen")
    assert finding.rows == (200,)
    assert finding.count == 40


def test_a_still_robot_does_not_freeze_its_tracker():
    """Repeats while the command rests are not called frozen."""
    log = clean_log()
    rows = np.concatenate([np.zeros(60, dtype=int), np.arange(1540)])
    rest = log.select(rows)
    rest = replace(rest, time=log.time, trajectory=log.trajectory)
    assert not findings(rest, "frozen")


def test_a_tracker_held_between_slower_samples_is_recognised():
    """Each value three times over is a held signal, not a frozen one."""
    rows = 3 * (np.arange(1600) // 3)
    rows = np.where(clean_log().trajectory[rows] == clean_log().trajectory, rows, np.arange(1600))
    log = replace(clean_log(), tracker_cp=clean_log().tracker_cp[rows])
    (held,) = findings(log, "held")
    assert "about 3 times" in held.message
    assert held.severity == "error"  # so that a fit says it: its steps are dropped as faults
    assert not findings(log, "frozen")


@pytest.mark.parametrize("moves", ["setpoint_jp", "measured_jp"])
def test_a_tracker_is_held_beside_joints_as_beside_poses(moves):
    """A robot that reports no pose moves its tracker too: its repeats were taken for samples, and it for late."""
    poses = dict.fromkeys(("setpoint_cp", "measured_cp", "setpoint_jp", "measured_jp", "external_jp"))
    rows = 5 * (np.arange(1600) // 5)
    rows = np.where(clean_log().trajectory[rows] == clean_log().trajectory, rows, np.arange(1600))
    path = np.random.default_rng(1).standard_normal((1600, 3))
    log = replace(clean_log(), **(poses | {moves: path, "tracker_cp": clean_log().tracker_cp[rows]}))
    assert np.array_equal(held_rows(log, "tracker_cp"), rows != np.arange(1600))


@pytest.mark.parametrize("times", [2, 5])
def test_rows_of_a_held_encoder_are_those_that_repeat(times):
    """However smooth its path; the first row of each hold is a sample."""
    t, rows = np.arange(3000) / 100.0, np.arange(3000)
    path = 0.5 * np.sin(1.3 * t)[:, None]
    held = held_rows(one_joint(path, path[times * (rows // times)]), "external_jp")
    assert np.array_equal(held, rows % times > 0)


def test_no_row_of_an_encoder_that_counts_is_held():
    """At one speed counts repeat as regularly as what is held: as many times each."""
    t = np.arange(3000) / 100.0
    path = np.arcsin(np.sin(1.3 * t))[:, None] / np.pi
    for step in np.geomspace(1e-3, 0.1, 12):
        assert not held_rows(one_joint(path, step * np.round(path / step)), "external_jp").any()


def one_joint(path, seen):
    """Return a motion of one joint at 100 Hz, and what an outside encoder says of it."""
    return one_run(np.arange(len(path)) / 100.0, measured_jp=path, setpoint_jp=path, external_jp=seen)


def test_bad_quaternion_norms_are_counted():
    """Quaternions of norm 1.01 are counted; half of the samples make an error."""

    def stretch(q, rows):
        q[rows] *= 1.01
        return q

    tracker = clean_log().tracker_cp
    few = replace(clean_log(), tracker_cp=pose(tracker, change_quaternion=lambda q: stretch(q, slice(10, 15))))
    (finding,) = findings(few, "quaternion_norm")
    assert (finding.severity, finding.count, finding.rows) == ("info", 5, (10, 11, 12, 13, 14))
    many = replace(clean_log(), tracker_cp=pose(tracker, change_quaternion=lambda q: stretch(q, slice(None))))
    assert findings(many, "quaternion_norm")[0].severity == "error"


def test_sign_flips_are_information():
    """Negating every quaternion after row 800 adds a flip there and no alarm."""

    def flip(q):
        q = se3.quaternion_from_matrix(np.broadcast_to(np.eye(3), (1600, 3, 3))).copy()
        q[900:] *= -1
        return q

    log = replace(clean_log(), tracker_cp=pose(clean_log().tracker_cp, change_quaternion=flip))
    (finding,) = [f for f in findings(log, "quaternion_sign") if f.signal == "tracker_cp"]
    assert (finding.severity, finding.rows) == ("info", (900,))


@pytest.mark.parametrize("name", ["tracker_cp", "setpoint_cp"])
@pytest.mark.parametrize(
    "wrong",
    [lambda q: np.roll(q, -1, axis=1), lambda q: np.roll(q, 1, axis=1), lambda q: q * [1, -1, -1, -1]],
    ids=["xyzw for wxyz", "wxyz for xyzw", "inverse"],
)
def test_quaternions_in_another_order_turn_the_other_way(name, wrong):
    """Components in cyclic order, or inverse poses, in the tracker or in the command, are an error."""
    log = replace(clean_log(), **{name: pose(getattr(clean_log(), name), change_quaternion=wrong)})
    assert findings(log, "orientation_inverted")


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_faults_of_the_tracker_invert_nothing(seed):
    """Simulated reaches with the usual faults turn the right way, whole and in fives; read as xyzw they do not."""
    log = debridement_log(seed, reaches=20)
    for first in (0, 5, 10, 15):
        part = log.select((log.trajectory >= first) & (log.trajectory < first + 5))
        assert not findings_of(part, "inverted")
    assert not findings_of(log, "inverted")
    misread = pose(log.tracker_cp, change_quaternion=lambda q: np.roll(q, -1, axis=1))
    assert findings_of(replace(log, tracker_cp=misread), "inverted")


@pytest.mark.parametrize("wrong", [lambda q: np.roll(q, -1, axis=1), lambda q: q * [1, -1, -1, -1]])
def test_a_real_arm_turns_as_it_is_told(wrong):
    """Recorded wrists with errors of ten degrees turn the right way in every part; misread they do not."""
    log = read_log(real_data("dvrk_random.csv"))
    for first in range(0, 5000, 500):
        assert not findings_of(log.select(np.arange(first, first + 500)), "inverted")
    assert findings_of(replace(log, tracker_cp=pose(log.tracker_cp, change_quaternion=wrong)), "inverted")


def test_a_mirrored_tracker_is_seen_beside_its_faults():
    """A left-handed frame is an error and a turned one is none, also with one sample in ten a metre away."""
    true = clean_log().tracker_cp
    astray = true.position.copy()
    astray[::10] += np.random.default_rng(0).uniform(-1, 1, astray[::10].shape)
    frames = (np.diag([1.0, 1.0, -1.0]), True), (np.eye(3)[[1, 0, 2]], True), (np.eye(3)[[1, 2, 0]], False)
    for position in (true.position, astray):
        for frame, mirrored in frames:
            log = replace(clean_log(), tracker_cp=PoseSignal(position @ frame.T))
            assert len(findings(log, "mirrored")) == mirrored


def test_no_change_of_frame_inverts_an_orientation():
    """Another tracker frame, another marker mounting and other signs leave the turning as it is."""
    R = se3.matrix_from_quaternion(clean_log().tracker_cp.quaternion)
    for k in range(4):
        left, right = se3.matrix_from_rotvec(np.random.default_rng(k).uniform(-1.8, 1.8, (2, 3)))
        tracker = PoseSignal(clean_log().tracker_cp.position, se3.quaternion_from_matrix(left @ R @ right))
        assert not findings(replace(clean_log(), tracker_cp=tracker), "orientation_inverted")


def test_joints_beyond_the_limits_are_named():
    """Three samples 5 degrees past the shoulder's limit are named with joint, rows and size."""
    table = clean_log().setpoint_jp.copy()
    table[500:503, 0] = np.deg2rad(95.0)
    (finding,) = findings(replace(clean_log(), setpoint_jp=table), "joint_limit")
    assert finding.severity == "warning"
    assert finding.rows == (500, 501, 502)
    assert "joint 1 leaves 0 to 90 deg" in finding.message
    assert "by up to 5 deg" in finding.message


def test_impossible_speeds_are_counted():
    """A jump of 20 cm between two samples at 50 Hz is 10 m/s: there and back, two samples."""

    def jump(p):
        p[700] += 0.2
        return p

    log = replace(clean_log(), tracker_cp=pose(clean_log().tracker_cp, jump))
    (finding,) = findings(log, "speed")
    assert (finding.severity, finding.count) == ("warning", 2)
    assert finding.rows == (700, 701)


def test_the_other_arm_in_the_sidecar_is_recognised():
    """The left arm's log under the right arm's name: poses follow from joints by the left arm only."""
    log = replace(clean_log(), meta=LogMeta(robot="RAVEN-II", arm="right", joint_types="RRPRRR"))
    found = findings(log, "swapped_arm")
    assert {f.signal for f in found} == {"setpoint_cp", "measured_cp", "tracker_cp"}
    assert all("raven2_left" in f.message for f in found)


def test_the_other_arms_tracker_is_unrelated():
    """A tracker that saw another motion follows the command at no shift."""
    log = replace(clean_log(), tracker_cp=clean_log(7).tracker_cp)
    assert {f.signal for f in findings(log, "unrelated")} == {"tracker_cp"}


def test_the_wrist_point_is_distinguished_from_the_tip():
    """Positions of the wrist point beside orientations of the tip are no one rigid body."""
    arm, log = arm_named("raven2_left"), clean_log()
    wrist = PoseSignal(arm.wrist(log.setpoint_jp), log.setpoint_cp.quaternion)
    (finding,) = findings(replace(log, setpoint_cp=wrist), "wrist_point")
    assert finding.signal == "setpoint_cp"


def test_poses_that_do_not_follow_from_the_joints_are_warned_about():
    """Setpoint poses of another motion than the setpoint joints are not this arm's kinematics."""
    log = replace(clean_log(), setpoint_cp=clean_log(3).setpoint_cp)
    assert "setpoint_cp" in {f.signal for f in findings(log, "kinematics")}


def test_another_base_frame_is_no_misfit():
    """Poses in a base frame of their own, and a tool 3 mm longer, raise no alarm."""
    log = clean_log()
    T = se3.pose(se3.matrix_from_rotvec(np.array([2.0, 0.1, -0.4])), np.array([0.5, 1.0, 2.0]))
    tool = se3.pose(np.eye(3), np.array([3e-3, 0.0, 0.0]))
    arm = arm_named("raven2_left")
    moved = PoseSignal(*se3.to_parts(se3.compose(T, arm.forward(log.setpoint_jp), tool)))
    assert not codes(validate_log(replace(log, setpoint_cp=moved)), "error", "warning")


def test_a_joint_of_the_other_sign_and_exchanged_columns_are_told_apart_from_errors():
    """What a mapping file gets wrong is found in any pair of signals; a joint that errs by a third is none of it."""
    truth = clean_log().setpoint_jp
    noisy = truth + 0.3 * np.std(truth, axis=0) * np.random.default_rng(0).standard_normal(truth.shape)
    flipped, exchanged = noisy.copy(), noisy.copy()
    flipped[:, 1] *= -1.0
    exchanged[:, [0, 2]] = exchanged[:, [2, 0]]
    for external, words in (
        (noisy, []),
        (flipped, ["joint 2 moves the other way"]),
        (exchanged, ["joint 1 moves as joint 3"]),
    ):
        found = findings_of(replace(clean_log(), measured_jp=None, external_jp=external), "joint_sense")
        assert [w for f, w in zip(found, words, strict=True) if w in f.message] == words
