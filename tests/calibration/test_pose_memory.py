"""Laws of memory features: they find a planted hysteresis, and what has no history says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import small_log

from gpcorrect import se3
from gpcorrect.calibration import (
    CommandCorrector,
    FitResult,
    FitSettings,
    cartesian,
    evaluate_model,
    fit_model,
    load,
    save,
)
from gpcorrect.calibration.memory import choose_memory
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError
from gpcorrect.play import play_states
from gpcorrect.sim.effects.operators import play
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal
from gpcorrect.velocity import twists

RADIUS = 0.006  # m, of the planted slack
SETTINGS = FitSettings(
    features=("pose", "velocity", "memory"), inducing=150, search_samples=150, marker="none", clean=False
)


def sticky_log(seed: int) -> CalibrationLog:
    """Return the small recording's positions with a slack of 6 mm a direction that shifts commands by up to 3 mm.

    Motions are half a minute apart, and each begins in the middle of the slack.
    """
    log = small_log(seed, trajectories=20)
    lag = np.concatenate(
        [log.tracker_cp.position[rows] - play(log.tracker_cp.position[rows], RADIUS) for _, rows in log.trajectories()]
    )
    seen, asked = PoseSignal(log.tracker_cp.position), PoseSignal(log.setpoint_cp.position + 0.5 * lag)
    return replace(log, tracker_cp=seen, setpoint_cp=asked, time=log.time + 30.0 * log.trajectory)


@pytest.fixture(scope="module")
def sticky() -> FitResult:
    return fit_model(sticky_log(0), SETTINGS)


def test_a_network_may_remember() -> None:
    """It tells of one part of its samples only, which left nothing to choose the slack's width on."""
    assert fit_model(sticky_log(0), replace(SETTINGS, method="network", epochs=5)).corrector.memory is not None


def rmse(corrector: CommandCorrector, log: CalibrationLog) -> float:
    return float(evaluate_model(corrector, log).dirty_errors["corrected"]["position_mm"]["norm"]["rmse"])


def test_a_planted_slack_is_found(sticky: FitResult) -> None:
    """On other trajectories memory takes away a quarter of what pose and velocity leave, and the fit says so."""
    with_memory, without = (
        rmse(sticky.corrector, sticky_log(1)),
        rmse(replace(sticky.corrector, memory=None), sticky_log(1)),
    )
    assert with_memory < 0.75 * without
    (said,) = [remark for remark in sticky.remarks if "memory" in remark]
    assert "asked for" not in said


def test_where_nothing_sticks_memory_is_called_useless() -> None:
    """On a recording without hysteresis the fit says that it would not be used unasked."""
    remarks = fit_model(small_log(trajectories=6, samples=40), SETTINGS).remarks
    assert any("used because it was asked for" in remark for remark in remarks)


def test_memory_is_learned_unasked_where_much_sticks(sticky: FitResult) -> None:
    """What comes of it is what asking for it brings; where nothing sticks it is not even tried."""
    plain = replace(SETTINGS, features=())
    unasked, bare = (fit_model(log, plain) for log in (sticky_log(0), small_log(0, trajectories=20)))
    asked = {f.corrector.memory.law.intervals.factor.tobytes() for f in (sticky, unasked) if f.corrector.memory}
    assert len(asked) == 1
    assert bare.corrector.memory is None
    assert not any("memory" in remark for remark in bare.remarks)


def test_memory_that_takes_little_away_is_not_used_unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried where a linear law sees much of it, and the fit says by how little it helped."""
    monkeypatch.setattr(cartesian, "LIMITS", replace(LIMITS, memory_lessens=0.99))
    fit = fit_model(sticky_log(0), replace(SETTINGS, features=()))
    assert fit.corrector.memory is None
    assert any(r.startswith("memory acts") and r.endswith("; not used") for r in fit.remarks)


def test_without_history_the_answer_is_that_of_pose_and_velocity_and_says_so(sticky: FitResult) -> None:
    """A single query equals that of the model without memory, in words too; its interval is wider than with history."""
    poses, times, twist = a_path()
    alone = replace(sticky.corrector, memory=None)
    path = sticky.corrector.correct_path(poses, times)
    for row in (20, 35, 50):
        one, plain = sticky.corrector.correct(poses[row], twist[row]), alone.correct(poses[row], twist[row])
        np.testing.assert_array_equal(one.position, plain.position)
        np.testing.assert_array_equal(one.interval95, plain.interval95)
        assert "no history" in one.reason
        assert "no history" not in plain.reason
        assert path.reason[row] == ""
        assert (one.interval95[:3] > 1.3 * path.interval95[row, :3]).all()


def test_a_stream_is_the_path_that_it_follows(sticky: FitResult) -> None:
    """Pose by pose with the path's velocities a stream answers what correct_path answers, also after a reset."""
    poses, times, twist = a_path()
    path, stream = sticky.corrector.correct_path(poses, times), sticky.corrector.stream()
    for _ in range(2):
        stream.reset()
        for row in range(len(poses)):
            one = stream.correct(times[row], poses[row], twist[row])
            np.testing.assert_allclose(one.position, path.position[row], rtol=0, atol=1e-10)
            np.testing.assert_allclose(one.quaternion, path.quaternion[row], rtol=0, atol=1e-10)  # type: ignore[index]
            np.testing.assert_allclose(one.interval95, path.interval95[row], rtol=0, atol=1e-10)


