"""Logs whose commands hardly turn the tool: orientations are registered, not corrected, and the model says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import short_search, small_log

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, FitSettings, evaluate_model, fit_model, load, reached, save
from gpcorrect.calibration.update import update_model
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

MISS = np.deg2rad([2.0, 1.0, 1.5])  # by which the robot misses the orientation, about each axis
HELD = se3.matrix_from_rotvec(np.array([0.4, -0.2, 0.9]))  # as commanded
MOUNTED = se3.matrix_from_rotvec(np.array([0.1, 1.1, -0.3]))  # of the marker on the tool


def held_log(seed: int = 0, spread: float = 0.0) -> CalibrationLog:
    """Return the small recording with the tool commanded in one orientation (or `spread` rad about it), and missed."""
    log, rng = small_log(seed), np.random.default_rng(100 + seed)
    n, phase = len(log), rng.uniform(0, 2 * np.pi, (len(log.trajectory_ids), 3))
    swing = np.sin(3 * (log.time % 10.0)[:, None] + phase[log.trajectory])  # another way in each motion
    commanded = se3.matrix_from_rotvec(spread * rng.standard_normal((n, 3))) @ HELD
    seen = se3.matrix_from_rotvec(MISS * swing) @ commanded @ MOUNTED
    return replace(
        log,
        setpoint_cp=PoseSignal(log.setpoint_cp.position, se3.quaternion_from_matrix(commanded)),
        tracker_cp=PoseSignal(log.tracker_cp.position, se3.quaternion_from_matrix(seen)),
    )


@pytest.fixture(scope="module")
def corrector() -> CommandCorrector:
    with short_search(80):
        found: CommandCorrector = fit_model(held_log()).corrector
    return found


def asked(tilt: FloatArray) -> FloatArray:
    """Return a pose in the middle of the training whose marker is tilted in the base by rotation vectors `(n, 3)`."""
    turned = se3.matrix_from_rotvec(np.atleast_2d(tilt)) @ HELD @ MOUNTED
    return np.hstack([np.tile([0.11, -0.005, -0.098], (len(turned), 1)), se3.quaternion_from_matrix(turned)])


def test_a_tilt_that_is_asked_for_is_commanded(corrector: CommandCorrector) -> None:
    """The command turns by what the desired pose turns by: nothing of it is taken for a miss to be undone."""
    tilts = np.deg2rad([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, -2]])
    answers = [corrector.correct(pose, np.zeros(6)) for pose in asked(tilts)]
    R = se3.matrix_from_quaternion(np.array([a.quaternion for a in answers]))
    turned = se3.rotvec_from_matrix(R @ R[0].T)
    # frames are registered by positions, that the arm bends: they turn the axis by some hundredths
    np.testing.assert_allclose(turned, tilts, atol=np.deg2rad(0.2))
    np.testing.assert_allclose([a.position for a in answers], [answers[0].position] * len(answers), atol=1e-12)


def test_intervals_hold_what_the_robot_misses_on_other_motions(corrector: CommandCorrector) -> None:
    """Intervals of rotations hold other motions' misses, and are no narrower than most of those of the training."""
    measured = evaluate_model(corrector, held_log(seed=1)).clean
    assert (measured.coverage95 > 0.85).all()
    assert (measured.interval95[:, 3:] > 0.7 * MISS).all()
    np.testing.assert_allclose(measured.corrected[:, 3:], measured.registered[:, 3:], atol=1e-9)
    assert measured.in_domain.mean() > 0.9


def test_single_poses_paths_and_streams_agree(corrector: CommandCorrector) -> None:
    """Deviations, intervals and flags of a pose, of a path of it and of the poses that commands reach are the same."""
    poses = asked(np.deg2rad([[1.0, 0, 0], [0, 30, 0]]))
    for pose, inside in zip(poses, (True, False), strict=True):
        one, path, stream = corrector.correct(pose), corrector.correct_path([pose], [0.0]), corrector.stream()
        streamed = stream.correct(0.0, pose)
        back = reached(corrector, [[*one.position, *one.quaternion]])  # type: ignore[misc]
        for other in (path[0], streamed):
            np.testing.assert_allclose(other.interval95, one.interval95, rtol=1e-6)
            assert bool(other.in_domain) == inside == bool(one.in_domain)
        assert bool(back.in_domain[0]) == inside
        np.testing.assert_allclose(back.quaternion[0], pose[3:], atol=1e-9)  # type: ignore[index]
        np.testing.assert_allclose(
            np.linalg.norm(back.interval95[0, 3:]), np.linalg.norm(one.interval95[3:]), rtol=1e-9
        )


