"""`gpcorrect joint` and `gpcorrect zigzag` through the front door."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, assert_refused, exit_status, written
from joint_logs import joint_log
from support import few_trees

from gpcorrect.logs import read_log
from gpcorrect.types import LogMeta


@pytest.fixture(scope="module")
def joints(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording; no test may write to it."""
    return written(joint_log(1, trajectories=6), tmp_path_factory.mktemp("joints") / "joints.csv")


@pytest.fixture(scope="module")
def linear(joints: Path) -> Path:
    """Return its linear model; no test may write to it."""
    model = joints.parent / "linear.gpc"
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        assert exit_status("joint", "fit", joints, "--method", "linear", "--output", model) == 0
    return model


def test_fit_and_evaluate_say_what_other_programs_rely_on(gpcorrect: CommandLine, joints: Path, tmp_path: Path) -> None:
    """The JSON fields are there, in millimetres where the joint slides, and a saved model can be measured again."""
    words = ("joint", "fit", joints, "--method", "linear", "--input", "measured_jp", "--output", tmp_path / "m.gpc")
    result = gpcorrect(*words, "--report", tmp_path / "fit.html", "--json").json
    assert {"n_train", "n_test", "seconds", "errors"} <= set(result)
    assert set(result["errors"]) == {"raw", "fixed_offset", "corrected"}
    row = result["errors"]["corrected"][2]
    assert {"joint", "unit", "rmse", "mean", "sd", "p95", "max"} <= set(row)
    assert [r["unit"] for r in result["errors"]["raw"]] == ["deg", "deg", "mm"]
    page = tmp_path / "again.html"
    again = gpcorrect("joint", "evaluate", tmp_path / "m.gpc", joints, "--report", page, "--json").json
    assert again["errors"]["corrected"][1]["rmse"] < 0.2 * again["errors"]["raw"][1]["rmse"]
    assert "1 whole trajectories" in (tmp_path / "fit.html").read_text()
    assert page.read_text().count("data-key=") == 6
    assert "the model was made from this recording" in page.read_text()


def test_intervals_are_judged_joint_by_joint(gpcorrect: CommandLine, linear: Path, tmp_path: Path) -> None:
    """One joint of three that is missed is named, with the share that its intervals hold, and the others are not."""
    path = written(joint_log(2, trajectories=6, shift=0.05), tmp_path / "moved.csv")
    result = gpcorrect("joint", "evaluate", linear, path)
    held = [int(line.split()[-2]) for line in result.out.splitlines() if "corrected" in line]
    assert f"cover only {held[1]} % of the errors of joint 2: the arm misses" in result.said
    assert held[1] < 60 < 80 < min(held[0], held[2])


