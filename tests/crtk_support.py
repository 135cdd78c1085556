"""An arm on the network for as long as a test needs it, and correctors whose answers are known."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from gpcorrect.cli.processes import free_endpoint
from gpcorrect.correction import Correction, Reason
from gpcorrect.sim import machine_of, preset
from gpcorrect.sim.live_robot import LiveRobot
from gpcorrect.types import FloatArray
from gpcorrect_service.crtk import ArmServer, ArmServerSettings, Bus, BusSettings
from gpcorrect_service.protocol.settings import RosDistro
from gpcorrect_service.server.models import Model

PATIENT = 30.0  # s: only a test that fails waits this long
PATIENCE_OF_ANOTHER = 120.0  # s for a process that reads the libraries of another implementation
EPOCH = 1.8e9
SHIFT = np.array([0.001, -0.002, 0.0015])


class ShiftCorrector:
    """Moves poses by SHIFT; out of domain beyond 0.5 m; the stream answers alike."""

    def __init__(self, shift: FloatArray = SHIFT) -> None:
        self.shift = shift
        self.resets = 0

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        std = np.full(6, 1e-3)
        reason = Reason.NONE if np.linalg.norm(pose[:3]) < 0.5 else Reason.OUTSIDE
        return Correction(pose[:3] + self.shift, pose[3:], None, std, 2 * std, reason)

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Any:
        raise NotImplementedError

    def info(self) -> dict[str, Any]:
        return {}

    def stream(self) -> Any:
        corrector = self

        class Stream:
            def correct(self, time: float, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
                return corrector.correct(pose, twist)

            def reset(self) -> None:
                corrector.resets += 1

        return Stream()


def model(corrector: ShiftCorrector) -> Model:
    """Return the corrector as a model with a name."""
    return Model(corrector, id="shift", hash="0" * 64)


@contextmanager
def living_arm(
    machine: str = "raven2_debridement",
    arm: str = "arm1",
    ros_domain: int | None = None,
    ros_distro: RosDistro = "jazzy",
    **settings: Any,
) -> Iterator[tuple[BusSettings, LiveRobot]]:
    """Run a simulated arm in a thread, and give the settings of its clients, and the arm itself."""
    real = machine_of(preset(machine))
    robot = LiveRobot(real, np.random.default_rng(0), block=20)
    endpoint, stop = free_endpoint(), threading.Event()
    with Bus(BusSettings(endpoint, arm, role="hub", ros_domain=ros_domain, ros_distro=ros_distro)) as bus:
        server = ArmServer(
            robot,
            bus,
            ArmServerSettings(**{"rate_hz": 50.0, "time_scale": 5.0, "command_age": PATIENT, **settings}),
            EPOCH,
        )
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        try:
            yield BusSettings(endpoint, arm, patience=PATIENT), robot
        finally:
            stop.set()
            thread.join(PATIENT)


def wait_for(done: Callable[[], bool]) -> None:
    """Wait until something holds."""
    until = time.monotonic() + PATIENT
    while not done():
        assert time.monotonic() < until, "it never came"
        time.sleep(0.005)
