"""`gpcorrect discrepancy run | generate | score` through the front door."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from cli_support import CommandLine, Outcome, assert_refused, written

from gpcorrect.logs import read_log
from gpcorrect.sim import effect_from_dict, read_model
from gpcorrect.sim.joint_motion import joint_motion_log

NOMINAL = """
arm = "joints"
joints = [1, 2]
joint_types = "RR"
log_rate_hz = 20.0

[noise]
external_jp_white = [1e-3, 1e-3]
external_jp_ar_std = [5e-4, 5e-4]
"""
SPEC = """
model = "nominal.toml"
seed = 11

[motion]
trajectories = 15
seconds = 6.0

[[cases]]
[[cases.effects]]
name = "homing_offset"
joint = 2
offset = 0.02
"""


@pytest.fixture
def blind(gpcorrect: CommandLine, tmp_path: Path) -> Path:
    """Folder of one blind case: an offset of 20 mrad in joint 2."""
    (tmp_path / "nominal.toml").write_text(NOMINAL)
    (tmp_path / "spec.toml").write_text(SPEC)
    done = gpcorrect(
        "discrepancy", "generate", "--spec", tmp_path / "spec.toml", "--output", tmp_path / "blind", "--json"
    )
    assert done.json["cases"] == ["case_000"]
    return tmp_path / "blind"


def run(gpcorrect: CommandLine, blind: Path, *more: object) -> Outcome:
    log, model = blind / "case_000.parquet", blind / "nominal.toml"
    output = blind / "runs" / "case_000"
    output.parent.mkdir(exist_ok=True)
    return gpcorrect("discrepancy", "run", "--model", model, "--log", log, "--output", output, *more)


def test_the_hidden_effect_is_found_written_and_scored(gpcorrect: CommandLine, blind: Path) -> None:
    """The run writes report, page and model; the score of its report says exact; its model leaves nothing."""
    done = run(gpcorrect, blind, "--json")
    assert done.code == 0
    folder = blind / "runs" / "case_000"
    report = json.loads((folder / "report.json").read_text())
    assert report == done.json
    assert [(e["name"], e["joint"]) for e in report["verdict"]["effects"]] == [("homing_offset", 2)]
    assert report["gap"]["external_jp_2"]["closed"] > 0.95
    assert 'class="verdict"' in (folder / "report.html").read_text()
    assert [e.about.name for e in read_model(folder / "model.toml").effects] == ["homing_offset"]
    scored = gpcorrect(
        "discrepancy", "score", "--labels", blind / "sealed" / "labels.json", "--reports", blind / "runs", "--json"
    ).json
    assert scored["confusion"] == {"homing_offset": scored["confusion"]["homing_offset"] | {"homing_offset": 1}}
    table = gpcorrect("discrepancy", "score", "--labels", blind / "sealed" / "labels.json", "--reports", blind / "runs")
    assert "truth \\ answer" in table.out
    log = blind / "case_000.parquet"
    words = ("--model", folder / "model.toml", "--log", log, "--output", blind / "again", "--json")
    assert gpcorrect("discrepancy", "run", *words).json["verdict"]["effects"] == []


def test_a_finished_run_is_not_made_again(gpcorrect: CommandLine, blind: Path) -> None:
    """The same inputs give the stored report, whose page is written anew."""
    first = run(gpcorrect, blind)
    assert "homing offset" in first.out.splitlines()[0]
    page = blind / "runs" / "case_000" / "report.html"
    before = page.read_text()
    page.unlink()
    again = run(gpcorrect, blind)
    assert "already held this run" in again.err
    assert again.out.splitlines()[0] == first.out.splitlines()[0]
    assert page.read_text() == before


def test_a_killed_run_goes_on_after_its_search(gpcorrect: CommandLine, blind: Path) -> None:
    """With the search stored and the result gone, the run ends in the same verdict."""
    first = run(gpcorrect, blind, "--json").json
    stages = blind / "runs" / "case_000" / "stages"
    assert (stages / "search.json").is_file()
    (stages / "result.json").unlink()
    second = run(gpcorrect, blind, "--json")
    assert "already held" not in second.err
    assert second.json["verdict"] == first["verdict"]


TRACKED = """
arm = "raven2_left"
joints = [1, 2, 3]
log_rate_hz = 20.0

