"""Old commands: what was wanted seconds ago must not move a robot now."""

from __future__ import annotations

import math
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import zenoh
from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import held, waited
from gpcorrect.calibration import JointCorrector, load
from gpcorrect_service import ClientSettings
from gpcorrect_service.crtk import BusSettings, OperatingState, Pose
from gpcorrect_service.crtk.robot import Robot
from gpcorrect_service.protocol.answer import EstimateAnswer
from gpcorrect_service.protocol.messages import MSGPACK, JointState
from gpcorrect_service.protocol.sessions import open_client

LIMIT = 0.25  # s: nothing older moves a robot
CARRIED = 0.1  # s that a message may be under way between two processes of a busy machine
RATE = 50.0  # Hz of a planner
STOPPED = 5.0  # s
PIECE = 65536  # bytes that a relay passes on at once


def held_prefilter(lab: Lab) -> Seen:
    """Stop a pre-filter for five seconds; its planner goes on, and falls silent before the pre-filter wakes."""
    return _planned(lab, hold=STOPPED, clock=0.0)


def foreign_clock(lab: Lab) -> Seen:
    """Command with a clock that is an hour behind, and so says nothing of the age of a command."""
    return _planned(lab, hold=0.0, clock=-3600.0)


def timeless_states(lab: Lab) -> Seen:
    """Command with that clock, while somebody says of the robot that it is enabled, stamped NaN."""
    return _planned(lab, hold=0.0, clock=-3600.0, timeless=True)


def held_network(lab: Lab) -> Seen:
    """Let the network to a pre-filter stand still for five seconds; all that it held comes at once afterwards."""
    return _planned(lab, hold=STOPPED, clock=0.0, network=True)


def _planned(lab: Lab, hold: float, clock: float, *, network: bool = False, timeless: bool = False) -> Seen:
    """Stream poses at a pre-filter; count commands that leave it too old, or whose age nobody can know."""
    middle = load(lab.model).check_queries[0, :7]
    with (
        lab.arm("--corrected") as (end, _),
        relay(end) as (relayed, flows),
        lab.program("prefilter", str(lab.model), "--endpoint", relayed, ready="corrects") as prefilter,
        Robot(BusSettings(end), patience=60.0) as robot,
    ):
        sent: dict[float, float] = {}
        came: list[tuple[float, float]] = []
        robot.bus.subscribe("corrected/servo_cp", lambda pose: came.append((pose.stamp, time.monotonic())))
        stop = threading.Event()
        planner = threading.Thread(target=_stream, args=(robot, middle, clock, timeless, sent, stop))
        planner.start()
        try:
            if clock:
                time.sleep(2.0)
            else:
                waited(lambda: len(came) > 20)
            with _still(flows) if network else held(prefilter.pid):
                time.sleep(hold)
                stop.set()
                planner.join()
                time.sleep(2 * LIMIT)  # what was sent last is old as well when all goes on
                before = robot.setpoint
            time.sleep(1.0)
            moved = float(np.abs(robot.setpoint - before).max())
        finally:
            stop.set()
            planner.join()
    if clock:
        return Seen(len(sent), len(came), f"{len(came)} of {len(sent)} passed with a clock an hour off")
    ages = np.array([arrived - sent[stamp] for stamp, arrived in came if stamp in sent])
    old = int((ages > LIMIT + CARRIED).sum())
    # A command that was already on its way when all stood still is the arm's to refuse: it must not move.
    broken = max(old, 1) if moved > 0 else 0
    return Seen(len(sent), broken, f"{len(ages)} passed, {old} of them came old, the arm moved {moved:.1e} rad or m")


@contextmanager
def _still(flows: threading.Event) -> Iterator[None]:
    flows.clear()
    try:
        yield
    finally:
        flows.set()


