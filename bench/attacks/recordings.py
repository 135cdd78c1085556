"""What a laboratory gets wrong with its recordings: units, clocks, orders, too few motions, copies, damaged files."""

from __future__ import annotations

import zipfile
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from fuzzing.mutations import archive, places
from scipy.io import savemat
from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen, refuses
from attacks.programs import accepted
from gpcorrect.calibration import FitSettings, evaluate_model, fit_model, load
from gpcorrect.calibration.model_file import _digest, load_any, read_parts, seal_of
from gpcorrect.cli.reading import read_logs
from gpcorrect.errors import ArtifactError
from gpcorrect.logs import match_clocks, validate_log, write_log
from gpcorrect.sim import debridement_log, random_reaches_log
from gpcorrect.types import CalibrationLog, PoseSignal

REACHES = 20
COUNTS = (8, 6, 4, 3, 2, 1)  # motions
FORGED = 300
TYPE = 176  # place of the type of the first variable's numbers in a MATLAB 5 file
KINDS = (20, 100, 255)  # types that do not exist
VALUES = (None, "x", "array:model", -1, 0, 1e300, 10**30, [], [[]], {}, {"type": "Law"}, True, [1, "y"])


def units(lab: Lab) -> Seen:
    """Ask in millimetres and milliseconds: poses, paths, streams and logs."""
    corrector, log = load(lab.model), debridement_log(7, reaches=3, faults=False)
    seen = log.tracker_cp
    path, time = np.hstack([seen.position, seen.quaternion])[log.trajectory == 0], log.time[log.trajectory == 0]
    wide = path * np.array([1e3, 1e3, 1e3, 1, 1, 1, 1])
    stream = corrector.stream()
    tried = (
        lambda: corrector.correct(wide[0]),
        lambda: corrector.correct_path(wide, time),
        lambda: corrector.correct_path(path, 1e3 * time),
        lambda: [stream.correct(1e3 * t, pose) for t, pose in zip(time, path, strict=True)],
        lambda: evaluate_model(corrector, replace(log, time=1e3 * log.time)),
    )
    return Seen(len(tried), sum(not refuses(question) for question in tried))


def orders(_: Lab) -> Seen:
    """Read quaternions in another order, and recordings with faults that are right."""
    tried, wrong = 0, 0
    for seed in range(4):
        log = debridement_log(seed, reaches=REACHES)
        for first in range(0, REACHES, 5):
            part = log.select((log.trajectory >= first) & (log.trajectory < first + 5))
            tried, wrong = tried + 1, wrong + (not validate_log(part).ok)
        tried, wrong = tried + 2, wrong + (not validate_log(log).ok) + validate_log(_misread(log)).ok
    return Seen(tried, wrong, "in pieces of five reaches, whole, and whole as xyzw")


def _misread(log: CalibrationLog) -> CalibrationLog:
    seen = log.tracker_cp
    return replace(log, tracker_cp=PoseSignal(seen.position, np.roll(seen.quaternion, -1, axis=1)))


