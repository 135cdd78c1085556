"""The robot tools and the debridement task as a user runs them, other processes included."""

import json
import shutil
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from command_line import assert_refused
from crtk_support import PATIENT, living_arm, wait_for

from gpcorrect.logs import read_log
from gpcorrect_service.crtk import Bus, BusSettings
from gpcorrect_studies.debridement import command, rehearsal

pytestmark = pytest.mark.slow
# Tests that need no arm of this module come first: it takes half a core from its first test to the last.


def test_options_that_cannot_be_meant_are_refused(gpcorrect, tmp_path):
    assert_refused(gpcorrect("debride", "--mode", "half"), "full or endpoints")
    assert_refused(gpcorrect("debride", "--picture", tmp_path / "p.png"), "--report instead of --picture")
    assert_refused(gpcorrect("monitor", "--host", "0.0.0.0"), "other machines")
    for rate in ("5000", "nan", "0"):
        assert_refused(gpcorrect("sim", "serve", "--rate", rate), "--rate")
    assert_refused(gpcorrect("sim", "serve", "--time-scale", "0"), "--time-scale")
    assert_refused(gpcorrect("sim", "serve", "--endpoint", "tcp/0.0.0.0:7448"), "other machines")
    assert_refused(gpcorrect("sim", "serve", "--ros-distro", "humble"), "--ros-domain")
    assert_refused(gpcorrect("sim", "serve", "--ros-domain", 0, "--ros-distro", "foxy"), "humble, jazzy or rolling")
    for seconds in ("inf", "nan", "-1"):
        refused = gpcorrect("robot", "record", "--seconds", seconds, "-o", tmp_path / "x.csv")
        assert_refused(refused, f"length in seconds above 0, got {seconds}", "leave it out")
    assert_refused(gpcorrect("robot", "random", "--seconds", "inf"), "at least two samples and an end")
    for quaternion in ("0 0 0 0", "nan 0 0 1", "inf 0 0 0"):
        refused = gpcorrect("robot", "draw", "--centre", 0, 0, 0, *quaternion.split())
        assert_refused(refused, "seven numbers whose quaternion is not zero", quaternion)
    assert_refused(gpcorrect("robot", "extract", "no.csv", "-o", tmp_path / "x.csv"), "no.csv")
    for rate in ("0", "nan", "1e9"):  # refused as a speed, and a traceback
        assert_refused(gpcorrect("zigzag", "--rate", rate, "-o", tmp_path / "x.csv"), "--rate")
    for study in ("mahler2014", "peng2020", "peng2024"):
        assert_refused(gpcorrect("reproduce", study, "--seed", -1, "-o", tmp_path / "x"), "--seed")
        assert_refused(gpcorrect("reproduce", study, "--quick", "--short", "-o", tmp_path / "x"), "two sizes")
    short = ("reproduce", "mahler2014", "--short", "--reaches", 50, "-o", tmp_path / "x")
    assert_refused(gpcorrect(*short), "--reaches goes with the whole study")


def test_a_list_of_no_signals_is_refused(gpcorrect, log_file, tmp_path):
    """It made a log without any."""
    words = ("robot", "extract", log_file, "--signals", ",", "-o", tmp_path / "part.csv")
    assert_refused(gpcorrect(*words), "--signals names nothing")