def _stream(
    robot: Robot, middle: Any, clock: float, timeless: bool, sent: dict[float, float], stop: threading.Event
) -> None:
    pose = np.array(middle)
    while not stop.wait(1.0 / RATE):
        pose[0] = middle[0] + 0.003 * np.sin(2.0 * time.monotonic())
        if timeless:
            robot.bus.publish("operating_state", OperatingState(math.nan, "ENABLED", True, False))
        stamp = robot.time + clock
        if stamp not in sent:
            sent[stamp] = time.monotonic()
            robot.bus.publish("servo_cp", Pose(stamp, tuple(pose.tolist()), "tracker"))


def held_estimates(lab: Lab) -> Seen:
    """Stop a server of joints for five seconds while the robot goes on publishing them, homed again every second."""
    joints = lab.joint_model
    measured, rows = load(joints, JointCorrector), 0
    zeros = (0.0,) * len(measured.types)
    end = free_endpoint()
    came: list[tuple[float, float, str]] = []

    def _came(sample: zenoh.Sample) -> None:
        answer = MSGPACK.decode(EstimateAnswer, sample.payload.to_bytes())
        came.append((answer.stamp, time.monotonic() - answer.stamp, answer.status))

    with (
        lab.program("serve", "--joints", str(joints), "--endpoint", end, ready="serving") as server,
        open_client(ClientSettings((end,))) as session,
        session.declare_subscriber("arm1/estimate", zenoh.handlers.Callback(_came, indirect=False)),
    ):
        stop = threading.Event()

        def _robot() -> None:
            while not stop.wait(0.01):
                now = time.monotonic()
                state = JointState(now, zeros, effort=zeros, session=int(now))
                session.put("arm1/measured_js", MSGPACK.encode(state), encoding=MSGPACK.encoding("joint_state"))

        robot = threading.Thread(target=_robot)
        robot.start()
        try:
            waited(lambda: len(came) > 50)
            with held(server.pid):
                stopped = time.monotonic()
                time.sleep(STOPPED)
            rows = len(came)
            time.sleep(2.0)
        finally:
            stop.set()
            robot.join()
    # What was answered before the stop, and was on its way, nobody can call back: its stamp tells its age.
    late = [status for stamp, age, status in came if stamp > stopped and age > LIMIT + CARRIED]
    believed = [status for status in late if status != "STALE"]
    return Seen(
        len(came),
        len(believed),
        f"{len(came) - rows} came after the stop, {dict(Counter(status for *_, status in came))}",
    )


@contextmanager
def relay(endpoint: str) -> Iterator[tuple[str, threading.Event]]:
    """Pass on what comes for an address; gives the relay's own address, and an event that is set while it flows.

    Parameters
    ----------
    endpoint : str, as `tcp/127.0.0.1:7448`
    """
    host, port = endpoint.removeprefix("tcp/").split(":")
    flows, links = threading.Event(), []
    flows.set()

    def _pass(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while piece := source.recv(PIECE):
                flows.wait()
                sink.sendall(piece)

    def _accept(listening: socket.socket) -> None:
        with suppress(OSError):
            while True:
                near, _ = listening.accept()
                far = socket.create_connection((host, int(port)))
                links.extend((near, far))
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=_pass, args=pair, daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as listening:
        threading.Thread(target=_accept, args=(listening,), daemon=True).start()
        try:
            yield f"tcp/127.0.0.1:{listening.getsockname()[1]}", flows
        finally:
            flows.set()
            for link in links:
                link.close()


SCENARIOS = (
    Scenario("pre-filter stopped for 5 s", "commands older than 0.25 s that move", held_prefilter),
    Scenario("network still for 5 s", "commands older than 0.25 s that move", held_network),
    Scenario("estimates of a server stopped for 5 s", "estimates older than 0.25 s, not STALE", held_estimates),
    Scenario("planner's clock an hour behind", "commands of unknown age", foreign_clock),
    Scenario("the same, and robot states without a time", "commands of unknown age", timeless_states),
)
