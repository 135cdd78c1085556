import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.sim import TrackerFaults, debridement_log, joint_motion_log, model_from_dict, preset, random_reaches_log
from gpcorrect.sim.record import Fault, corrupted
from gpcorrect.types import CalibrationLog

ARMS = ["raven2_left", "raven2_right", "dvrk_psm"]


@pytest.fixture(scope="module")
def debridement():
    return debridement_log(0)


@pytest.fixture(scope="module")
def clean():
    return debridement_log(0, faults=False)


def same(a: CalibrationLog, b: CalibrationLog) -> bool:
    tracker = np.array_equal(a.tracker_cp.position, b.tracker_cp.position, equal_nan=True)
    return tracker and np.array_equal(a.external_jp, b.external_jp) and np.array_equal(a.time, b.time)


def raw_errors(log):
    """Position error norms, mm, and rotation errors, deg, between tracked and commanded pose."""
    shift = np.linalg.norm(log.tracker_cp.position - log.setpoint_cp.position, axis=1)
    rotations = [se3.matrix_from_quaternion(s.quaternion) for s in (log.tracker_cp, log.setpoint_cp)]
    return 1e3 * shift, np.rad2deg(se3.angle(rotations[0] @ np.swapaxes(rotations[1], 1, 2)))


def test_debridement_has_the_size_of_the_study(clean):
    """303 reaches, about 24,000 pairs at 100 Hz, in a box of 8 x 8 x 2 cm, at 5 cm/s."""
    assert len(clean.trajectory_ids) == 303
    assert len(clean) == pytest.approx(24000, rel=0.05)
    steps = np.concatenate([np.diff(clean.time[rows]) for _, rows in clean.trajectories()])
    np.testing.assert_allclose(steps, 0.01, atol=1e-9)
    up = np.array([1.0, 0.0, 0.0])  # against gravity, base frame of RAVEN-II
    assert np.ptp(clean.setpoint_cp.position @ up) <= 0.02 + 1e-9
    assert np.linalg.norm(np.ptp(clean.setpoint_cp.position, axis=0)) <= np.linalg.norm([0.08, 0.08, 0.02]) * 1.01
    speed = np.concatenate(
        [
            np.linalg.norm(np.diff(clean.setpoint_cp.position[rows], axis=0), axis=1) * 100
            for _, rows in clean.trajectories()
        ]
    )
    assert speed.max() <= 0.05 * (1 + 1e-6)
    assert np.median(speed) > 0.035


def test_debridement_errors_are_of_the_order_of_table_one(clean):
    """Before any correction: about 26 mm and 20 degrees (Mahler et al. 2014, Table I)."""
    shift, turn = raw_errors(clean)
    assert 22 < shift.mean() < 31
    assert 17 < turn.mean() < 24


def test_a_fixed_offset_leaves_several_millimetres(clean):
    """The best rigid motion of positions leaves 5 to 9 mm: what is left is no offset."""
    seen, told = clean.tracker_cp.position, clean.setpoint_cp.position
    R = se3.nearest_rotation((told - told.mean(0)).T @ (seen - seen.mean(0)))
    left = np.linalg.norm((seen - seen.mean(0)) @ R.T + told.mean(0) - told, axis=1)
    assert 5e-3 < left.mean() < 9e-3


def test_debridement_errors_depend_on_velocity(clean):
    """Joint speed explains much of joints 1 to 3's residual that their position does not."""
    error = clean.setpoint_jp - clean.external_jp
    for j in range(3):
        q = np.column_stack([np.ones(len(clean)), clean.setpoint_jp, clean.setpoint_jp**2])
        qv = np.column_stack([q, clean.measured_jv[:, j], np.sign(clean.measured_jv[:, j])])
        left = [np.std(error[:, j] - X @ np.linalg.lstsq(X, error[:, j], rcond=None)[0]) for X in (q, qv)]
        assert left[1] < 0.5 * left[0]


