"""What is mixed up: files and outputs, arms, directions, two programs for one arm, going back twice, odd messages."""

from __future__ import annotations

import signal
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shutil import copy

from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import accepted, ran
from gpcorrect.calibration import FitSettings, JointCorrector, ModelStore, fit_model, load, save
from gpcorrect.logs import read_log, write_log
from gpcorrect.sim import debridement_log, joint_motion_log, preset
from gpcorrect_service.crtk import BusSettings, JointState, Pose
from gpcorrect_service.crtk.messages import Message
from gpcorrect_service.crtk.robot import Robot

DOF = 6
LEAST_SAMPLES = 50  # of a second at 100 Hz


def outputs(lab: Lab) -> Seen:
    """Name a recording, or a model, as the output of something else: nothing of it is lost."""
    folder = lab.folder / "outputs"
    folder.mkdir()
    log, model = folder / "log.csv", folder / "model.gpc"
    write_log(debridement_log(1, reaches=3, faults=False), log)
    copy(lab.model, model)
    log.with_suffix(".toml").unlink()  # as of a recording, which no simulator made
    before = {path: path.read_bytes() for path in folder.iterdir()}
    tried: list[Sequence[str]] = [
        ("fit", str(log), "-o", str(log)),
        ("joint", "fit", str(log), "-o", str(log)),
        ("joint", "rezero", str(lab.joint_model), str(log), "-o", str(log)),
        ("update", str(model), str(log), "-o", str(log)),
        ("explore", str(model), "-o", str(log)),
        ("explore", str(model), "-o", str(model)),
        ("simulate", "-o", str(log)),
        ("zigzag", "-o", str(log)),
        ("convert", str(log), str(log)),
    ]
    wrong = accepted(tried)
    lost = sum(not path.exists() or path.read_bytes() != held for path, held in before.items())
    return Seen(len(tried) + len(before), wrong + lost)


def other_use(lab: Lab) -> Seen:
    """Activate and serve models of another arm and of the other direction, by the folder and over the network."""
    folder = lab.folder / "uses"
    store = ModelStore(folder / "store")
    corrector, log = load(lab.model), joint_motion_log(preset("raven2_calibration"), 6, 10.0)
    for arm in ("PSM1", "PSM2"):
        save(replace(corrector, summary={**corrector.summary, "arm": arm}), _new(folder, arm))
        store.add(folder / f"{arm}.gpc", now=0.0)
    for direction in ("estimate", "command"):
        settings = FitSettings(method="offset", time_offset="none", direction=direction)
        joints = fit_model(log, settings, task=JointCorrector).corrector
        save(replace(joints, summary={**joints.summary, "arm": "PSM1"}), _new(folder, direction))
        store.add(folder / f"{direction}.gpc", now=0.0)
    for name in ("PSM1", "estimate"):
        store.activate(store.find(name))
    end = free_endpoint()
    with lab.program("serve", "--store", str(store.folder), "--arm", "PSM1", "--endpoint", end, ready="serving"):
        places = (("--store", str(store.folder)), ("--endpoint", end, "--arm", "PSM1"))
        tried: list[Sequence[str]] = [
            ("models", "activate", name, *place) for name in ("PSM2", "command") for place in places
        ]
        psm2, elsewhere = str(folder / "PSM2.gpc"), ("--arm", "PSM1", "--endpoint", free_endpoint())
        tried += [("serve", psm2, *elsewhere), ("prefilter", psm2, *elsewhere)]
        tried += [("serve", psm2, "--joints", str(folder / "estimate.gpc"), "--endpoint", free_endpoint())]
        wrong = accepted(tried)
    active = [entry.id for kind in ("pose", "joints") if (entry := store.active(kind))]
    return Seen(len(tried) + 1, wrong + (active != ["PSM1", "estimate"]))


def back_twice(lab: Lab) -> Seen:
    """Go back twice from the third model of a running server: what was given up must not answer again."""
    store = ModelStore(lab.folder / "back")
    oldest = lab.folder / "oldest.gpc"
    corrector = load(lab.model)
    save(replace(corrector, summary={**corrector.summary, "remarks": ["the oldest"]}), oldest)
    for path in (oldest, lab.model, lab.other_model):
        store.activate(store.add(path, now=0.0))
    end = free_endpoint()
    with lab.program("serve", "--store", str(store.folder), "--endpoint", end, ready="serving"):
        answered = [ran(["models", "rollback", "--endpoint", end])[1] for _ in range(2)]
    names = [entry.id for entry in store.history()]
    wrong = (lab.model.stem not in answered[0]) + ("oldest" not in answered[1]) + (names != ["oldest"])
    return Seen(3, wrong, f"history afterwards: {', '.join(names)}")


def two_prefilters(lab: Lab) -> Seen:
    """Start a second pre-filter, with another model, at an arm that has one: it must not stay."""
    with (
        lab.arm("--corrected") as (end, _),
        lab.program("prefilter", str(lab.model), "--endpoint", end, ready="corrects") as first,
    ):
        tried = [("prefilter", str(model), "--endpoint", end) for model in (lab.model, lab.other_model)]
        return Seen(len(tried) + 1, accepted(tried) + first.ended)


def odd_recordings(lab: Lab) -> Seen:
    """Record an arm while single odd messages come, until it is ended from outside: the recording is written."""
    wrong, endings = 0, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    with lab.arm() as (end, _), Robot(BusSettings(end), patience=60.0) as robot:
        odd: list[tuple[str, Message]] = [
            ("measured_js", JointState(robot.time, (0.1,))),
            ("measured_js", JointState(float("nan"), (0.1,) * DOF)),
            ("measured_js", JointState(robot.time, (0.1,) * DOF)),
            ("tracker_cp", Pose(robot.time, (0.1, 0.2, 0.3))),
        ]
        for number in endings:
            out = lab.folder / f"{number.name}.csv"
            with lab.program("robot", "record", "-o", str(out), "--endpoint", end, ready="recording") as recorder:
                for topic, message in odd:
                    time.sleep(0.3)
                    robot.bus.publish(topic, message)
                recorder.process.send_signal(number)
                status = recorder.process.wait(60)
            wrong += status != 0 or not out.exists() or len(read_log(out)) < LEAST_SAMPLES
    return Seen(len(endings), wrong)


def _new(folder: Path, name: str) -> Path:
    folder.mkdir(exist_ok=True)
    return folder / f"{name}.gpc"


SCENARIOS = (
    Scenario("outputs named like recordings or models", "files lost", outputs),
    Scenario("models of another arm or direction", "activated or served", other_use),
    Scenario("going back twice", "given-up models that answer again", back_twice),
    Scenario("recordings with odd messages, ended from outside", "recordings lost", odd_recordings),
    Scenario("two pre-filters of one arm", "second ones that stay", two_prefilters),
)