def test_debridement_with_served_corrections(gpcorrect, tmp_path, monkeypatch):
    """The correction that another process serves makes the open loop work, which without it removes nothing."""
    monkeypatch.setattr(rehearsal, "INDUCING", 100)
    monkeypatch.setattr(rehearsal, "SEARCH", 100)
    done = gpcorrect(
        "debride", "--arms", 1, "--fragments", 2, "--sets", 1, "--rehearsals", 12, "--margin", 0.01,
        "--models", tmp_path, "--report", tmp_path / "task.html", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    looking, knowing, blind, unsure = json.loads(done.out)["conditions"]
    assert (knowing["looks"], blind["looks"]) == (0, 0)
    assert unsure["looks"] > 0  # no correction is sure to 0.01 mm
    assert knowing["success_rate"] >= 0.5
    assert blind["success_rate"] == 0.0
    assert knowing["seconds_per_fragment"] < looking["seconds_per_fragment"]
    assert json.loads(done.out)["served"][0].startswith("arm1, SHA-256 ")
    assert (tmp_path / "arm1.gpc").exists()
    assert "times faster with correction" in (tmp_path / "task.html").read_text()


def test_debridement_replaces_no_model_of_somebody(gpcorrect, tmp_path):
    """A folder's model that this rehearsal did not make was fitted over without a word."""
    (tmp_path / "arm1.gpc").write_bytes(b"mine")
    refused = gpcorrect("debride", "--arms", 1, "--rehearsals", 8, "--models", tmp_path)
    assert_refused(refused, "arm1.gpc was not made by this rehearsal", "--models")
    assert (tmp_path / "arm1.gpc").read_bytes() == b"mine"
    both = gpcorrect("debride", "--arms", 1, "--models", tmp_path, "--endpoint", "tcp/127.0.0.1:9")
    assert_refused(both, "a folder of models was named too", "--endpoint")


def test_debridement_with_running_services_fits_nothing(gpcorrect, monkeypatch):
    """It rehearsed and fitted first, for minutes, a model that nobody asked."""
    monkeypatch.setattr(rehearsal, "fit_corrector", lambda *_: pytest.fail("a model was fitted"))
    three = [word for port in (7, 8, 9) for word in ("--endpoint", f"tcp/127.0.0.1:{port}")]
    assert_refused(gpcorrect("debride", *three), "one an arm (2); got 3")
    monkeypatch.setattr(command, "FOUND", 0.2)
    refused = gpcorrect("debride", "--arms", 1, "--rehearsals", 8, "--endpoint", "tcp/127.0.0.1:9")
    assert_refused(refused, "no server answered on gpcorrect/arm1")


def test_a_calibration_from_end_to_end(gpcorrect, tmp_path):
    """Zig-zags are driven, recorded and learned from: errors on a random run are smaller than the raw ones."""
    done = gpcorrect(
        "collect", "zigzag", "--direction", "J1-J2-J3", "--sparsity", 1, "--test", 20, "--method", "linear",
        "--time-scale", 40, "--output", tmp_path, "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    errors = done.json["errors"]
    assert all(c["rmse"] < r["rmse"] for c, r in zip(errors["corrected"], errors["raw"], strict=True))
    assert read_log(tmp_path / "zigzags.csv").external_jp is not None
    assert (tmp_path / "joints.gpc").exists()


@pytest.fixture(scope="module")
def arm():
    """Run a simulated arm that lives as long as these tests."""
    with living_arm(time_scale=10.0) as (settings, _):
        yield settings.endpoint


def test_a_robot_goes_follows_and_is_recorded(gpcorrect, arm, tmp_path):
    """Ready, go to joints, follow a file, record it and take a part out: each command does what it says."""
    at = ("--endpoint", arm)
    assert gpcorrect("robot", "operate", "ready", *at).out.startswith("ENABLED, homed")
    assert gpcorrect("robot", "goto", "35,85,340,0,0,0", *at).code == 0
    told = gpcorrect("robot", "state", *at).json
    np.testing.assert_allclose(told["setpoint_jp"][:3], [np.deg2rad(35), np.deg2rad(85), 0.34], atol=1e-6)
    limits = ("--limits", "34:36,84:86,339:341")
    assert gpcorrect("zigzag", "-o", tmp_path / "zz.csv", "--sparsity", 1, *limits).code == 0
    command = [sys.executable, "-m", "gpcorrect", "robot", "record", "-o", str(tmp_path / "run.csv")]
    words = [*command, "--seconds", "120", "--mcap", str(tmp_path / "bag"), *at]
    recording = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    assert recording.stderr is not None
    assert "recording" in recording.stderr.readline()
    assert "trajectory 0" in gpcorrect("robot", "follow", tmp_path / "zz.csv", *at).out
    assert gpcorrect("robot", "random", "--seconds", 2, *limits, *at).code == 0
    recording.send_signal(signal.SIGINT)
    assert recording.wait(PATIENT) == 0
    log = read_log(tmp_path / "run.csv")
    assert {"setpoint_jp", "measured_jp", "external_jp", "tracker_cp"} <= set(log.signals)
    assert np.ptp(log.setpoint_jp[:, 0]) > np.deg2rad(0.5)
    part = gpcorrect(
        "robot", "extract", tmp_path / "bag", "-o", tmp_path / "p.csv", "--signals", "measured_jp", "--json"
    )
    assert part.json["signals"] == ["measured_jp"]


def test_a_state_command_says_what_came_of_it(gpcorrect, arm):
    """What is printed is the state after the command."""
    at = ("--endpoint", arm)
    assert gpcorrect("robot", "operate", "ready", *at).code == 0
    assert gpcorrect("robot", "operate", "unhome", *at).out.startswith("ENABLED, not homed")
    assert gpcorrect("robot", "operate", "pause", *at).out.startswith("PAUSED")
    assert gpcorrect("robot", "operate", "disable", *at).out.startswith("DISABLED")


def test_a_recording_is_not_overwritten(gpcorrect, arm, tmp_path):
    """A file or folder that is there is refused before anything is recorded, and stays as it is."""
    there = tmp_path / "run.csv"
    there.write_text("precious")
    folder = tmp_path / "bag"
    folder.mkdir()
    words = ("robot", "record", "--endpoint", arm, "--seconds", 600, "-o")
    assert_refused(gpcorrect(*words, there), "not overwritten")
    assert_refused(gpcorrect(*words, tmp_path / "new.csv", "--mcap", folder), "not overwritten")
    assert_refused(gpcorrect(*words, tmp_path / "run.txt"), ".csv or .parquet")
    assert there.read_text() == "precious"
    (tmp_path / "zigzags.csv").write_text("precious")
    assert_refused(gpcorrect("collect", "zigzag", "-o", tmp_path, "--endpoint", arm), "not overwritten")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("goto", "1,2"), "need 6 numbers"),
        (("goto", "400,85,340,0,0,0"), "beyond its limits"),
        (("goto", "35,85,340,0,0,0", "--sliding", "9"), "numbers from 1 to 6"),
        (("draw",), "say where to draw"),
        (("operate", "foo"), "enable, disable, pause"),
    ],
)
def test_what_cannot_be_meant_is_refused(gpcorrect, arm, words, said):
    """Bad input ends with one message and exit status 2, before or after the robot has seen it."""
    gpcorrect("robot", "operate", "ready", "--endpoint", arm)
    assert_refused(gpcorrect("robot", *words, "--endpoint", arm), said)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP], ids=lambda number: number.name)