def test_commands_are_learned_from_what_the_robot_was_sent(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """What it reports, behind its servo, is learned from where that is asked for, or nothing else is logged."""
    log = joint_log(1, trajectories=6)
    both = written(replace(log, setpoint_jp=np.roll(log.measured_jp, -1, axis=0)), tmp_path / "both.csv")
    words = ("--method", "linear", "--direction", "command", "--output", tmp_path / "m.gpc", "--json")
    result = gpcorrect("joint", "fit", both, *words)
    assert result.json["model"]["input"] == "setpoint_jp"
    assert "commands are learned from setpoint_jp" in result.said
    asked = gpcorrect("joint", "fit", both, "--input", "measured_jp", *words)
    alone = gpcorrect("joint", "fit", written(log, tmp_path / "alone.csv"), *words)
    assert [r.json["model"]["input"] for r in (asked, alone)] == ["measured_jp"] * 2
    assert "commands are learned from measured_jp, for" in alone.said


def test_kinds_of_joints_that_are_taken_are_said(gpcorrect: CommandLine, linear: Path, tmp_path: Path) -> None:
    """Where no sidecar names them; a model of other kinds is refused by their name."""
    bare = written(replace(joint_log(1, trajectories=6), meta=LogMeta()), tmp_path / "bare.csv")
    bare.with_suffix(".toml").write_text('joint_types = ""\n')
    result = gpcorrect("joint", "fit", bare, "--method", "linear", "--output", tmp_path / "m.gpc")
    assert "joint_types are not named: taken that joint 3 slides (m) and the others turn (rad)" in result.said
    turning = written(replace(joint_log(2), meta=LogMeta(joint_types="RRR")), tmp_path / "turning.csv")
    assert_refused(gpcorrect("joint", "evaluate", linear, turning), "joint_types")


def test_commands_for_poses_say_what_to_do_with_a_model_of_joints(
    gpcorrect: CommandLine, joints: Path, linear: Path, tmp_path: Path
) -> None:
    """It is not updated: zeros are set anew, or all is learned anew; Python is told the class."""
    update = gpcorrect("update", linear, joints, "--output", tmp_path / "u.gpc")
    assert_refused(update, "joint rezero", "joint fit", "load(path, gpcorrect.JointCorrector)")


def test_compare_has_a_row_for_every_method(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Raw and every learner, each with every joint."""
    short = written(joint_log(1, trajectories=5, seconds=6.0), tmp_path / "short.csv")
    with few_trees():
        result = gpcorrect("joint", "compare", short, "--json").json
    names = [row["method"] for row in result["methods"]]
    assert names == ["raw", "offset", "linear", "quadratic", "network", "ukf", "gp", "trees", "auto"]
    assert all(len(row["errors"]) == 3 for row in result["methods"])


def test_rezero_writes_a_model_with_the_new_zero(gpcorrect: CommandLine, linear: Path, tmp_path: Path) -> None:
    """A shift of joint 2 is reported, and in the new model."""
    minute = written(joint_log(2, trajectories=2, shift=0.05), tmp_path / "minute.csv")
    zeros = gpcorrect("joint", "rezero", linear, minute, "--output", tmp_path / "n.gpc", "--json").json
    assert zeros["zeros"][1]["shift"] == pytest.approx(2.865, abs=0.5)
    assert zeros["zeros"][1]["moved"]
    history = gpcorrect("info", tmp_path / "n.gpc", "--json").json["history"]
    assert [step["what"] for step in history] == ["fit", "rezero"]
    assert str(minute) in history[1]["command"]


def test_zigzag_writes_a_trajectory_and_its_duration(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """The file reads back as a log of commanded joints inside the limits."""
    path = tmp_path / "traj.csv"
    facts = gpcorrect("zigzag", "--direction", "J2-J3", "--sparsity", 4, "--output", path, "--json").json
    log = read_log(path)
    assert log.setpoint_jp is not None
    assert facts["seconds"] == pytest.approx(log.time[-1] - log.time[0], abs=0.04)


def test_bad_requests_end_with_status_2(gpcorrect: CommandLine, joints: Path, linear: Path, tmp_path: Path) -> None:
    """Unknown method, direction, feature or limits: one message each."""
    out = ("--output", tmp_path / "x.gpc")
    assert_refused(gpcorrect("joint", "fit", joints, "--method", "magic", *out), "magic", "quadratic")
    assert_refused(gpcorrect("joint", "fit", joints, "--features", "colour", *out), "colour")
    assert_refused(gpcorrect("joint", "fit", joints, "--input", "tracker", *out), "measured_jp")
    assert_refused(gpcorrect("joint", "fit", joints, "--method", "network", "--layers", "wide", *out), "600,500,400")
    assert_refused(gpcorrect("joint", "fit", joints, "--layers", "50", *out), "network", "gp")
    assert_refused(gpcorrect("joint", "fit", joints, "--features", ",", *out), "--features names nothing")
    words = ("joint", "rezero", linear, joints, "--time-offset", "soon")
    assert_refused(gpcorrect(*words, *out), "soon")
    assert_refused(gpcorrect("zigzag", "--limits", "60:20,55:110,330:420", "--output", tmp_path / "z.csv"), "lowest")


def test_bad_recordings_are_refused_by_name(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Missing efforts, a still arm, millimetres, limits exceeded, mixed sessions: status 2 and what to do."""
    log = joint_log(1, trajectories=6)
    q, truth = np.array(log.measured_jp), np.array(log.external_jp)
    still, up = np.ones(q.shape), np.array([0.0, 1.2, 0.0])
    arm = LogMeta(joint_types="RRP", robot="raven2", arm="raven2_left")
    cases = {
        "measured_jf": (replace(log, measured_jf=None), "--features", "position,effort"),
        "no joint ever moves": (replace(log, measured_jp=still),),
        "looks like millimetres": (replace(log, measured_jp=q * [1, 1, 1e3], external_jp=truth * [1, 1, 1e3]),),
        "the limits of raven2": (replace(log, measured_jp=q + up, external_jp=truth + up, meta=arm),),
        "trajectory 2 runs through sessions 0, 1": (replace(log, session=np.arange(len(log)) > len(log) // 2.3),),
    }
    for number, (words, (bad, *options)) in enumerate(cases.items()):
        path = written(bad, tmp_path / f"{number}.csv")
        outcome = gpcorrect("joint", "fit", path, "--method", "linear", "--output", tmp_path / "m.gpc", *options)
        assert_refused(outcome, words, "try:")
    assert_refused(gpcorrect("zigzag", "--limits", "20:60,55:110,330:600", "--output", tmp_path / "z.csv"), "joint 3")
    assert (
        gpcorrect(
            "zigzag", "--limits", "20:60,55:110,330:600", "--machine", "none", "--output", tmp_path / "z.csv"
        ).code
        == 0
    )


def test_a_homing_is_noticed_and_mixed_ones_set_no_zero(
    gpcorrect: CommandLine, joints: Path, linear: Path, tmp_path: Path
) -> None:
    """Evaluation names the session and the joint that moved; a zero is taken from one session only."""
    after = written(joint_log(2, trajectories=2, shift=0.05), tmp_path / "after.csv")
    outcome = gpcorrect("joint", "evaluate", linear, joints, after, "--json")
    moved = {(row["session"], row["joint"]) for row in outcome.json["zeros"] if row["moved"]}
    assert moved == {(1, 2)}
    assert "session 1: the zero of joint 2" in outcome.said
    both = gpcorrect("joint", "rezero", linear, joints, after, "--output", tmp_path / "n.gpc")
    assert_refused(both, "2 sessions")


def test_drift_watches_joint_models_too(gpcorrect: CommandLine, linear: Path, tmp_path: Path) -> None:
    """A day like the training raises no alarm, one whose zero has moved does."""
    same = written(joint_log(5, trajectories=6), tmp_path / "same.csv")
    other = written(joint_log(6, trajectories=6, shift=0.05), tmp_path / "other.csv")
    watch = ("drift", linear, same, other, "--false-alarms", 20, "--report", tmp_path / "d.html", "--json")
    outcome = gpcorrect(*watch)
    assert outcome.code == 0, outcome.err
    assert outcome.json["alarm_log"] == str(other)
    assert gpcorrect("drift", linear, same, "--json").json["alarm"] is False
