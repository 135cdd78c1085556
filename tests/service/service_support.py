"""What the service's tests share: small honest correctors, and servers in other processes, always killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.context import ForkServerProcess
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError
from gpcorrect.rigid import RigidModel
from gpcorrect.types import FloatArray
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings
from gpcorrect_service.protocol.ros import CORRECT, StampedPose, ros_pose, ros_types
from gpcorrect_service.protocol.sessions import client_config
from gpcorrect_service.protocol.sessions import wait_for as await_stop
from gpcorrect_service.server.models import JointModel, Model
from gpcorrect_service.server.service import Server, serve

SHIFT = np.array([0.001, -0.002, 0.003])
REGISTRATION = np.array([0.4, 0.1, -0.2])
POSE = [0.1, 0.02, -0.11, 1.0, 0.0, 0.0, 0.0]
STAMPED = StampedPose(tuple(POSE), 12, 34, "tracker")
SLACK = 0.02  # rad and m
PATIENT = 30.0  # s: only a test that fails waits this long
REGION = {"position_min": [-0.1, -0.1, -0.2], "position_max": [0.1, 0.1, 0.0]}

# Children come from a process that has read the libraries and opened nothing: zenoh bears no fork after a session.
spawn = multiprocessing.get_context("forkserver")
# Only what is installed: this file is not on that process's path, and what it cannot import it leaves out in silence.
spawn.set_forkserver_preload(["gpcorrect_service.server.service", "gpcorrect.calibration.model_file"])


class ShiftCorrector:
    """Moves a pose by SHIFT and leaves its orientation; unsure by 1 mm; x > 0.5 m is extrapolation."""

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for one pose."""
        return self.correct_path(pose[None], np.zeros(1))[0]

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Correction:
        """Return the commands for a path."""
        std = np.full((len(poses), 6), 1e-3)
        std[:, 3:] = np.nan
        outside = np.where(poses[:, 0] > 0.5, int(Reason.OUTSIDE), 0)
        quaternion = poses[:, 3:] if poses.shape[1] == 7 else None
        return Correction(poses[:, :3] + SHIFT, quaternion, None, std, 2 * std, outside)

    def info(self) -> dict[str, Any]:
        """Return frames and training region, as a fitted model does."""
        return {"frames": {"input": "tracker", "output": "base"}, "training_region": REGION}


class RegisteredCorrector(ShiftCorrector):
    """The same behind a registration: moves a pose by REGISTRATION, then by SHIFT."""

    rigid = RigidModel("pose", t=REGISTRATION)

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Correction:
        """Return the commands for a path."""
        answer = super().correct_path(poses, times)
        return replace(answer, position=answer.position + REGISTRATION)


class GatedCorrector(ShiftCorrector):
    """Answers single poses only while its gate is open, and tells when one has entered; paths pass always."""

    def __init__(self, gate: Event, entered: Event) -> None:
        self._gate = gate
        self._entered = entered

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for one pose."""
        self._entered.set()
        self._gate.wait()
        return super().correct(pose, twist)


class FaultyCorrector(ShiftCorrector):
    """Fails on x < 0, and answers NaN on x = 0."""

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for one pose."""
        if pose[0] < 0:
            raise ZeroDivisionError("a fault inside the model")
        answer = super().correct(pose, twist)
        return answer if pose[0] > 0 else replace(answer, position=np.full(3, np.nan))


class LaggingStream:
    """A play of half gap SLACK in every joint; `needs_effort` makes it as blind without efforts as such a model is."""

    def __init__(self, needs_effort: bool) -> None:
        self._needs_effort = needs_effort
        self._joints: FloatArray | None = None
        self._time = -np.inf

    def reset(self) -> None:
        """Forget the past."""
        self._joints, self._time = None, -np.inf

    def correct(self, time: float, q: FloatArray, effort: FloatArray | None = None) -> Correction:
        """Return where the joints are."""
        if time <= self._time:
            raise DataError("time must advance from sample to sample.")
        self._time = time
        if not np.isfinite(q).all() or (self._needs_effort and effort is None):
            self._joints = None
            unknown = np.full(len(q), np.nan)
            return Correction(None, None, unknown, unknown, unknown, Reason.MISSING)
        self._joints = q if self._joints is None else np.clip(self._joints, q - SLACK, q + SLACK)
        std = np.full(len(q), 1e-3)
        return Correction(None, None, self._joints, std, 2 * std, Reason.NONE)

    def follow(self, time: float, q: FloatArray, effort: FloatArray | None = None) -> None:
        """Take note of where the joints are."""
        self.correct(time, q, effort)


@dataclass(frozen=True)
class LaggingCorrector:
    """A joint model of three joints with slack."""

    needs_effort: bool = False
    types: str = "RRP"

    def stream(self) -> LaggingStream:
        """Begin a live path."""
        return LaggingStream(self.needs_effort)

    def correct_path(self, q: FloatArray, times: FloatArray, efforts: Any, sessions: Any) -> Correction:
        """Return where the joints are along a path."""
        stream, answers = self.stream(), []
        for i, stamp in enumerate(times):
            if sessions is not None and i and sessions[i] != sessions[i - 1]:
                stream.reset()
            answers.append(stream.correct(stamp, q[i], None if efforts is None else efforts[i]))
        return Correction.stack(answers)

    def info(self) -> dict[str, Any]:
        """Return nothing of itself."""
        return {}


