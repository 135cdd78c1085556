"""An unlucky laboratory: other units, another motion's tracker, hysteresis, an arm that stayed the same."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace

import numpy as np
from drift_watch import watch
from service_bench import PATIENT

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import accepted, ran
from gpcorrect import se3
from gpcorrect.arms import raven2
from gpcorrect.calibration import (
    FitSettings,
    JointCorrector,
    evaluate_model,
    fit_corrector,
    load,
    reached,
    run_experiment,
)
from gpcorrect.cli.app import THREADS
from gpcorrect.logs import write_log
from gpcorrect.sim import debridement_log, joint_motion_log, preset
from gpcorrect.types import CalibrationLog, PoseSignal
from gpcorrect_service import CorrectionClient, ServiceError

QUICK = FitSettings(marker="none", inducing=60, clean=False, search_samples=60)
LEARNED, WATCHED = 8, 400  # reaches; those watched take 476 s
SHIFT = 2.0  # half widths of the intervals
TURN = np.array([0.0, 0.0, np.pi])  # rad
JUMP = 5e-5  # m from one tenth of a degree to the next
CENTRE = np.array([0.5, 1.5, 0.47, 0.3, 0.2, 0.4])  # rad and m: the wrist near the remote centre
POOLS = """
import sys
from gpcorrect.cli import main
sys.argv[1:] = ["--version"]
try:
    main()
except SystemExit:
    import scipy.linalg, threadpoolctl
    print(max(pool["num_threads"] for pool in threadpoolctl.threadpool_info()))
"""


def units(lab: Lab) -> Seen:
    """Ask commands in millimetres and milliseconds, and a server for paths whose times are milliseconds."""
    pose = load(lab.model).check_queries[0, :7]
    log, file, at = debridement_log(1, reaches=10, faults=False), lab.folder / "ms.csv", str(lab.folder / "ms.gpc")
    write_log(replace(log, time=1e3 * log.time), file)
    wide = [repr(float(number)) for number in pose * [1e3, 1e3, 1e3, 1, 1, 1, 1]]
    tried = [["correct", str(lab.model), "--pose", *wide], ["fit", str(file), "-o", at]]
    wrong = accepted([*tried, ["evaluate", at.replace("ms.gpc", "monday.gpc"), str(file)]])
    wrong += ran(["validate", str(file)])[0] == 0
    seen = log.tracker_cp
    rows = log.trajectory == 0
    path = np.hstack([seen.position, seen.quaternion])[rows]
    with (
        lab.server(lab.model) as (end, _),
        CorrectionClient(end, connect_timeout=PATIENT) as client,
        suppress(ServiceError),
    ):
        client.correct_path(path, 1e3 * log.time[rows])
        wrong += 1
    return Seen(5, wrong)


def another_motion(lab: Lab) -> Seen:
    """Fit what a tracker saw of another motion, and joints in degrees: each is refused."""
    log, other = debridement_log(1, reaches=10, faults=False), debridement_log(2, reaches=10, faults=False)
    rows = np.minimum(np.arange(len(log)), len(other) - 1)
    strange = PoseSignal(other.tracker_cp.position[rows], None)
    files = [lab.folder / f"{name}.csv" for name in ("another", "degrees")]
    write_log(replace(log, tracker_cp=strange), files[0])
    degrees = joint_motion_log(preset("raven2_calibration"), 6, 10.0)
    write_log(replace(degrees, external_jp=np.rad2deg(degrees.external_jp)), files[1])
    tried = [["fit", str(files[0]), "-o", str(lab.folder / "another.gpc")]]
    tried.append(["joint", "fit", str(files[1]), "-o", str(lab.folder / "degrees.gpc"), "--method", "offset"])
    return Seen(len(tried), accepted(tried))


def hysteresis(_: Lab) -> Seen:
    """Learn joints with hysteresis, which looks like a late clock: held-out truth stays, or what is shifted is said."""
    wrong, applied, seeds = 0, [], range(4)
    for seed in seeds:
        log = joint_motion_log(preset("raven2_calibration"), 10, 10.0, seed)
        found = run_experiment(log, FitSettings(method="linear", time_offset="auto"), task=JointCorrector)
        held = np.flatnonzero(np.isin(log.trajectory, np.unique(log.trajectory)[-2:]))
        truth = (log.external_jp - log.measured_jp)[held]
        kept = all((np.abs(truth - row).max(axis=1) < 1e-12).any() for row in found.evaluation.dirty.raw[::50])
        applied.append(found.fit.clocks.applied)
        wrong += not kept
    return Seen(len(seeds), wrong, f"shifts {', '.join(f'{1e3 * shift:.0f} ms' for shift in applied)}")


def drift(_: Lab) -> Seen:
    """Watch an unchanged arm through a model of eight reaches, and one that was moved: alarms where they are wrong."""
    log = debridement_log(0, reaches=LEARNED + WATCHED, faults=False)
    first = log.trajectory < LEARNED
    model = fit_corrector(log.select(first), QUICK)
    seen = evaluate_model(model, log.select(~first)).dirty
    near = seen.in_domain
    time, errors, half = seen.time[near], seen.corrected[near], seen.interval95[near]
    (quiet, votes), (shifted, _) = (watch(time, errors + shift * half, half) for shift in (0.0, SHIFT))
    note = f"{np.ptp(time):.0f} s, {quiet.votes} votes, {100 * np.mean(votes):.1f} % outside"
    return Seen(2, quiet.alarm + (not shifted.alarm), note)


def threads(_: Lab) -> Seen:
    """Begin the program in the user's environment as it is: linear algebra must have one thread, not one a core."""
    bare = {name: value for name, value in os.environ.items() if name not in THREADS}
    done = subprocess.run([sys.executable, "-c", POOLS], env=bare, capture_output=True, text=True, check=True)
    most = int(done.stdout.split()[-1])
    return Seen(1, int(most != 1), f"{most} of {os.cpu_count()} at most")


