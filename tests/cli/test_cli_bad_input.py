"""Bad input of every kind through the command line: exit status 2, one clear message, nothing lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, assert_refused, written
from support import small_log

from gpcorrect.logs import read_log
from gpcorrect.logs.sync import align, log_offset
from gpcorrect.types import CalibrationLog, PoseSignal


def moved(log: CalibrationLog, positions: np.ndarray) -> CalibrationLog:
    """Return the log with other observed positions."""
    return replace(log, tracker_cp=PoseSignal(positions, log.tracker_cp.quaternion))


@pytest.mark.parametrize(("name", "said"), [("no.csv", "no.csv"), ("none.csv", "empty")])
def test_a_missing_or_empty_file_is_named(gpcorrect: CommandLine, tmp_path: Path, name: str, said: str) -> None:
    """The message names the file; zero bytes are no recording."""
    (tmp_path / "none.csv").write_text("")
    assert_refused(gpcorrect("fit", tmp_path / name, "--output", tmp_path / "m.gpc"), said)


def test_rows_of_nan_are_dropped_and_counted(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Missing observations do not stop a fit; they are counted as dropped."""
    log = small_log(trajectories=6, samples=40)
    positions = log.tracker_cp.position.copy()
    positions[100:110] = np.nan
    path = written(moved(log, positions), tmp_path / "holes.csv")
    result = gpcorrect("fit", path, "--output", tmp_path / "m.gpc", "--marker", "none", "--json").json
    assert result["dropped"]["invalid"] == 10