def test_a_calibration_that_is_broken_off_leaves_its_recording(arm, tmp_path, number):
    """Ctrl-C or a closed terminal in the middle: what was driven until then is in the file."""
    words = ("collect", "zigzag", "--endpoint", arm, "-o", str(tmp_path))
    told = tmp_path / "told"
    with (
        Bus(BusSettings(arm)) as bus,
        told.open("wb") as file,
        subprocess.Popen([sys.executable, "-m", "gpcorrect", *words], stderr=file) as driving,
    ):
        moved = threading.Event()
        bus.subscribe("event", lambda event: moved.set())
        assert moved.wait(PATIENT)
        time.sleep(1.0)  # of recording
        driving.send_signal(number)
        assert driving.wait(PATIENT) == 130, told.read_text()
    assert len(read_log(tmp_path / "zigzags.csv")) > 0
    assert not list(tmp_path.glob("*.unfinished"))


def test_a_killed_recorder_leaves_what_it_heard(gpcorrect, arm, tmp_path):
    """Killed outright: the journal holds what came, is not overwritten by the next recording, and becomes a log."""
    run, at = tmp_path / "run.csv", ("--endpoint", arm)
    left = tmp_path / "run.csv.unfinished"

    def half_is_enough() -> bool:
        """Whether half of what is written makes a log: every signal has come for a while."""
        if not left.exists():
            return False
        heard, folder = left.read_bytes(), tmp_path / "early"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / "half.unfinished").write_bytes(heard[: len(heard) // 2])
        told = gpcorrect("robot", "recover", folder / "half.unfinished", "-o", folder / "half.csv", "--json")
        return (
            told.code == 0 and told.json["samples"] > 20 and {"measured_jp", "setpoint_jp"} <= set(told.json["signals"])
        )

    with subprocess.Popen([sys.executable, "-m", "gpcorrect", "robot", "record", "-o", str(run), *at]) as recording:
        try:
            wait_for(half_is_enough)
        finally:
            recording.kill()
    assert not run.exists()
    assert_refused(gpcorrect("robot", "record", "-o", run, *at), "robot recover", "run.csv.unfinished")
    assert gpcorrect("robot", "recover", left, "-o", run, "--json").json["samples"] > 20
    log = read_log(run)
    assert {"measured_jp", "setpoint_jp"} <= set(log.signals)
    assert left.exists()  # the user's to remove
    torn = left.read_bytes()
    left.write_bytes(torn[: len(torn) // 2])
    assert 0 < gpcorrect("robot", "recover", left, "-o", tmp_path / "half.csv", "--json").json["samples"] < len(log)
    left.write_bytes(torn[:1000] + b"\xff" * 1000 + torn[2000:])
    assert_refused(gpcorrect("robot", "recover", left, "-o", tmp_path / "x.csv"), "altered")
    assert_refused(gpcorrect("robot", "recover", run, "-o", tmp_path / "x.csv"), "not what a recorder leaves")