def test_a_turn_widens_the_interval_of_positions(corrector: CommandCorrector) -> None:
    """The lever arm of the marker cannot be observed, so that positions of a turned tool are less sure."""
    straight, turned = (corrector.correct(pose, np.zeros(6)) for pose in asked(np.deg2rad([[0.0, 0, 0], [2, 0, 0]])))
    assert (turned.interval95[:3] > straight.interval95[:3]).all()


def test_the_model_says_that_rotations_are_not_corrected(corrector: CommandCorrector, tmp_path: Path) -> None:
    """Fit, evaluation and file say it in a sentence; the file answers as what was saved."""
    save(corrector, tmp_path / "m.gpc")
    again = load(tmp_path / "m.gpc")
    said = [*corrector.summary["remarks"], *evaluate_model(again, held_log(seed=1)).cautions]
    assert sum("rotations are not corrected" in sentence for sentence in said) == 2
    assert not any("does not lessen the rotation" in sentence for sentence in said)
    first, second = (model.correct(asked(np.zeros(3))[0]) for model in (corrector, again))
    np.testing.assert_array_equal(first.interval95, second.interval95)


def test_an_update_never_narrows_what_rotations_miss(corrector: CommandCorrector) -> None:
    """After a recording that misses less the interval of rotations stays; after one that misses more it is wider."""
    calm, wild = held_log(seed=2), held_log(seed=2)
    R = se3.matrix_from_quaternion(wild.tracker_cp.quaternion)  # type: ignore[union-attr, arg-type]
    miss = se3.rotvec_from_matrix(R @ (HELD @ MOUNTED).T)
    for log, factor in ((calm, 0.5), (wild, 1.5)):
        seen = se3.quaternion_from_matrix(se3.matrix_from_rotvec(factor * miss) @ HELD @ MOUNTED)
        log = replace(log, tracker_cp=PoseSignal(log.tracker_cp.position, seen))  # type: ignore[union-attr]
        changed = update_model(corrector, log).corrector
        assert isinstance(changed, CommandCorrector)
        assert changed.held is not None
        assert corrector.held is not None
        wider = changed.held.interval95 > 1.2 * corrector.held.interval95
        assert wider.all() if factor > 1 else not wider.any()


def test_commands_that_turn_more_than_is_missed_are_learned_from() -> None:
    """Of a log whose commands vary three times as much as the robot misses, rotations are corrected as ever."""
    with short_search(80):
        found: CommandCorrector = fit_model(held_log(spread=0.1)).corrector
    assert found.has_orientation
    assert found.held is None


@pytest.mark.parametrize("features", [("pose", "velocity", "memory"), ("euler",)])
def test_other_features_hold_the_orientation_too(features: tuple[str, ...]) -> None:
    """Memory is of positions then, and single poses, paths and evaluation are answered."""
    with short_search(80):
        found: CommandCorrector = fit_model(held_log(), FitSettings(features=features)).corrector
    assert found.held is not None
    path = found.correct_path(asked(np.deg2rad([[0.0, 0, 0], [1, 0, 0]])), [0.0, 0.02])
    assert np.isfinite(path.interval95).all()
    assert evaluate_model(found, held_log(seed=1)).clean.coverage95.min() > 0.8


def test_joints_are_refused_where_the_orientation_is_held() -> None:
    """Joints follow from whole poses, so that learning them would undo asked turns as well."""
    log = held_log()
    q = np.hstack([log.setpoint_cp.position, np.sin(log.time)[:, None]])  # type: ignore[union-attr]
    with pytest.raises((LogError, ValueError)):
        fit_model(replace(log, setpoint_jp=q), FitSettings(features=("pose", "joints")))
