"""Old commands: what was wanted seconds ago must not move a robot now."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from attacks.lab import Lab, Scenario, Seen, held, waited

from gpcorrect.calibration import load
from gpcorrect_service.crtk import BusSettings, Pose
from gpcorrect_service.crtk.robot import Robot

LIMIT = 0.25  # s: nothing older moves a robot
CARRIED = 0.1  # s that a message may be under way between two processes of a busy machine
RATE = 50.0  # Hz of a planner
STOPPED = 5.0  # s


def held_prefilter(lab: Lab) -> Seen:
    """A pre-filter that is stopped for five seconds while its planner goes on, and falls silent."""
    return _planned(lab, hold=STOPPED, clock=0.0)


def foreign_clock(lab: Lab) -> Seen:
    """A planner whose clock is an hour behind, and so says nothing of the age of its commands."""
    return _planned(lab, hold=0.0, clock=-3600.0)


def _planned(lab: Lab, hold: float, clock: float) -> Seen:
    """Stream poses at a pre-filter; count commands that leave it too old, or whose age nobody can know."""
    middle = load(lab.model).check_queries[0, :7]
    with (
        lab.arm("--corrected") as (end, _),
        lab.program("prefilter", str(lab.model), "--endpoint", end, ready="corrects") as prefilter,
        Robot(BusSettings(end), patience=60.0) as robot,
    ):
        sent: dict[float, float] = {}
        came: list[tuple[float, float]] = []
        robot.bus.subscribe("corrected/servo_cp", lambda pose: came.append((pose.stamp, time.monotonic())))
        stop = threading.Event()
        planner = threading.Thread(target=_stream, args=(robot, middle, clock, sent, stop))
        planner.start()
        try:
            if clock:
                time.sleep(2.0)
            else:
                waited(lambda: len(came) > 20)
            with held(prefilter.pid):
                time.sleep(hold)
                stop.set()
                planner.join()
            time.sleep(1.0)
        finally:
            stop.set()
            planner.join()
    if clock:
        return Seen(len(sent), len(came), f"{len(came)} of {len(sent)} passed with a clock an hour off")
    ages = np.array([arrived - sent[stamp] for stamp, arrived in came if stamp in sent])
    old = int((ages > LIMIT + CARRIED).sum())
    return Seen(len(sent), old, f"{len(ages)} passed, oldest {ages.max():.2f} s")


def _stream(robot: Robot, middle: Any, clock: float, sent: dict[float, float], stop: threading.Event) -> None:
    pose = np.array(middle)
    while not stop.wait(1.0 / RATE):
        pose[0] = middle[0] + 0.003 * np.sin(2.0 * time.monotonic())
        stamp = robot.time + clock
        if stamp not in sent:
            sent[stamp] = time.monotonic()
            robot.bus.publish("servo_cp", Pose(stamp, tuple(pose.tolist()), "tracker"))


SCENARIOS = (
    Scenario("pre-filter stopped for 5 s", "commands older than 0.25 s", held_prefilter),
    Scenario("planner's clock an hour behind", "commands of unknown age", foreign_clock),
)