def test_a_stream_estimates_its_velocity(small_corrector: CommandCorrector) -> None:
    """Without twists a stream of straight steady motion answers as with them, but for its first pose, which says so."""
    times = np.arange(20) * 0.02
    velocity = np.array([0.03, -0.02, 0.01, 0.0, 0.0, 0.0])
    stream = small_corrector.stream()
    answers = [stream.correct(t, np.concatenate([[0.1, 0.0, -0.1] + velocity[:3] * t, [1.0, 0, 0, 0]])) for t in times]
    last = small_corrector.correct(
        np.concatenate([[0.1, 0.0, -0.1] + velocity[:3] * times[-1], [1.0, 0, 0, 0]]), velocity
    )
    np.testing.assert_allclose(answers[-1].position, last.position, rtol=0, atol=1e-9)
    assert "at rest" in answers[0].reason
    assert answers[1].reason == ""


def test_memory_is_of_the_commands_before(sticky: FitResult) -> None:
    """Features of a sample change with earlier commands and with its own reference, not with its own command."""
    assert sticky.corrector.memory is not None
    memory, rng = sticky.corrector.memory.states, np.random.default_rng(5)
    reference, command = (PoseSignal(np.cumsum(rng.normal(0, 2e-3, (30, 3)), axis=0)) for _ in range(2))
    labels = np.zeros(30, dtype=int)
    before = memory.transform(command, reference, labels)
    for changed, row in ((command, 29), (command, 28), (reference, 29)):
        moved = np.array(changed.position)
        moved[row] += 1e-3
        pair = (PoseSignal(moved), reference) if changed is command else (command, PoseSignal(moved))
        same = np.array_equal(memory.transform(*pair, labels)[29], before[29])
        assert same == (changed is command and row == 29)


def test_a_new_path_starts_amid_the_slack(sticky: FitResult) -> None:
    """The first sample of a path knows nothing, and what follows is as if nothing had gone before."""
    assert sticky.corrector.memory is not None
    memory = sticky.corrector.memory.states
    path = PoseSignal(np.cumsum(np.random.default_rng(6).normal(0, 2e-3, (40, 3)), axis=0))
    both = memory.transform(path, path, np.repeat([0, 1], 20))
    alone = memory.transform(path[20:], path[20:], np.zeros(20, dtype=int))
    np.testing.assert_array_equal(both[20], 0.0)
    np.testing.assert_allclose(both[20:], alone, atol=1e-12)


def test_a_model_file_keeps_the_memory(sticky: FitResult, tmp_path: Path) -> None:
    """Saved and loaded, paths are answered to the last bit as before."""
    poses, times, _ = a_path()
    save(sticky.corrector, tmp_path / "m.gpc")
    again = load(tmp_path / "m.gpc").correct_path(poses, times)
    np.testing.assert_array_equal(again.position, sticky.corrector.correct_path(poses, times).position)


def a_path() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return poses, times and the stencil's velocities of one observed trajectory."""
    log = small_log(3)
    rows = np.arange(60)
    assert log.tracker_cp.quaternion is not None
    poses, times = np.hstack([log.tracker_cp.position, log.tracker_cp.quaternion])[rows], log.time[rows]
    velocity = twists(times, poses[:, :3], se3.matrix_from_quaternion(poses[:, 3:]), np.zeros(60, dtype=int))
    return poses, times, velocity


def test_a_refused_pose_leaves_no_trace_in_a_stream(sticky: FitResult, small_corrector: CommandCorrector) -> None:
    """Fifty metres off, or at a time that stands still: what comes next is answered as if it had not been asked."""
    for corrector in (sticky.corrector, small_corrector):
        one, other = corrector.stream(), corrector.stream()
        for i in range(12):
            pose = [0.1 + 0.002 * i, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0]
            with pytest.raises(DataError, match="so far off"):
                one.correct(0.02 * i, [50.0, *pose[1:]])
            answers = [stream.correct(0.02 * i + 0.01, pose) for stream in (one, other)]
            np.testing.assert_array_equal(answers[0].position, answers[1].position)
            assert answers[0].reasons == answers[1].reasons
            with pytest.raises(DataError, match="advance"):
                one.correct(0.02 * i + 0.01, [0.0, *pose[1:]])


def test_memory_is_judged_beside_the_velocity_that_says_part_of_it() -> None:
    """A slack that a velocity tells all but its reversals of is explained by memory; an effect of velocity is not."""
    rng, t = np.random.default_rng(3), np.arange(2000) / 50.0
    path = np.stack([0.05 * np.sin(rate * t) for rate in (0.9, 1.3, 1.7)], axis=1)
    signal, labels, folds = PoseSignal(path), np.zeros(2000, dtype=np.int64), np.arange(2000) // 500
    velocity = np.tanh(np.gradient(path, axis=0) * 2000.0)
    planted = play_states(np.diff(path, axis=0, prepend=path[:1]), np.full((1, 3), 0.002), labels)[:, 0]
    noise = 1e-4 * rng.normal(size=path.shape)
    of_slack = choose_memory(signal, signal, labels, velocity, planted + noise, folds)[1]
    of_velocity = choose_memory(signal, signal, labels, velocity, 0.002 * velocity + noise, folds)[1]
    assert of_slack > 0.5
    assert of_velocity < 0.05