def test_debridement_faults_are_labelled(debridement, clean):
    """The fault column is right: good samples are those of the clean recording, and each fault occurs."""
    code = debridement.extra["fault"]
    good = code == Fault.GOOD
    np.testing.assert_array_equal(debridement.tracker_cp.position[good], clean.tracker_cp.position[good])
    assert set(np.unique(code)) == {float(f) for f in Fault}
    assert 0.85 < good.mean() < 0.95
    block = np.flatnonzero(code == Fault.LOST_FIDUCIAL)
    assert 0.02 <= len(block) / len(code) <= 0.04
    assert np.ptp(block) == len(block) - 1
    np.testing.assert_array_equal(~debridement.tracker_cp.finite, code == Fault.DROPOUT)


def test_a_seed_decides_everything():
    """The same seed gives the same recording, another seed another one."""
    logs = [debridement_log(seed, reaches=3) for seed in (5, 5, 6)]
    assert same(logs[0], logs[1])
    assert not np.array_equal(logs[0].setpoint_jp[:50], logs[2].setpoint_jp[:50])


def test_measured_poses_know_nothing_of_what_lies_behind_the_motors(clean):
    """The robot believes itself nearly on target; only the tracker sees the error."""
    own = np.linalg.norm(clean.measured_cp.position - clean.setpoint_cp.position, axis=1)
    assert own.mean() < 2e-3 < 0.1 * np.mean(raw_errors(clean)[0])


@pytest.mark.parametrize("name", ARMS)
def test_random_reaches_of_every_arm(name):
    """Each arm's packaged model gives a recording with every signal, in order, one trajectory a reach."""
    log = random_reaches_log(name, 12, seed=1)
    assert len(log.trajectory_ids) == 12
    assert log.signals[:8] == (*CalibrationLog.POSES, *CalibrationLog.JOINTS)
    assert (np.diff(log.time) > 0).all()
    assert same(log, random_reaches_log(name, 12, seed=1))


def test_position_only_leaves_orientations_out():
    log = random_reaches_log("dvrk_psm", 3, position_only=True)
    assert log.tracker_cp.quaternion is None
    assert log.setpoint_cp.quaternion is not None
    full = random_reaches_log("dvrk_psm", 3)
    np.testing.assert_array_equal(log.tracker_cp.position, full.tracker_cp.position)


def test_homing_again_shifts_the_joints():
    """Between two sessions every joint's offset changes by a little, and inside a session it does not."""
    model = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3, 4, 5, 6]})
    log = random_reaches_log(n_trajectories=20, sessions=2, model=model)
    offset = log.measured_jp - log.external_jp
    first, second = (offset[log.session == s] for s in (0, 1))
    assert np.abs(np.ptp(first, axis=0)).max() < 1e-9
    shift = np.abs(second[0] - first[0])
    assert (shift > 0).all()
    assert (shift < 4 * np.array([0.0075, 0.0075, 7e-4, 0.0075, 0.0075, 0.0075])).all()
    assert log.time[log.session == 1].min() > log.time[log.session == 0].max() + 100


def test_payloads_are_taken_in_turn_and_logged():
    log = random_reaches_log(n_trajectories=30, payloads=[0.0, 0.2])
    assert [log.payload[log.trajectory == k][0] for k in (0, 10, 20)] == [0.0, 0.2, 0.0]


def test_reaches_come_back():
    """Some reaches end where the one before them began: reversals of the whole path."""
    log = random_reaches_log(n_trajectories=6, faults=False)
    ends = {k: log.setpoint_cp.position[rows[[0, -1]]] for k, rows in log.trajectories()}
    np.testing.assert_allclose(ends[4][1], ends[3][0], atol=1e-3)


def test_joint_motion_reproduces_what_the_model_has():
    """A model's effect shows in its recording: a wound cable couples joints as its coefficient says."""
    values = {
        "arm": "joints",
        "joints": [1, 2],
        "effects": [{"name": "cable_coupling", "joint": 2, "source": 1, "coefficient": 0.3}],
    }
    log = joint_motion_log(model_from_dict(values), trajectories=3, seconds=4.0)
    np.testing.assert_allclose((log.measured_jp - log.external_jp)[:, 1], 0.3 * log.external_jp[:, 0], atol=1e-12)


