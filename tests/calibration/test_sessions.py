"""Sessions of one log whose frame or homing changed between them are named; those of one frame and homing are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_logs import joint_log
from support import short_search, small_log

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model, run_experiment
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

MOVED = np.array([0.006, -0.005, 0.004])  # of the tracker's frame, m


def in_sessions(log: CalibrationLog, moved: FloatArray) -> CalibrationLog:
    """Return a log as two sessions of equally many trajectories, with the tracker moved before the second."""
    assert log.tracker_cp is not None
    session = (log.trajectory >= (log.trajectory.max() + 1) // 2).astype(int)
    position = log.tracker_cp.position + session[:, None] * moved
    return replace(log, session=session, tracker_cp=PoseSignal(position, log.tracker_cp.quaternion))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_frame_that_was_moved_between_sessions_is_said(seed: int) -> None:
    """A tracker moved by 9 mm between two sessions is said by fit and evaluate; a still one is not."""
    still, moved = (in_sessions(small_log(seed), by) for by in (np.zeros(3), MOVED))
    with short_search(80):
        fits = [fit_model(log, FitSettings(inducing=60)) for log in (still, moved)]
    said = [[r for r in (*f.remarks, *evaluate_model(f.corrector, f.log).cautions) if "session 1" in r] for f in fits]
    assert [len(sentences) for sentences in said] == [0, 2]
    assert float(said[1][0].split("lies ")[1].split(" mm")[0]) == pytest.approx(1e3 * np.linalg.norm(MOVED), rel=0.15)
    assert "--hold-out-by session" in said[1][0]


@pytest.mark.parametrize(("method", "seed"), [("linear", 0), ("linear", 1), ("gp", 2)])
def test_joints_that_were_homed_anew_between_sessions_are_said(method: str, seed: int) -> None:
    """Joint 2 is homed anew by 1.7 deg between two sessions: it is named, with its size, and no other is."""
    log = joint_log(seed, 12, 10.0)
    session = log.trajectory // 6
    assert log.external_jp is not None
    homed = log.external_jp + session[:, None] * np.array([0.0, 0.03, 0.0])
    logs = (replace(log, session=session), replace(log, session=session, external_jp=homed))
    with short_search(80):
        fits = [fit_model(log, FitSettings(method=method), task=JointCorrector) for log in logs]
    said = [[remark for remark in fit.remarks if "session 1" in remark] for fit in fits]
    assert [len(sentences) for sentences in said] == [0, 1]
    joint, sentence = said[1][0].split(":", 1)
    assert joint == "joint 2"
    assert float(sentence.split("lies ")[1].split(" deg")[0]) == pytest.approx(np.degrees(0.03), rel=0.15)


@pytest.mark.parametrize(("method", "sessions"), [("linear", 3), ("gp", 3), ("gp", 5)])
def test_intervals_hold_in_a_session_of_its_own(method: str, sessions: int) -> None:
    """Of joints homed anew in each session; 56 and 88 % held where motions were left out and not sessions."""
    held, width = [], []
    for seed in range(4):
        log, rng = joint_log(seed, 4 * (sessions + 1), 6.0), np.random.default_rng(100 + seed)
        session = log.trajectory // 4
        assert log.external_jp is not None
        for homed in (0.03, 0.0):
            moved = rng.normal(0, homed, sessions + 1)[session][:, None] * [0.0, 1.0, 0.0]
            known = replace(log, session=session, external_jp=log.external_jp + moved)
            with short_search(80):
                fit = fit_model(known.select(session < sessions), FitSettings(method=method), task=JointCorrector)
            new = known.select(session == sessions)
            answer = fit.corrector.correct_log(new)
            held.append((np.abs(answer.joints - new.external_jp) <= answer.interval95).mean(axis=0))
            width.append(answer.interval95.mean(axis=0))
            assert any("wide enough for a new one" in r for r in fit.remarks) == (homed > 0)
    assert (np.mean(held, axis=0) > 0.93).all()
    apart, alike = np.mean(width[::2], axis=0), np.mean(width[1::2], axis=0)
    assert (apart / alike)[[0, 2]] == pytest.approx(1.0, abs=0.25)  # other joints pay nothing
    assert apart[1] > 2 * alike[1]


def test_of_two_sessions_or_beside_a_large_one_no_session_is_left_out() -> None:
    """Half of the recording would be: what is said of intervals in a new session stays that they do not hold."""
    log = joint_log(3, 16, 6.0)
    assert log.external_jp is not None
    for session in (log.trajectory // 8, np.maximum(log.trajectory - 9, 0) // 3):
        homed = log.external_jp + (session > 0)[:, None] * np.array([0.0, 0.08, 0.0])
        with short_search(80):
            fit = fit_model(
                replace(log, session=session, external_jp=homed), FitSettings(method="linear"), task=JointCorrector
            )
        (said,) = (remark for remark in fit.remarks if "joint 2: session" in remark)
        assert "do not hold in a new one" in said


def test_sessions_of_one_motion_each_are_not_compared() -> None:
    """Where each session is one motion, how motions of one session differ is not known, and nothing is said."""
    log = small_log(2, trajectories=6)
    with short_search(80):
        result = fit_model(replace(log, session=log.trajectory), FitSettings(inducing=60))
    assert not any("session" in remark for remark in result.remarks)


def test_a_session_that_cleaning_rejects_is_named() -> None:
    """Of two sessions with 8 cm between their frames cleaning rejects the lesser one: it is said which one was lost."""
    log = small_log(3)
    moved = in_sessions(log, np.array([0.06, -0.04, 0.04]))
    moved = moved.select(moved.trajectory < 13)
    with short_search(80):
        result = fit_model(moved, FitSettings(inducing=60))
    assert [r for r in result.remarks if "of session 1 (trajectories 8 to 12;" in r]


def test_a_refusal_of_another_frame_advises_no_model_that_is_not_measured() -> None:
    """Where the held-out session lies in another frame, fitting it apart is advised, not to measure nothing."""
    with short_search(80), pytest.raises(LogError) as refused:
        run_experiment(in_sessions(small_log(3), np.array([0.6, -0.4, 0.4])), FitSettings(inducing=60), holdout=0.5)
    assert "apart" in (refused.value.hint or "")
    assert "--holdout 0" not in (refused.value.hint or "")
