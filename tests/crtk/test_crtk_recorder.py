"""A recording is written whatever came beside what was wanted; its journal may be torn off, and is never altered."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crtk_support import living_arm

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect_service.crtk import Bus, BusSettings, JointState, Pose
from gpcorrect_service.crtk.messages import Event
from gpcorrect_service.crtk.recorder import Journal, Recorder, recovered

STEP, BEGIN = 0.01, 1000.0
NUMBER = 40  # of messages in a journal
Sent = tuple[str, Any]


class Wire:
    """A bus on which a test says what comes, in which order."""

    settings = BusSettings()

    def __init__(self) -> None:
        self._inboxes: dict[str, Any] = {}

    def subscribe(self, name: str, inbox: Any) -> None:
        """See :class:`Bus`."""
        self._inboxes[name] = inbox

    def deliver(self, sent: list[Sent]) -> None:
        """Hand messages over."""
        for name, message in sent:
            self._inboxes[name](message)


def joints(stamp: float, value: float, **more: Any) -> Sent:
    return "measured_js", JointState(stamp, (value, 2 * value), **more)


def motion(begin: float, count: int = 100) -> list[Sent]:
    """Joints that move evenly, and what was commanded with them."""
    sent: list[Sent] = []
    for k in range(count):
        sent += [joints(begin + k * STEP, 1e-3 * k), ("setpoint_js", JointState(begin + k * STEP, (1e-3 * k, 0.0)))]
    return sent


def recorded(sent: list[Sent]) -> Any:
    wire: Any = Wire()
    recorder = Recorder(wire)
    wire.deliver(sent)
    return recorder.recording().log()


@pytest.mark.parametrize(
    "odd",
    [
        joints(0.0, 0.1),
        ("measured_js", JointState(BEGIN + 0.005, (0.1,))),
        ("setpoint_js", JointState(BEGIN + 0.005, (0.1, 0.2, 0.3))),
        ("measured_js", JointState(BEGIN + 0.005, (0.0005, None), effort=(1.0, 1.0))),
        ("tracker_cp", Pose(BEGIN + 0.005, (0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0))),
        ("tracker_cp", Pose(BEGIN + 1e6, (0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0))),
    ],
)
def test_one_odd_message_costs_no_more_than_itself(odd: Sent) -> None:
    """Without a stamp, with other numbers, of a topic of its own: all samples of the rest are in the log."""
    log = recorded([*motion(BEGIN), odd])
    there = np.isfinite(log.measured_jp).all(axis=1)
    np.testing.assert_allclose(log.measured_jp[there, 0], 1e-3 * np.arange(100), atol=1e-12)
    np.testing.assert_allclose(log.setpoint_jp[there, 0], 1e-3 * np.arange(100), atol=1e-12)


def test_a_tracker_on_stamps_of_its_own_is_recorded() -> None:
    """What no stamp has in common with the joints has its values at their times."""
    seen = [("tracker_cp", Pose(BEGIN + 0.0133 * k, (0.0133 * k, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))) for k in range(75)]
    log = recorded([*motion(BEGIN), *seen])
    np.testing.assert_allclose(log.tracker_cp.position[:, 0], log.time, atol=1e-9)


def test_a_clock_that_is_set_back_begins_a_session() -> None:
    """What was done before and after stays apart, in the order in which it was done, and time goes on."""
    log = recorded([("event", Event(BEGIN, 0)), *motion(BEGIN), *motion(BEGIN - 0.7)])
    np.testing.assert_allclose(log.measured_jp[:, 0], 1e-3 * np.tile(np.arange(100), 2), atol=1e-12)
    assert (np.diff(log.time) > 0).all()
    assert [log.session[0], log.session[-1]] == [0, 1]
    assert len(set(zip(log.session.tolist(), log.trajectory.tolist(), strict=True))) == len(log.trajectory_ids) == 2
    assert any("set back" in remark for remark in log.remarks)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["SIGTERM", "SIGHUP"])
def test_a_recording_that_is_ended_from_outside_is_written(tmp_path: Path, number: int) -> None:
    """A service that is stopped, a terminal that is closed: what came until then is in the file."""
    target = tmp_path / "run.csv"
    with living_arm() as (settings, _), Bus(settings):
        words = ("robot", "record", "-o", str(target), "--endpoint", settings.endpoint)
        command = [sys.executable, "-m", "gpcorrect", *words]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            assert "recording" in process.stderr.readline()
            time.sleep(1.0)  # of recording
            process.send_signal(number)
            assert process.wait(120) == 0
    assert len(read_log(target)) > 0


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    """Poses that a recorder wrote down before it was killed."""
    with Journal(tmp_path / "run.csv", "left") as file:
        for i in range(NUMBER):
            file.write("measured_cp", 0, Pose(1.0 + i, (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0)))
    return file.path


def test_a_torn_end_is_left_out(journal: Path) -> None:
    """Wherever the file ends, all whole messages are there."""
    whole = journal.read_bytes()
    for end in range(len(whole) - 100, len(whole)):
        journal.write_bytes(whole[:end])
        found = recovered(journal)
        assert found.arm == "left"
        assert len(found.messages["measured_cp"]) in (NUMBER - 2, NUMBER - 1)


def test_a_message_that_no_arm_sends_does_not_make_the_journal_unreadable(tmp_path: Path) -> None:
    """A frame with a name of 64 kB is left out of it, as it would look like a file that was altered."""
    pose = Pose(1.0, (0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0))
    with Journal(tmp_path / "run.csv", "left") as file:
        for message in (pose, Pose(2.0, pose.pose, "x" * (1 << 16)), Pose(3.0, pose.pose)):
            file.write("measured_cp", 0, message)
    assert [came.message.stamp for came in recovered(file.path).messages["measured_cp"]] == [1.0, 3.0]


def test_what_was_altered_is_refused_wherever_it_begins(journal: Path) -> None:
    """Also where it takes the length of a message, which then seems to be torn off with all that follows."""
    whole = journal.read_bytes()
    for first in range(400, 500):
        journal.write_bytes(whole[:first] + b"\xff" * 300 + whole[first + 300 :])
        with pytest.raises(LogError, match="altered"):
            recovered(journal)