[controller]
kp = [900.0, 800.0, 260000.0]
kd = [31.0, 26.0, 8300.0]
feedforward = "rigid-body"

[noise]
tracker_white = 1.5e-4
"""


@pytest.mark.slow
@pytest.mark.parametrize("commands", ["setpoint_cp", "setpoint_jp"])
def test_a_tracker_and_commands_are_enough(gpcorrect: CommandLine, tmp_path: Path, commands: str) -> None:
    """With tracked poses and commands alone, poses or joints, a hidden offset is named, its registration estimated."""
    model = tmp_path / "nominal.toml"
    model.write_text(TRACKED)
    true = read_model(model).with_effects(effect_from_dict({"name": "transmission_ratio", "joint": 3, "error": 0.02}))
    log = joint_motion_log(true, 12, 6.0, seed=4)
    kept = {"time", "trajectory", "session", "tracker_cp", commands}
    gone = {name: None for name in log.signals if name not in kept}
    path = written(replace(log, **gone), tmp_path / "tracked.parquet")
    done = gpcorrect("discrepancy", "run", "--model", model, "--log", path, "--output", tmp_path / "out", "--json")
    assert done.code == 0
    assert [(e["name"], e["joint"]) for e in done.json["verdict"]["effects"]] == [("transmission_ratio", 3)]
    low, high = done.json["verdict"]["effects"][0]["parameters"]["error"]["ci95"]
    assert low < 0.02 < high
    remarks = " ".join(done.json["provenance"]["remarks"])
    assert "the motors were not measured: they are those of the simulated servo loop" in remarks
    assert ("inverse kinematics" in remarks) == (commands == "setpoint_cp")
    assert {"effect": "encoder_quantisation", "why": "the log lacks measured_jp"} in done.json["provenance"][
        "not_nameable"
    ]


def test_unknown_keys_of_the_model_are_named(gpcorrect: CommandLine, blind: Path) -> None:
    """A misspelt key is an error that says which."""
    (blind / "nominal.toml").write_text(NOMINAL.replace("log_rate_hz", "lograte"))
    assert_refused(run(gpcorrect, blind), "lograte")


def test_logs_that_cannot_be_used_are_refused(gpcorrect: CommandLine, blind: Path, tmp_path: Path) -> None:
    """No outside signal, joints that the log lacks, too few motions: one message each, and nothing is written."""
    log = read_log(blind / "case_000.parquet")
    model = blind / "nominal.toml"

    def refused(path: Path, *words: str) -> None:
        done = gpcorrect("discrepancy", "run", "--model", model, "--log", path, "--output", tmp_path / "out")
        assert_refused(done, *words)
        assert not (tmp_path / "out" / "report.json").exists()

    refused(written(replace(log, external_jp=None), tmp_path / "inside.parquet"), "external_jp")
    refused(written(log.select(log.time < log.time[0] + 0.1), tmp_path / "short.parquet"), "split")
    refused(tmp_path / "absent.csv", "absent.csv")
    three = NOMINAL.split("[noise]")[0].replace("joints = [1, 2]", "joints = [1, 2, 3]").replace('"RR"', '"RRR"')
    model.write_text(three)
    refused(blind / "case_000.parquet", "joints", "2 columns")


def test_a_folder_that_cannot_be_made_is_refused_before_the_work(gpcorrect: CommandLine, blind: Path) -> None:
    """A folder that cannot be made is named at once."""
    log = blind / "case_000.parquet"
    words = ("--model", blind / "nominal.toml", "--log", log, "--output", log / "out")
    assert_refused(gpcorrect("discrepancy", "run", *words), "cannot make the folder")


def test_help_tells_files_and_resuming(gpcorrect: CommandLine) -> None:
    """The help names the files, the exit status, how a killed run goes on, and an example."""
    said = " ".join(gpcorrect("discrepancy", "run", "--help").out.split())
    for words in ("report.json", "model.toml", "status 0", "killed", "gpcorrect discrepancy run --model"):
        assert words in said