def turns(_: Lab) -> Seen:
    """Turn the tool through half a turn, where angles jump; invert poses with the wrist in the remote centre."""
    log, half_turn = debridement_log(1, reaches=10, faults=False), se3.matrix_from_rotvec(TURN)
    held = _turned(log, se3.matrix_from_quaternion(np.median(log.tracker_cp.quaternion, axis=0)).T @ half_turn)
    middle, wrong, worst = np.median(log.tracker_cp.position, axis=0), 0, 0.0
    for features in (("pose", "velocity"), ("euler", "velocity")):
        model = fit_corrector(held, replace(QUICK, features=features))
        for axis in np.eye(3):
            path = se3.matrix_from_rotvec(np.deg2rad(np.linspace(-20, 20, 401))[:, None] * axis) @ half_turn
            poses = np.hstack([np.tile(middle, (len(path), 1)), se3.quaternion_from_matrix(path)])
            answers = [model.correct(pose, np.zeros(6)).position for pose in poses]
            steps = np.abs(np.diff(answers, axis=0)).max(axis=1)
            wrong, worst = wrong + int((steps > JUMP).sum()), max(worst, float(steps.max()))
    arm = raven2("left")
    at_wrist = arm.forward(CENTRE)
    exact = at_wrist.copy()
    exact[:3, 3] -= arm.wrist(CENTRE)
    without = [not arm.solutions(pose).exists.any() for pose in (at_wrist, exact, np.eye(4))]
    return Seen(6 * 400 + len(without), wrong + sum(without), f"{1e6 * worst:.0f} um at most in a tenth of a degree")


def _turned(log: CalibrationLog, R: np.ndarray) -> CalibrationLog:
    signals = {}
    for name in ("tracker_cp", "setpoint_cp"):
        signal = getattr(log, name)
        signals[name] = PoseSignal(
            signal.position, se3.quaternion_from_matrix(se3.matrix_from_quaternion(signal.quaternion) @ R)
        )
    return replace(log, **signals)


def shared_commands(lab: Lab) -> Seen:
    """Ask which pose a command reaches, of a model so steep that two poses have one command: a wrong one called OK."""
    model = load(lab.model)
    desired = model.check_queries[:, :7]
    answers = [model.correct(pose) for pose in desired]
    back = reached(model, [[*answer.position, *answer.quaternion] for answer in answers])
    off = np.abs(back.position - desired[:, :3])
    wrong = back.in_domain & (off > back.interval95[:, :3] + 1e-6).any(axis=1)
    return Seen(len(desired), int(wrong.sum()), f"{int(back.in_domain.sum())} called OK")


SCENARIOS = (
    Scenario("other units at the commands", "believed", units),
    Scenario("a tracker of another motion, degrees", "learned from in silence", another_motion),
    Scenario("hysteresis that looks like a clock", "held-out truth shifted", hysteresis),
    Scenario("commands that two poses share", "the wrong one, called OK", shared_commands),
    Scenario("drift alarm of a model of 8 reaches", "alarms without a change, none after one", drift),
    Scenario("threads of linear algebra", "more than one", threads),
    Scenario("half a turn, and the remote centre", "jumps of corrections, poses without an inverse", turns),
)
