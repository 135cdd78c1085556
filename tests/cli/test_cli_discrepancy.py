"""`gpcorrect discrepancy run | generate | score` through the front door."""

from __future__ import annotations

import io
import json
import re
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import pytest
from command_line import CommandLine, Outcome, assert_refused, exit_status, written

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


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of one blind case, an offset of 20 mrad in joint 2, as `generate` writes it; no test may write to it."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "nominal.toml").write_text(NOMINAL)
    (folder / "spec.toml").write_text(SPEC)
    called("generate", "--spec", folder / "spec.toml", "--output", folder / "blind")
    return folder / "blind"


@pytest.fixture(scope="module")
def solved(made: Path) -> Path:
    """Return what `run` writes of the case; no test may write to it."""
    output = made.parent / "solved"
    called("run", "--model", made / "nominal.toml", "--log", made / "case_000.parquet", "--output", output)
    return output


def called(*words: object) -> None:
    """Call `gpcorrect discrepancy` for a fixture, whose output no test reads."""
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        assert exit_status("discrepancy", *words) == 0


@pytest.fixture
def blind(made: Path, tmp_path: Path) -> Path:
    """Return the test's own copy of the blind case."""
    return Path(copytree(made, tmp_path / "blind"))


@pytest.fixture
def finished(blind: Path, solved: Path) -> Path:
    """Return the same with its finished run."""
    copytree(solved, blind / "runs" / "case_000")
    return blind


def run(gpcorrect: CommandLine, blind: Path, *more: object) -> Outcome:
    log, model = blind / "case_000.parquet", blind / "nominal.toml"
    output = blind / "runs" / "case_000"
    output.parent.mkdir(exist_ok=True)
    return gpcorrect("discrepancy", "run", "--model", model, "--log", log, "--output", output, *more)


def test_the_hidden_effect_is_found_written_and_scored(gpcorrect: CommandLine, finished: Path) -> None:
    """The run writes report, page and model; the score of its report says exact."""
    done = run(gpcorrect, finished, "--json")
    assert done.code == 0
    folder = finished / "runs" / "case_000"
    report = json.loads((folder / "report.json").read_text())
    assert report == done.json
    assert [(e["name"], e["joint"]) for e in report["verdict"]["effects"]] == [("homing_offset", 2)]
    assert report["gap"]["external_jp_2"]["closed"] > 0.95
    assert 'class="verdict"' in (folder / "report.html").read_text()
    assert [e.about.name for e in read_model(folder / "model.toml").effects] == ["homing_offset"]
    scored = gpcorrect(
        "discrepancy",
        "score",
        "--labels",
        finished / "sealed" / "labels.json",
        "--reports",
        finished / "runs",
        "--json",
    ).json
    assert scored["confusion"] == {"homing_offset": scored["confusion"]["homing_offset"] | {"homing_offset": 1}}
    table = gpcorrect(
        "discrepancy", "score", "--labels", finished / "sealed" / "labels.json", "--reports", finished / "runs"
    )
    assert "truth \\ answer" in table.out


WRITTEN = re.compile("<dt>written</dt><dd>[^<]*</dd><dt>command</dt><dd>[^<]*</dd>")


def test_a_finished_run_is_not_made_again(gpcorrect: CommandLine, finished: Path) -> None:
    """The same inputs give the stored report, whose page is written anew, with that date and command."""
    page = finished / "runs" / "case_000" / "report.html"
    before = WRITTEN.split(page.read_text())
    assert len(before) == 2
    page.unlink()
    again = run(gpcorrect, finished)
    assert "already held this run" in again.err
    assert "homing offset" in again.out.splitlines()[0]
    assert WRITTEN.split(page.read_text()) == before


def test_what_reading_left_out_is_said(gpcorrect: CommandLine, blind: Path) -> None:
    """A column that is missing takes its signal out of account: that is printed, not on the page alone."""
    log = read_log(blind / "case_000.parquet")
    path = written(log, blind / "holed.csv")
    lines = [line.split(",") for line in path.read_text().splitlines()]
    gone = lines[0].index('"measured_jf_1"')
    path.write_text("\n".join(",".join(words[:gone] + words[gone + 1 :]) for words in lines))
    output = blind / "out"
    done = gpcorrect("discrepancy", "run", "--model", blind / "nominal.toml", "--log", path, "--output", output)
    assert done.code == 0
    assert "measured_jf is left out: it lacks measured_jf_1" in done.err
    assert "homing offset" in done.out.splitlines()[0]


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
    log = joint_motion_log(true, 9, 5.0, seed=4)
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


def test_the_model_that_is_read_is_not_written_over(gpcorrect: CommandLine, blind: Path, tmp_path: Path) -> None:
    """A completed model takes no place of the nominal one, which the same command would then begin with."""
    nominal = tmp_path / "model.toml"
    nominal.write_bytes((blind / "nominal.toml").read_bytes())
    words = ("--machine", nominal, "--log", blind / "case_000.parquet", "--output", tmp_path)
    assert_refused(gpcorrect("discrepancy", "run", *words), "written over")
    assert nominal.read_bytes() == (blind / "nominal.toml").read_bytes()


def test_help_tells_files_and_resuming(gpcorrect: CommandLine) -> None:
    """The help names the files, the exit status, how a killed run goes on, and an example."""
    said = " ".join(gpcorrect("discrepancy", "run", "--help").out.split())
    for words in ("report.json", "model.toml", "status 0", "killed", "gpcorrect discrepancy run --machine"):
        assert words in said
