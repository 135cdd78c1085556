"""The monitor's page while somebody publishes nonsense, and after everybody fell silent."""

from __future__ import annotations

import json
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh
from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import waited
from gpcorrect.calibration import load
from gpcorrect_service.crtk import Bus, BusSettings, Pose
from gpcorrect_service.crtk.messages import TOPICS, Report
from gpcorrect_service.crtk.robot import Robot

NONSENSE = (b"", b"\x00" * 40, b"{", b'{"stamp": 1, "pose": [1, 2]}', b'{"stamp": 1e400, "pose": [0,0,0,1,0,0,0]}')
SILENCE = 4.0  # s


def nonsense(lab: Lab) -> Seen:
    """Publish nonsense on every topic of one of two arms; both must go on being shown."""
    with (
        lab.arm("--arm", "arm1") as (one, _),
        lab.arm("--arm", "arm2") as (two, _),
        page(lab, one, two) as ask,
        Bus(BusSettings(one, "arm1")) as bus,
    ):
        waited(lambda: len(ask()["arms"]) == 2)
        for name in TOPICS:
            _throw(one, f"gpcorrect/arm1/{name}")
        nan = float("nan")
        for numbers in ((nan,) * 7, (0.0,) * 7, (1.0, 2.0)):
            for name in ("tracker_cp", "measured_cp", "servo_cp"):
                bus.publish(name, Pose(1.0, numbers))
        bus.publish("corrected/report", Report(nan, (nan,), (), (), (), True, "", "", nan, "", ""))
        time.sleep(1.0)
        failed = 0
        for _ in range(20):
            time.sleep(0.1)
            try:
                failed += any(arm["silent_seconds"] > 1.0 for arm in ask()["arms"])
            except (ValueError, OSError):
                failed += 1
    return Seen(20, failed)


def silence(lab: Lab) -> Seen:
    """Correct for a while, then let planner and pre-filter fall silent; what is shown must say how old it is."""
    pose = load(lab.model).check_queries[0, :7]
    with (
        lab.arm("--corrected") as (end, _),
        page(lab, end) as ask,
        Robot(BusSettings(end), patience=60.0) as robot,
    ):
        with lab.program("prefilter", str(lab.model), "--endpoint", end, ready="corrects"):

            def _shown() -> bool:
                robot.servo_cp(pose, "tracker")
                return bool(ask()["arms"][0]["correction"])

            waited(_shown)
        time.sleep(SILENCE)
        (arm,) = ask()["arms"]
        ages = [arm["correction"].get("age"), arm["poses"]["desired"].get("age")]
    return Seen(len(ages), sum(not (age and age["old"]) for age in ages))


@contextmanager
def page(lab: Lab, *endpoints: str) -> Iterator[Callable[[], Any]]:
    """Run a monitor of some addresses; give what asks for its snapshot.

    Parameters
    ----------
    lab : Lab
    *endpoints : str, of robots, servers or routers
    """
    address = free_endpoint().removeprefix("tcp/")
    words = [word for end in endpoints for word in ("--endpoint", end)]

    def _ask() -> Any:
        with urllib.request.urlopen(f"http://{address}/api/state", timeout=10.0) as reply:
            return json.loads(reply.read(), parse_constant=_refuse)

    def _answers() -> bool:
        try:
            return bool(_ask())
        except OSError:
            return False

    with lab.program("monitor", "--port", address.rsplit(":", 1)[1], *words, ready="open http"):
        waited(_answers)
        yield _ask


def _refuse(name: str) -> Any:
    raise ValueError(f"{name} is no JSON")


def _throw(endpoint: str, key: str) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session:
        for payload in NONSENSE:
            for encoding in ("application/json", "application/msgpack", "application/cdr", "zenoh/bytes", "image/png"):
                session.put(key, payload, encoding=encoding)


SCENARIOS = (
    Scenario("monitor and nonsense", "snapshots that fail or freeze", nonsense),
    Scenario("monitor after all fell silent", "old numbers shown as new", silence),
)
