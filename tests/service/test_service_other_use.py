"""A joint model that answers another question than the one before it never takes its place unseen."""

from __future__ import annotations

import io
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue

import pytest
import zenoh
from service_support import PATIENT, endpoint_of, free_port

from gpcorrect.calibration import FitSettings, JointCorrector, ModelStore, fit_model, save
from gpcorrect.errors import ArtifactError
from gpcorrect.sim import joint_motion_log, preset
from gpcorrect_service import ServerSettings
from gpcorrect_service.crtk import BusSettings
from gpcorrect_service.crtk.bus import open_session
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.metrics import Counters
from gpcorrect_service.protocol.answer import EstimateAnswer
from gpcorrect_service.protocol.messages import MSGPACK, JointState
from gpcorrect_service.server.estimator import Estimator
from gpcorrect_service.server.models import Active, load_joint_model
from gpcorrect_service.server.requests import Clock, Request, RequestParser

USES = {"estimate": {}, "command": {"direction": "command"}, "planned": {"input_signal": "setpoint_jp"}}


@pytest.fixture(scope="module")
def joint_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Model files of the same joints: where they are, what to command, and where they are by what was commanded."""
    folder, log, made = tmp_path_factory.mktemp("uses"), joint_motion_log(preset("raven2_calibration"), 3, 4.0), {}
    for name, use in USES.items():
        made[name] = folder / f"{name}.gpc"
        settings = FitSettings(method="offset", time_offset="none", **use)
        save(fit_model(log, settings, task=JointCorrector).corrector, made[name])
    return made


@pytest.mark.parametrize("name", ["command", "planned"])
def test_only_a_model_of_reported_joints_estimates_where_they_are(joint_files: dict[str, Path], name: str) -> None:
    """Samples of the stream are refused and counted, for the other way round the error would double."""
    for file, answered in (("estimate", True), (name, False)):
        model, counters = load_joint_model(joint_files[file]), Counters()
        logger, clock = open_logger(io.StringIO()), Clock(lambda: 1.0)
        estimator = Estimator(RequestParser(Active(joints=model), ServerSettings(), logger, clock), counters)
        middle = (model.corrector.trained.low + model.corrector.trained.high) / 2
        sample = Request(
            MSGPACK.encode(JointState(10.0, tuple(middle.tolist()))), MSGPACK.encoding("joint_state"), b"", 1.0
        )
        assert (estimator.estimate(sample) is not None) == answered
        assert ("NO_MODEL" in str(counters.counts())) == (not answered)


def test_a_robot_that_listens_is_heard_by_a_server_that_connects(joint_files: dict[str, Path]) -> None:
    """`serve --robot` finds a robot that comes later; who is connected to the robot hears the estimates."""
    robot, served = endpoint_of(free_port()), endpoint_of(free_port())
    commands = (
        ("serve", "--joints", str(joint_files["estimate"]), "--robot", robot, "--endpoint", served),
        ("sim", "serve", "--machine", "raven2_calibration", "--ready", "--endpoint", robot),
    )
    heard: SimpleQueue[zenoh.Sample] = SimpleQueue()
    with ExitStack() as stack:
        for words in commands:
            process = subprocess.Popen([sys.executable, "-m", "gpcorrect", *words], stderr=subprocess.DEVNULL)
            stack.callback(process.wait, PATIENT)
            stack.callback(process.kill)
        place = BusSettings(robot, patience=4 * PATIENT)  # the simulator is compiled first
        session = stack.enter_context(open_session(place))
        callback = zenoh.handlers.Callback(heard.put, indirect=False)
        stack.enter_context(session.declare_subscriber("gpcorrect/arm1/estimate", callback))
        estimate = MSGPACK.decode(EstimateAnswer, heard.get(timeout=PATIENT).payload.to_bytes())
    assert len(estimate.joints) == 3


def test_a_model_that_answers_otherwise_is_not_activated(joint_files: dict[str, Path], tmp_path: Path) -> None:
    """The other direction and another signal are refused by the store; the description names the joints' types."""
    store = ModelStore(tmp_path / "store")
    entries = {name: store.add(path, now=0.0) for name, path in joint_files.items()}
    store.activate(entries["estimate"])
    assert store.verified(entries["estimate"]).info()["types"] == "RRP"
    for name, word in (("command", "direction command"), ("planned", "input setpoint_jp")):
        with pytest.raises(ArtifactError, match=word):
            store.activate(entries[name])
    assert store.active("joints") == entries["estimate"]
    assert [entry.id for entry in store.history("joints")] == ["estimate"]