def lagging_joints(*, needs_effort: bool = False, digest: str = "beef") -> JointModel:
    """Return a joint model of three joints with slack."""
    return JointModel(LaggingCorrector(needs_effort), "lagging", digest)


def free_port() -> int:
    """Return a port that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def endpoint_of(port: int) -> str:
    return f"tcp/127.0.0.1:{port}"


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait until something becomes true."""
    end = time.monotonic() + PATIENT
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def end_with_parent() -> None:
    """End this child process when its parent is gone, even when the parent was killed."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def serve_store(ready: Event, settings: ServerSettings, folder: str) -> None:
    """Run in the child process: serve the active models of a store until SIGTERM."""
    end_with_parent()
    serve(None, settings, on_ready=lambda _: ready.set(), store=folder)


def serve_in_child(kind: str, gate: Event, entered: Event, ready: Event, settings: ServerSettings) -> None:
    """Run in the child process: serve a small corrector until SIGTERM."""
    end_with_parent()
    kinds = {
        "shift": ShiftCorrector,
        "gated": lambda: GatedCorrector(gate, entered),
        "faulty": FaultyCorrector,
        "joints": ShiftCorrector,
        "registered": RegisteredCorrector,
    }
    corrector = kinds[kind]()
    model = Model(corrector, id=f"{kind}-model", hash=kind.encode().hex())
    joints = lagging_joints() if kind == "joints" else None
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    with Server(model, settings, joints=joints) as server:
        ready.set()
        await_stop(stop, server.follow_store)


@dataclass(frozen=True)
class ServerProcess:
    """A server in another process."""

    process: ForkServerProcess
    endpoint: str
    gate: Event
    entered: Event

    def client(self, **options: Any) -> CorrectionClient:
        """Return a client with a patience that a loaded machine needs."""
        return CorrectionClient(self.endpoint, **{"timeout": PATIENT, "connect_timeout": PATIENT, **options})

    def exit_status(self) -> int | None:
        """Wait for the process to end and return its exit status."""
        self.process.join(PATIENT)
        return self.process.exitcode


def hang(pid: int) -> None:
    """Stop a process, and return when it stands: until each of its threads has had a turn, one may still answer."""
    os.kill(pid, signal.SIGSTOP)
    threads = Path(f"/proc/{pid}/task")
    wait_for(lambda: all(t.read_text().rpartition(")")[2].split()[0] == "T" for t in threads.glob("*/stat")))


@contextmanager
def server_process(kind: str = "shift", *, port: int | None = None, **settings: Any) -> Iterator[ServerProcess]:
    """Start a server in another process, wait until it answers, and kill it whatever happens."""
    endpoint = endpoint_of(port or free_port())
    gate, entered, ready = spawn.Event(), spawn.Event(), spawn.Event()
    arguments = (kind, gate, entered, ready, ServerSettings(endpoint=endpoint, **settings))
    with child(serve_in_child, ready, arguments) as process:
        yield ServerProcess(process, endpoint, gate, entered)


@contextmanager
def store_process(folder: Path, **settings: Any) -> Iterator[ServerProcess]:
    """Start a server of a model store in another process, as :func:`server_process` does."""
    endpoint, ready = endpoint_of(free_port()), spawn.Event()
    arguments = (ready, ServerSettings(endpoint=endpoint, **settings), str(folder))
    with child(serve_store, ready, arguments) as process:
        yield ServerProcess(process, endpoint, spawn.Event(), spawn.Event())


@contextmanager
def child(target: Any, ready: Event, arguments: tuple[Any, ...]) -> Iterator[ForkServerProcess]:
    """Run `target` in another process until the block ends."""
    process = spawn.Process(target=target, args=arguments, daemon=True)
    process.start()
    try:
        assert ready.wait(PATIENT), "the server did not start"
        yield process
    finally:
        process.kill()
        process.join(PATIENT)


def called(twist: tuple[float, ...] | None = None, **changes: Any) -> bytes:
    """Return a question of the service in CDR, as a ROS node writes it."""
    store, asked = ros_types(), replace(STAMPED, **changes)
    vector = store.types["geometry_msgs/msg/Vector3"]
    v = twist or (0.0,) * 6
    moving = store.types["geometry_msgs/msg/Twist"](vector(*v[:3]), vector(*v[3:]))
    posed = ros_pose(asked)
    kind = f"{CORRECT}_Request"
    return bytes(store.serialize_cdr(store.types[kind](posed, moving, twist is not None), kind))


@contextmanager
def stranger(endpoint: str) -> Iterator[zenoh.Session]:
    """Open a bare zenoh session without a namespace, as somebody else's program would."""
    config = client_config(ClientSettings((endpoint,)))
    config.insert_json5("namespace", "null")
    with zenoh.open(config) as session:
        yield session


def ask_bare(
    session: zenoh.Session, key: str, payload: bytes, encoding: str | None = None, attachment: bytes = b""
) -> list[zenoh.Reply]:
    """Return all replies to one bare query, asked when a server is in sight."""
    until = time.monotonic() + PATIENT
    querier = session.declare_querier(key, timeout=PATIENT)
    replies: list[zenoh.Reply] = []
    while not replies and time.monotonic() < until:
        time.sleep(0.01)
        replies = list(querier.get(payload=payload, encoding=encoding, attachment=attachment))
    return replies
