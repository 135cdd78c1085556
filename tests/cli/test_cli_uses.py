"""The dry run and the commands agree: what validate says can be used is taken, and what would be refused is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, assert_refused, written
from support import small_log

from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog, PoseSignal


def on_a_line(log: CalibrationLog) -> CalibrationLog:
    """Return the log with all positions on a line, and no orientations."""
    line = np.outer(np.sin(np.linspace(0, 40, len(log))), [0.1, 0.2, 0.2])
    return replace(log, setpoint_cp=PoseSignal(line), tracker_cp=PoseSignal(line + 0.01))


@pytest.mark.parametrize(
    "spoil",
    [
        on_a_line,
        lambda log: log.select(slice(0, 1)),
        lambda log: log.select(slice(0, 2)),
        lambda log: log.select(slice(0, 19)),
        lambda log: log.select(np.arange(len(log)) % 60 < 1),
        lambda log: replace(log, tracker_cp=None),
        lambda log: replace(log, setpoint_cp=None),
    ],
    ids=["line", "one sample", "two samples", "too few", "a sample a trajectory", "no tracker", "no command"],
)
def test_what_fit_refuses_the_dry_run_refuses_too(
    gpcorrect: CommandLine, tmp_path: Path, spoil: Callable[[CalibrationLog], CalibrationLog]
) -> None:
    """Exit status 2 of both, and the dry run names what fit says."""
    path = written(spoil(small_log()), tmp_path / "spoilt.csv")
    refused = gpcorrect("fit", path, "--output", tmp_path / "m.gpc", "--holdout", 0)
    assert_refused(refused)
    dry = gpcorrect("validate", path, "--json")
    assert dry.code == 2
    assert dry.json["uses"] == {} or dry.json["uses"]["fit"] is not True
    assert not dry.json["ok"]


def test_a_good_recording_says_for_what(gpcorrect: CommandLine, log_file: Path) -> None:
    """The verdict names the commands that take it, and why others do not."""
    dry = gpcorrect("validate", log_file)
    assert dry.code == 0
    assert "can be used for fit (0 errors" in dry.out
    assert "not for  joint fit: joint calibration needs setpoint_jp" in dry.out


def test_a_trackers_own_file_passes_for_its_purpose(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Judged by all commands it is unusable, and the hint says how to judge it; for the tracker it is fine."""
    path = written(replace(small_log(), setpoint_cp=None), tmp_path / "take.csv")
    dry = gpcorrect("validate", path)
    assert dry.code == 2
    assert "--for tracker" in dry.out
    fit = gpcorrect("validate", path, "--for", "tracker", "--json")
    assert fit.code == 0
    assert not {"unusable", "no_command"} & {f["code"] for f in fit.json["findings"]}
    assert gpcorrect("validate", path, "--for", "fit").code == 2


def test_each_purpose_judges_its_own_signals(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """A tracker in millimetres spoils a fit, not a joint calibration; without external_jp there is none of those."""
    q = np.random.default_rng(0).normal(size=(960, 2)).cumsum(axis=0) / 50
    log = small_log()
    wrong = replace(log, tracker_cp=PoseSignal(1e3 * log.tracker_cp.position), measured_jp=q, external_jp=1.01 * q)
    path = written(replace(wrong, time=np.arange(960) / 50), tmp_path / "both.csv")
    codes = {purpose: gpcorrect("validate", path, "--for", purpose).code for purpose in ("fit", "joint", "tracker")}
    assert codes == {"fit": 2, "joint": 0, "tracker": 2}
    assert_refused(gpcorrect("validate", path, "--for", "lunch"), "--for is fit, joint, tracker or discrepancy")


def test_the_proposed_mapping_is_one_that_reads(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """What `topics` writes is what it prints, and the recording is read with it; nothing is overwritten."""
    rows = "".join(f"{t},{x},{2 * x},{3 * x}\n" for t, x in enumerate((0.1, 0.2, 0.4)))
    (tmp_path / "run.csv").write_text("stamp,ndi x,ndi y,ndi z\n" + rows)
    mapping = tmp_path / "map.toml"
    shown = gpcorrect("topics", tmp_path / "run.csv", "--output", mapping)
    assert shown.code == 0
    assert mapping.read_text() in shown.out
    assert all(name in shown.out for name in ("stamp", "ndi x", "ndi y", "ndi z"))
    np.testing.assert_allclose(
        read_log(tmp_path / "run.csv", columns=mapping).tracker_cp.position[:, 2], [0.3, 0.6, 1.2]
    )
    assert_refused(gpcorrect("topics", tmp_path / "run.csv", "--output", mapping), "not overwritten")


def test_converting_gives_the_same_recording(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """A native log reads back as it was read, extra columns too; nothing is overwritten."""
    text = "# a run\n" + "".join(f"{t} {x} {2 * x} {3 * x} 0 0 0 1\n" for t, x in enumerate((0.1, 0.2, 0.4)))
    (tmp_path / "run.txt").write_text(text)
    target = tmp_path / "run.parquet"
    done = gpcorrect("convert", tmp_path / "run.txt", target, "--json")
    assert done.json["signals"] == ["tracker_cp"]
    one, two = read_log(tmp_path / "run.txt"), read_log(target)
    np.testing.assert_array_equal(one.tracker_cp.position, two.tracker_cp.position)
    np.testing.assert_array_equal(one.tracker_cp.quaternion, two.tracker_cp.quaternion)
    assert_refused(gpcorrect("convert", tmp_path / "run.txt", target), "not overwritten")
    assert_refused(gpcorrect("convert", tmp_path / "run.txt", tmp_path / "run.bag"), ".csv or .parquet")


def test_a_joint_recording_is_no_error_for_want_of_poses(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """One command that takes it is enough."""
    q = np.random.default_rng(0).normal(size=(960, 2)).cumsum(axis=0) / 50
    log = replace(small_log(), setpoint_cp=None, tracker_cp=None, measured_jp=q, external_jp=1.01 * q)
    dry = gpcorrect("validate", written(replace(log, time=np.arange(960) / 50), tmp_path / "joints.csv"), "--json")
    assert dry.json["uses"]["joint fit"] is True
    assert dry.json["uses"]["fit"] is not True
    assert dry.json["ok"]