def few_motions(_: Lab) -> Seen:
    """Fit one to eight motions: fewer than 90 % of the errors on others inside the intervals, or nothing said."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(_fitted_to_few, COUNTS))
    wrong = sum(covered < 0.9 or not said for covered, said in found)
    return Seen(len(COUNTS), wrong, f"covered {', '.join(f'{100 * covered:.0f} %' for covered, _ in found)}")


def _fitted_to_few(count: int) -> tuple[float, bool]:
    """Return the part of the errors on others that is inside the intervals, and whether few motions are said."""
    log = debridement_log(3, reaches=40, faults=False)
    others = log.select(log.trajectory >= 20)
    result = fit_model(log.select(log.trajectory < count), FitSettings(inducing=60))
    measured = result.corrector.measure(others, np.ones(len(others), dtype=bool))
    inside = np.abs(measured.corrected) <= measured.interval95
    return float(inside.mean()), any("widened" in remark for remark in result.remarks)


def clocks(_: Lab) -> Seen:
    """Ask for the clock of two or three reaches that have none of their own: a shift."""
    asked = [(n, seed) for n in (2, 3) for seed in range(100, 108)]
    logs = [debridement_log(seed, reaches=n) for n, seed in asked]
    logs += [random_reaches_log(seed=seed, n_trajectories=n) for n, seed in asked]
    return Seen(len(logs), sum(match_clocks(log, "tracker_cp", "setpoint_cp", "auto")[1].applied != 0 for log in logs))


def copies(lab: Lab) -> Seen:
    """Give a recording twice, and measure a model on what it was made from."""
    files = [lab.folder / "first.csv", lab.folder / "copy.csv"]
    log = debridement_log(1, reaches=10, faults=False)
    for file in files:
        write_log(log, file)
    corrector = fit_model(read_logs(files[:1]), FitSettings(method="offset")).corrector
    quiet = not any("made from" in caution for caution in evaluate_model(corrector, read_logs(files[1:])).cautions)
    return Seen(2, (not refuses(lambda: read_logs(files))) + quiet)


def forgeries(lab: Lab) -> Seen:
    """Change the structure of a model file under a fresh seal, and arrays into none: anything but a refusal."""
    rng, file, wrong = np.random.default_rng(0), lab.folder / "forged.gpc", 0
    whole, arrays = read_parts(lab.model)
    for _ in range(FORGED):
        header = deepcopy(whole)
        spots = list(places(header["model"]))
        node, key = spots[rng.integers(len(spots))]
        node[key] = VALUES[rng.integers(len(VALUES))]
        file.write_bytes(archive({**header, "seal": seal_of(header)}, arrays))
        wrong += _raises_raw(file)
    for name in arrays:
        with zipfile.ZipFile(lab.model) as sound, zipfile.ZipFile(file, "w") as out:
            for part in sound.namelist():
                out.writestr(part, b"no array" if part == f"{name}.npy" else sound.read(part))
        wrong += _raises_raw(file)
    return Seen(FORGED + len(arrays), wrong)


def _raises_raw(file: Path) -> bool:
    try:
        load_any(file)
    except ArtifactError:
        pass
    except Exception:  # noqa: BLE001  # what must not come through
        return True
    return False


def misfits(lab: Lab) -> Seen:
    """Serve models under a fresh seal that correct a joint which is not there, or whose arrays are of other sizes."""
    poses, joints = read_parts(lab.model)[1], read_parts(lab.joint_model)[1]
    forged = [
        (lab.model, name, np.concatenate([array] * 3, axis=-1))
        for name, array in poses.items()
        if ".predictor.parts.0." in name
    ]
    forged += [(lab.joint_model, "model.view.moving", joints["model.view.moving"] + 1)]
    tried = []
    for k, (model, name, array) in enumerate(forged):
        header, arrays = read_parts(model)
        header["digests"][name] = _digest(array)
        file = lab.folder / f"misfit{k}.gpc"
        file.write_bytes(archive({**header, "seal": seal_of(header)}, {**arrays, name: array}))
        option = ["--joints"] if model == lab.joint_model else []
        tried.append(["serve", *option, str(file), "--endpoint", free_endpoint()])
    return Seen(len(forged), accepted(tried))


def damaged(lab: Lab) -> Seen:
    """Look into MATLAB files whose numbers are of a type that does not exist, which crash SciPy's reader."""
    savemat(lab.folder / "whole.mat", {"time": np.arange(30.0)})
    whole, tried = (lab.folder / "whole.mat").read_bytes(), []
    for kind in KINDS:
        file = lab.folder / f"damaged{kind}.mat"
        file.write_bytes(whole[:TYPE] + bytes([kind]) + whole[TYPE + 1 :])
        tried += [("topics", str(file)), ("validate", str(file))]
    return Seen(len(tried), accepted(tried))


SCENARIOS = (
    Scenario("millimetres and milliseconds", "believed", units),
    Scenario("orders of quaternions", "wrong ones passed, right recordings refused", orders),
    Scenario("few motions", "intervals that do not hold, or nothing said", few_motions),
    Scenario("clocks of few reaches", "shifted", clocks),
    Scenario("copies", "measured on as if they were new", copies),
    Scenario("forged model files", "errors other than a refusal", forgeries),
    Scenario("models that do not fit together", "served, or ended by a traceback", misfits),
    Scenario("damaged recordings", "crashes and tracebacks of the commands that look into them", damaged),
)