def test_joint_motion_has_the_asked_size():
    log = joint_motion_log(preset("raven2_left"), trajectories=4, seconds=3.0, sessions=2)
    assert [len(rows) for _, rows in log.trajectories()] == [300] * 4
    assert np.unique(log.session).tolist() == [0, 1]


@pytest.mark.parametrize(
    "call",
    [
        lambda: random_reaches_log(n_trajectories=2, sessions=3),
        lambda: joint_motion_log(preset("dvrk_psm"), 1, sessions=2),
        lambda: joint_motion_log(preset("dvrk_psm"), 1, seconds=0.01),
    ],
)
def test_impossible_recordings_are_refused(call):
    with pytest.raises(DataError):
        call()


N, RATE = 20000, 100.0
ALL = TrackerFaults(lost_share=0.03, jumps_hz=0.5, outlier_share=0.01, flip_share=0.005, dropout_share=0.01)


def poses(n=N, seed=0):
    rng = np.random.default_rng(seed)
    return se3.pose(se3.matrix_from_rotvec(rng.standard_normal((n, 3))), rng.standard_normal((n, 3)))


def failed(faults, seed=1):
    T = poses()
    bad, code = corrupted(T, RATE, faults, np.random.default_rng(seed))
    shift = np.linalg.norm(bad[:, :3, 3] - T[:, :3, 3], axis=1)
    turn = se3.angle(np.swapaxes(T[:, :3, :3], 1, 2) @ bad[:, :3, :3])
    return T, bad, code, shift, turn


def test_good_samples_are_untouched_and_bad_ones_are_not():
    """The truth column tells exactly which samples were changed."""
    T, bad, code, _, _ = failed(ALL)
    changed = ~(bad == T).all(axis=(1, 2))
    np.testing.assert_array_equal(changed, code != Fault.GOOD)


def test_each_fault_is_as_frequent_as_asked():
    _, _, code, _, _ = failed(ALL)
    fraction = [(code == fault).mean() for fault in (Fault.LOST_FIDUCIAL, Fault.OUTLIER, Fault.FLIP, Fault.DROPOUT)]
    np.testing.assert_allclose(fraction, [0.03, 0.01, 0.005, 0.01], rtol=0.35)
    assert (code == Fault.OCCLUSION_JUMP).mean() == pytest.approx(0.5 * 0.08, rel=0.35)


def test_a_lost_fiducial_is_one_block_of_one_constant_error():
    """The block is unbroken, and its poses are all off by the same distance and turn."""
    _, _, code, shift, turn = failed(ALL)
    rows = np.flatnonzero(code == Fault.LOST_FIDUCIAL)
    assert len(rows) == round(0.03 * N)
    assert np.ptp(rows) == len(rows) - 1
    np.testing.assert_allclose(shift[rows], 0.05)
    np.testing.assert_allclose(turn[rows], 0.7)


def test_jumps_are_steps():
    """Inside an occlusion the error is constant; its size is half to one and a half times the asked one."""
    _, _, code, shift, _ = failed(TrackerFaults(jumps_hz=0.5))
    inside = code == Fault.OCCLUSION_JUMP
    assert ((shift[inside] >= 0.015 - 1e-12) & (shift[inside] <= 0.045 + 1e-12)).all()
    steps = np.abs(np.diff(shift))[inside[1:] & inside[:-1]]
    assert (steps < 1e-12).mean() > 0.9


def test_flips_are_half_turns_in_place():
    _, _, code, shift, turn = failed(TrackerFaults(flip_share=0.01))
    np.testing.assert_allclose(turn[code == Fault.FLIP], np.pi)
    np.testing.assert_allclose(shift[code == Fault.FLIP], 0.0)