def test_an_end_unlike_its_beginning_is_not_measured_on(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """A tracker that was moved before the last fifth: nothing there can be measured, and it is said what to do."""
    log = small_log(trajectories=1, samples=200)
    positions = log.tracker_cp.position.copy()
    positions[160:] += 0.3
    path = written(moved(log, positions), tmp_path / "one.csv")
    words = ("fit", path, "--output", tmp_path / "m.gpc", "--marker", "none")
    assert_refused(gpcorrect(*words), "rejects all 40", "--holdout 0")
    assert not (tmp_path / "m.gpc").exists()
    assert gpcorrect(*words, "--holdout", 0).code == 0


def test_a_tracker_that_saw_nothing_is_named(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """The message counts the complete poses of both signals."""
    path = written(scaled(small_log(), np.nan), tmp_path / "dark.csv")
    assert_refused(gpcorrect("fit", path, "--output", tmp_path / "m.gpc"), "dark.csv", "tracker_cp: 0")


def turned_over(log: CalibrationLog) -> CalibrationLog:
    """Return the log with the tracker's quaternions as x y z w."""
    assert log.tracker_cp.quaternion is not None
    return replace(log, tracker_cp=PoseSignal(log.tracker_cp.position, np.roll(log.tracker_cp.quaternion, -1, axis=1)))


def scaled(log: CalibrationLog, factors: object) -> CalibrationLog:
    """Return the log with observed positions times factors."""
    return moved(log, log.tracker_cp.position * np.asarray(factors))


@pytest.mark.parametrize(
    ("misread", "said"),
    [
        (lambda log: scaled(log, 1e3), "1e-3"),
        (lambda log: scaled(log, [1, 1, -1]), "mirror"),
        (turned_over, "xyzw"),
        (lambda log: replace(log, time=1e9 * log.time), "nanoseconds"),
    ],
    ids=["millimetres", "left-handed", "xyzw", "nanoseconds"],
)
def test_no_model_is_learned_from_a_recording_that_was_misread(
    gpcorrect: CommandLine, tmp_path: Path, misread: Callable[[CalibrationLog], CalibrationLog], said: str
) -> None:
    """What the dry run calls a wrong unit or frame stops fit and evaluate too, and the way past it is named."""
    path = written(misread(small_log()), tmp_path / "misread.csv")
    assert_refused(gpcorrect("fit", path, "--output", tmp_path / "m.gpc"), said, "--as-is", "misread.csv")
    assert not (tmp_path / "m.gpc").exists()


def test_a_recording_can_be_taken_as_it_is(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Whoever knows better than the guess of a unit can say so."""
    path = written(scaled(small_log(trajectories=6, samples=40), [1, 1, -1]), tmp_path / "mirrored.csv")
    assert gpcorrect("fit", path, "--output", tmp_path / "m.gpc", "--marker", "none", "--as-is").code == 0


def test_a_log_without_a_tracker_says_what_is_missing(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """The missing signal and those that are there are named."""
    path = written(replace(small_log(), tracker_cp=None), tmp_path / "blind.csv")
    assert_refused(gpcorrect("fit", path, "--output", tmp_path / "m.gpc"), "tracker_cp", "setpoint_cp", "--columns")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--features", "pose,torque"), "torque"),
        (("--marker", "maybe"), "maybe"),
        (("--holdout", "1.5"), "1.5"),
        (("--drop", "a:b"), "TRAJECTORY:START:STOP"),
        (("--drop", "99:0:1"), "numbered from 0 to 15"),
        (("--keep", "3:100:200"), "runs from 30"),
        (("--time-offset", "soon"), "soon"),
        (("--time-offset", "nan"), "nan"),
        (("--seed", "-1"), "--seed"),
    ],
)
def test_wrong_options_are_named(
    gpcorrect: CommandLine, log_file: Path, tmp_path: Path, words: tuple[str, str], said: str
) -> None:
    """An option out of range is refused, and the model file is not written."""
    assert_refused(gpcorrect("fit", log_file, "--output", tmp_path / "m.gpc", *words), said)
    assert not (tmp_path / "m.gpc").exists()


def test_the_way_past_disordered_stamps_is_one_that_the_command_has(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """What `validate` and `fit` advise, both take."""
    log = small_log()
    path = written(replace(log, time=np.where(np.arange(len(log)) == 30, 0.003, log.time)), tmp_path / "back.csv")
    model = tmp_path / "m.gpc"
    assert "--drop-disordered" in gpcorrect("validate", path).out
    assert_refused(gpcorrect("fit", path, "--output", model, "--marker", "none"), "line 32", "--drop-disordered")
    assert gpcorrect("validate", path, "--drop-disordered").code == 0
    assert gpcorrect("fit", path, "--output", model, "--marker", "none", "--drop-disordered").code == 0


@pytest.mark.parametrize("foreign", ["robot", "tracker"])
def test_a_mapping_goes_with_the_file_whose_signals_it_names(
    gpcorrect: CommandLine, tmp_path: Path, foreign: str
) -> None:
    """The other one is a native log, and needs none."""
    log, signals = small_log(), {"robot": "setpoint_cp", "tracker": "tracker_cp"}
    parts = {
        "robot": written(replace(log, tracker_cp=None), tmp_path / "robot.csv"),
        "tracker": written(replace(log, setpoint_cp=None), tmp_path / "tracker.csv"),
    }
    path, signal = parts[foreign], signals[foreign]
    path.write_text(path.read_text().replace("time", "clock", 1).replace(f"{signal}_", "at_"))
    text = f'time = "clock"\n[{signal}]\nposition = ["at_x", "at_y", "at_z"]\n'
    (tmp_path / "map.toml").write_text(text + 'quat_wxyz = ["at_qw", "at_qx", "at_qy", "at_qz"]\n')
    words = ("--tracker-log", parts["tracker"], "--columns", tmp_path / "map.toml", "--time-offset", 0)
    done = gpcorrect("convert", parts["robot"], tmp_path / "both.csv", *words)
    assert done.code == 0, done.said
    assert {"setpoint_cp", "tracker_cp"} <= set(read_log(tmp_path / "both.csv").signals)
    assert gpcorrect("validate", parts["robot"], *words).code == 0


@pytest.mark.parametrize("offset", ["0.2", "soon"])
def test_a_clock_that_nothing_would_be_shifted_by_is_refused(
    gpcorrect: CommandLine, log_file: Path, tmp_path: Path, offset: str
) -> None:
    """Without the tracker's own recording `convert` and `validate` shift nothing, and say so."""
    for command in (("convert", log_file, tmp_path / "c.csv"), ("validate", log_file)):
        assert_refused(gpcorrect(*command, "--time-offset", offset), f"--time-offset {offset}", "--tracker-log")
        assert gpcorrect(*command, "--time-offset", "none").code == 0


def test_a_late_sensor_is_shifted_where_it_is_asked_for(gpcorrect: CommandLine, log_file: Path, tmp_path: Path) -> None:
    """`--time-offset motion` of `convert`, `validate` and `fit` shifts what auto leaves to a servo."""
    log = read_log(log_file)
    late = align(replace(log, measured_cp=log.setpoint_cp), -0.08)
    recording, motion = written(late, tmp_path / "late.csv"), ("--time-offset", "motion")
    done = gpcorrect("convert", recording, tmp_path / "on_time.csv", *motion, "--json")
    assert done.code == 0, done.said
    assert any("shifted, as asked" in remark for remark in done.json["remarks"])
    moved = log_offset(read_log(tmp_path / "on_time.csv"))
    assert abs(moved.offset) < 0.02 < 0.06 < log_offset(late).offset
    found = gpcorrect("validate", recording, *motion, "--json").json["time_offsets"]
    assert abs(found[0]["offset_s"]) < 0.02
    fitted = gpcorrect(
        "fit", recording, "--output", tmp_path / "m.gpc", *motion, "--marker", "none", "--method", "offset"
    )
    assert "shifted, as asked" in fitted.said


def test_a_failed_fit_keeps_the_old_model(gpcorrect: CommandLine, log_file: Path, tmp_path: Path) -> None:
    """Whatever stops a fit, the model file of yesterday is still there."""
    model = tmp_path / "m.gpc"
    model.write_bytes(b"yesterday")
    assert gpcorrect("fit", log_file, "--output", model, "--marker", "maybe").code == 2
    assert model.read_bytes() == b"yesterday"


@pytest.mark.parametrize(("name", "said"), [("no/m.gpc", "folder"), ("", "no file")])
def test_an_output_that_cannot_be_written_is_refused_before_the_work(
    gpcorrect: CommandLine, log_file: Path, tmp_path: Path, name: str, said: str
) -> None:
    """In a folder that is missing, or a folder itself: nobody waits for a fit that cannot be saved."""
    assert_refused(gpcorrect("fit", log_file, "--output", tmp_path / name), said)


def test_a_report_folder_that_is_a_file_is_refused_before_the_work(
    gpcorrect: CommandLine, log_file: Path, tmp_path: Path
) -> None:
    """The file stays, and no model is written without its report."""
    before = log_file.read_bytes()
    assert_refused(gpcorrect("fit", log_file, "--output", tmp_path / "m.gpc", "--report", log_file), "report")
    assert not (tmp_path / "m.gpc").exists()
    assert log_file.read_bytes() == before


def test_a_robot_that_stood_still_is_refused(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """Orientations would register it, and the errors of a constant command would be printed as nothing."""
    log = small_log(trajectories=6, samples=40)
    assert log.setpoint_cp is not None
    still = PoseSignal(np.tile([0.1, 0.0, -0.1], (len(log), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(log), 1)))
    rng = np.random.default_rng(0)
    assert log.tracker_cp is not None
    seen = PoseSignal(still.position + 1e-4 * rng.normal(size=(len(log), 3)), still.quaternion)
    path = written(replace(log, setpoint_cp=still, tracker_cp=seen), tmp_path / "still.csv")
    assert_refused(gpcorrect("fit", path, "--output", tmp_path / "m.gpc"), "setpoint_cp never changes")
    assert not (tmp_path / "m.gpc").exists()
