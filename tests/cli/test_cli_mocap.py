"""Recordings of a motion capture system through the command line: a file of the cameras beside the robot's log."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from command_line import CommandLine, assert_refused, written
from support import ROOT

from gpcorrect.types import CalibrationLog, PoseSignal

sys.path.append(str(ROOT / "tests" / "logs"))
from mocap_support import Tool, mapping, moving_tool, write_motive


def two_files(tmp_path: Path) -> tuple[Path, Path, Tool]:
    """Write a robot's log without a tracker, and what Motive exports of the same motion from a clock of its own."""
    tool = moving_tool(0, n=2000, hidden=())
    rows = slice(300, 1500, 3)  # a sample in three, from the middle
    time, turned = tool.time[rows], tool.rotation[rows].as_quat(scalar_first=True)
    missed = tool.position + 0.004 * np.sin(20 * tool.position[:, [1, 2, 0]])
    robot = CalibrationLog(
        time - 31.5,
        np.arange(len(time)) // 80,
        np.zeros(len(time)),
        setpoint_cp=PoseSignal(tool.position[rows], turned),
        measured_cp=PoseSignal(tool.position[rows], turned),
    )
    take = write_motive(tmp_path / "Take.csv", replace(tool, position=missed), names=("tool", "base"), rotation="XYZ")
    return written(robot, tmp_path / "robot.csv"), take, tool


def test_a_model_is_learned_from_two_files(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """The dry run finds how the clocks lie, and a fit learns from both."""
    robot, take, _ = two_files(tmp_path)
    words = ("--columns", mapping(tmp_path / "tool.toml", {"body": "tool"}), "--tracker-log", take)
    report = gpcorrect("validate", robot, *words, "--json").json
    assert report["ok"]
    assert any("31.5" in remark and "measured_cp" in remark for remark in report["facts"]["remarks"])
    model, quick = tmp_path / "m.gpc", ("--no-clean", "--marker", "none", "--time-offset", 31.5)
    fit = gpcorrect("fit", robot, *words, *quick, "--output", model, "--json").json
    error = {name: part["position_mm"]["norm"]["rmse"] for name, part in fit["errors"].items()}
    assert error["corrected"] < 0.5 * error["rigid"]
    assert fit["n_train"] + fit["n_test"] >= 390


def test_a_file_of_the_cameras_alone_says_what_is_missing(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Without commands there is nothing to correct; without a name, no body is the tool."""
    _, take, _ = two_files(tmp_path)
    assert_refused(gpcorrect("fit", take, "--output", tmp_path / "m.gpc"), "2 bodies", "body")
    tool = mapping(tmp_path / "tool.toml", {"body": "tool"})
    assert_refused(gpcorrect("fit", take, "--columns", tool, "--output", tmp_path / "m.gpc"), "setpoint_cp")
