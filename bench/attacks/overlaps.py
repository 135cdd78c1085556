"""Recordings that are not what they are taken for: parts of others, commands and reports exchanged, another arm's."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from attacks.lab import Lab, Scenario, Seen, refuses
from attacks.programs import ran
from gpcorrect import se3
from gpcorrect.calibration import FitSettings, evaluate_model, fit_model, load, run_experiment, update_model
from gpcorrect.cli.reading import read_logs
from gpcorrect.errors import LogError
from gpcorrect.logs import join_logs, read_log, refuse_misread, validate_log, write_log
from gpcorrect.logs.columns import BagOptions
from gpcorrect.logs.topics import choose_topics
from gpcorrect.sim import debridement_log, random_reaches_log
from gpcorrect.types import PoseSignal

QUICK = FitSettings(method="offset", time_offset="none", clean=False, marker="none", features=("pose", "velocity"))
POSE, JOINTS = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"
MOVED = (
    ((0.0, 0.0, 0.35), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
    ((0.0, 1.57, 0.0), (0.0, 0.0, 0.0)),
)  # rad, m
KNOWN = "knows the answers"


def parts(lab: Lab) -> Seen:
    """Measure on parts of the training, on files that hold it among others, and on motions that come twice."""
    one, two, new = (debridement_log(seed, reaches=6, faults=False) for seed in (1, 2, 3))
    names = ("monday", "both", "late", "few", "doubled", "new")
    later = np.arange(2 * len(one)) >= len(one)
    doubled = one.select(np.tile(np.arange(len(one)), 2))
    doubled = replace(doubled, trajectory=doubled.trajectory + 99 * later, time=doubled.time + 1e4 * later)
    made = (one, join_logs([one, two]), one.select(one.trajectory > 3), replace(one, measured_cp=None), doubled, new)
    files = [lab.folder / f"{name}.csv" for name in names]
    for log, file in zip(made, files, strict=True):
        write_log(log, file)
    corrector = fit_model(read_logs(files[:1]), QUICK).corrector
    cautious = [any(KNOWN in said for said in evaluate_model(corrector, read_log(file)).cautions) for file in files]
    refused = [refuses(partial(read_logs, [files[0], file]), LogError) for file in files[1:]]
    held = run_experiment(doubled, QUICK).evaluation
    wrong = (
        cautious != [True] * 5 + [False],
        refused != [True] * 4 + [False],
        held is None or KNOWN not in held.first[0],
    )
    return Seen(len(cautious) + len(refused) + 1, sum(wrong))


def exchanged(_: Lab) -> Seen:
    """Exchange what was commanded and what was reported by a robot that lags; recordings as they are must pass."""
    late = [debridement_log(seed, reaches=10) for seed in range(3)]
    stiff = [random_reaches_log("dvrk_psm", 6, seed, faults=False) for seed in range(2)]
    wrong = sum(bool(validate_log(log, ["exchanged"]).findings) for log in (*late, *stiff))
    swapped = [replace(log, setpoint_cp=log.measured_cp, measured_cp=log.setpoint_cp) for log in late]
    wrong += sum(not refuses(partial(refuse_misread, log), LogError) for log in swapped)
    return Seen(2 * len(late) + len(stiff), wrong)


def moved_tracker(lab: Lab) -> Seen:
    """Update a model with recordings of a tracker that was turned or moved meanwhile: learned as the robot's error."""
    model, log = load(lab.model), debridement_log(7, reaches=6, faults=False)
    seen, wrong = log.tracker_cp, 0
    for turn, shift in MOVED:
        R = se3.matrix_from_rotvec(np.array(turn))
        turned = se3.quaternion_from_matrix(R @ se3.matrix_from_quaternion(seen.quaternion))
        moved = replace(log, tracker_cp=PoseSignal(seen.position @ R.T + shift, turned))
        wrong += not refuses(partial(update_model, model, moved), LogError)
    return Seen(len(MOVED), wrong)


def other_arms(_: Lab) -> Seen:
    """Choose an arm of recordings in which a tracker saw the other one."""
    topics = {f"/{arm}/{name}": POSE for arm in ("PSM1", "PSM2") for name in ("setpoint_cp", "measured_cp")}
    topics |= {f"/{arm}/measured_js": JOINTS for arm in ("PSM1", "PSM2")}
    seen = ({"/PSM2/tracker_cp": POSE}, {"/PSM2/marker": POSE}, {"/PSM1/tracker_cp": POSE, "/PSM2/tracker_cp": POSE})
    found = [choose_topics(topics | more, BagOptions(namespace="PSM1"))[0].get("tracker_cp", "") for more in seen]
    return Seen(len(found), sum("PSM2" in topic for topic in found))


def two_places(lab: Lab) -> Seen:
    """Name one robot by its address or namespace, and another by a configuration: the commands that follow one."""
    file = lab.folder / "lab2.json5"
    file.write_text('{mode: "client", namespace: "lab2", connect: {endpoints: ["tcp/127.0.0.1:1"]}}')
    asked = [
        [*words, "--config", str(file), *place]
        for words in (["query", "health"], ["robot", "state"], ["models", "state", "PAUSED"])
        for place in (["--endpoint", "tcp/127.0.0.1:2"], ["--namespace", "lab1"])
    ]
    answers = [ran(words)[1] for words in asked]
    return Seen(len(asked), sum("Give" not in text for text in answers))


SCENARIOS = (
    Scenario("parts of recordings", "measured on as if they were new, or refused though new", parts),
    Scenario("commands and reports exchanged", "learned from, or right recordings refused", exchanged),
    Scenario("a tracker that was moved", "learned as the robot's error by update", moved_tracker),
    Scenario("a tracker of the other arm", "taken for this one's", other_arms),
    Scenario("two places at once", "one of them followed without a word", two_places),
)
