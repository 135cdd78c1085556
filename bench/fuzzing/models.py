"""Altered and forged model files: each is refused in the project's words, or answers as it did before.

A third of the changes leave digests and seal as they were, as an accident or an editor would; a third carry fresh ones,
as only this project's code makes them; a third are to the bytes of the file.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from support import ROOT

from fuzzing.mutations import BYTES, archive, places
from fuzzing.trial import FAULTS, Trial, tried
from gpcorrect.calibration import (
    LEARNERS,
    CommandCorrector,
    FitSettings,
    JointCorrector,
    ModelStore,
    PositionEstimator,
    fit_model,
    save,
)
from gpcorrect.calibration.model_file import _digest, load_any, read_parts, seal_of
from gpcorrect.calibration.poses import pose_pair
from gpcorrect.cli.console import out
from gpcorrect.cli.models import show_model
from gpcorrect.errors import GpCorrectError
from gpcorrect.sim import debridement_log, preset, random_reaches_log
from gpcorrect.types import CalibrationLog

sys.path.insert(0, str(ROOT / "tests"))
from joint_logs import joint_log

OTHERS = tuple(method for method in LEARNERS if method != "ukf")  # which is of joints only
POSES: dict[str, dict[str, Any]] = {"gp not rigid": {"method": "gp", "rigid": False}}
POSES |= {method: {"method": method} for method in OTHERS}
POSES |= {f"gp {past}": {"method": "gp", "features": ("pose", "velocity", past)} for past in ("memory", "joints")}
JOINTS = tuple(LEARNERS)
QUICK = {"inducing": 12, "search_samples": 60, "layers": (5,), "epochs": 5, "time_offset": "none"}
STREAMED = 12  # samples
STOP = 0.405  # m, short of where the last joint is sent
BEYOND = "index is out of bounds"  # says compiled code under NUMBA_BOUNDSCHECK=1
SAME = 1e-9  # m, rad: answers that differ by rounding
VALUES = (
    None,
    "x",
    "array:model",
    "",
    -1,
    0,
    1,
    7,
    0.5,
    1e300,
    -1e300,
    10**30,
    float("nan"),
    float("inf"),
    True,
    False,
)
VALUES = (*VALUES, [], [[]], {}, {"type": "Law"}, {"type": 3}, [1, "y"], [None], "x" * 10_000, [0] * 1000)


@dataclass(frozen=True)
class Model:
    """A sound model file, and a recording that it is asked about."""

    name: str
    path: Path
    log: CalibrationLog


def fuzz_models(count: int, seed: int = 0, only: str = "") -> dict[str, Any]:
    """Change every kind of model file, and the state of a store, `count` times; return what came of it, by kind."""
    with TemporaryDirectory() as folder:
        found = {m.name: change(m, count, seed) for m in models(Path(folder), only)}
        if re.search(only, "store"):
            found["store"] = change_store(Path(folder), count, seed)
    return found


def models(folder: Path, only: str = "") -> Iterator[Model]:
    """Fit a small one of every task and learner."""
    simulated = preset("raven2_left")
    frame = (*simulated.T_tracker_base.translation, *simulated.T_tracker_base.rotvec)
    reaches = random_reaches_log("raven2_left", 10, 0, faults=False, model=simulated)
    logs: dict[type[Any], CalibrationLog] = {
        CommandCorrector: debridement_log(1, reaches=10, faults=False),
        JointCorrector: stopped(joint_log(1, trajectories=8, seconds=10.0)),
        PositionEstimator: replace(reaches, meta=replace(reaches.meta, tracker_base=frame)),
    }
    wanted = [(f"pose {name}", CommandCorrector, {"marker": "none", **more}) for name, more in POSES.items()]
    wanted += [(f"joints {m}", JointCorrector, {"method": m}) for m in JOINTS]
    wanted += [(f"tool position {m}", PositionEstimator, {"method": m}) for m in OTHERS]
    for name, task, more in wanted:
        if not re.search(only, name):
            continue
        log = reaches if "joints" in more.get("features", ()) else logs[task]
        settings = FitSettings(**{**QUICK, "clean": name == "pose gp", **more})
        path = folder / f"{name.replace(' ', '_')}.gpc"
        save(fit_model(log, settings, task=task).corrector, path)
        yield Model(name, path, log.select(log.trajectory < 2))


def stopped(log: CalibrationLog) -> CalibrationLog:
    """Return a log whose last joint ends at a stop, so that its models hold one."""
    truth = np.array(log.external_jp)
    truth[:, -1] = np.minimum(truth[:, -1], STOP)
    return replace(log, external_jp=truth)


def change(model: Model, count: int, seed: int) -> dict[str, Any]:
    """Change one model file again and again; print what must not come through."""
    header, arrays = read_parts(model.path)
    whole, before = model.path.read_bytes(), answers(model.path, model.log)
    forged = model.path.with_suffix(".forged")

    def work(number: int) -> tuple[str, str]:
        rng = np.random.default_rng((seed, number))
        way = WAYS[rng.integers(len(WAYS))]
        forged.write_bytes(way(rng, header, arrays, whole))
        try:
            after = answers(forged, model.log)
        except GpCorrectError as error:
            said = BEYOND not in error.message and error.message.strip()
            return ("refused", str(error)) if said else ("traceback", f"without words, or beyond an array: {error}")
        if after.shape == before.shape and np.allclose(after, before, rtol=0, atol=SAME, equal_nan=True):
            return "same", way.__name__
        if way is forged_anew:
            return "forged", "answers as it did to the check queries, otherwise elsewhere"
        return "traceback", "it answers otherwise, and was not refused"

    return _counted(model.name, work, count)


def change_store(folder: Path, count: int, seed: int) -> dict[str, Any]:
    """Change the state of a model store again and again."""
    store = ModelStore(folder / "store")
    path = next(models(folder, "pose linear")).path
    for name in ("a", "b"):
        store.activate(store.add(path, now=0.0, name=name))
    file = folder / "store" / "store.json"
    whole = file.read_bytes()

    def work(number: int) -> tuple[str, str]:
        rng = np.random.default_rng((seed, number))
        state = json.loads(whole)
        if rng.random() < 0.7:
            change_tree(rng, state)
            text = json.dumps(state).encode()
        else:
            text = BYTES[rng.integers(len(BYTES))](rng, whole)
        file.write_bytes(text)
        try:
            names = [entry.id for entry in store.models()]
            active = store.active()
            store.history()
            if active is not None:
                store.verified(active)
            for name in names:
                store.find(name)
        except GpCorrectError as error:
            return ("refused", str(error)) if error.message.strip() else ("traceback", "an error without words")
        return "same" if json.loads(text) == json.loads(whole) else "read", ""

    return _counted("store", work, count)


def _counted(name: str, work: Any, count: int) -> dict[str, Any]:
    counts, slowest, largest = Counter[str](), Trial(0, ""), 0
    for trial in tried(work, count):
        counts[trial.outcome] += 1
        slowest, largest = max(slowest, trial, key=lambda one: one.seconds), max(largest, trial.grown)
        if trial.outcome in FAULTS:
            _report(name, trial)
    found = {**counts, "slowest s": round(slowest.seconds, 2), "most MB": largest >> 20}
    print(f"{name}: {found}; slowest was {slowest.number}, {slowest.outcome}", flush=True)
    return found


def _report(name: str, trial: Trial) -> None:
    print(
        f"{name} {trial.number}: {trial.outcome} after {trial.seconds:.1f} s: {trial.said.strip()[-900:]}", flush=True
    )


def answers(path: Path, log: CalibrationLog) -> np.ndarray[Any, Any]:
    """Load a model, describe it, measure it on a recording, and answer the beginning of a stream."""
    with np.errstate(all="ignore"):
        model = load_any(path)
        json.dumps(model.summary)
        with out.capture():
            show_model(model, "")
        model.cautions(log)
        measured = model.measure(log, np.ones(len(log), dtype=bool))
        return np.vstack([np.hstack([measured.corrected, measured.interval95]), streamed(model, log)])


def streamed(model: Any, log: CalibrationLog) -> np.ndarray[Any, Any]:
    """Return what a stream of poses or joints is answered, a row a sample; nothing of another task."""
    if isinstance(model, CommandCorrector):
        observed = pose_pair(log)[0]
        rows = observed.position if observed.quaternion is None else np.hstack([observed.position, observed.quaternion])
        stream = model.stream()
        found = [stream.correct(*row) for row in zip(log.time[:STREAMED], rows, strict=False)]
        return np.array([np.hstack([one.position, np.zeros(3), one.interval95]) for one in found])
    if not isinstance(model, JointCorrector):
        return np.zeros((0, 6))
    source, effort = model.query_path(log), log.measured_jf
    stream = model.stream()
    efforts = [None] * STREAMED if effort is None else effort
    samples = zip(log.time[:STREAMED], source, efforts, strict=False)
    return np.array([np.hstack([one.joints, one.interval95]) for one in (stream.correct(*s) for s in samples)])


def altered(rng: np.random.Generator, header: Any, arrays: Any, _: bytes) -> bytes:
    """Change a number, a word or an array, and nothing else: digests and seal stay."""
    header, arrays = deepcopy(header), dict(arrays)
    if arrays and rng.random() < 0.4:
        name = list(arrays)[rng.integers(len(arrays))]
        value = np.array(arrays[name])
        if value.size and value.dtype.kind == "f":
            value.flat[rng.integers(value.size)] *= 1 + 10.0 ** rng.integers(-12, 3)
        elif value.size:
            value.flat[rng.integers(value.size)] += 1
        arrays[name] = value
    else:
        change_tree(rng, header if rng.random() < 0.5 else header["model"])
    return archive(header, arrays)


def forged_anew(rng: np.random.Generator, header: Any, arrays: Any, _: bytes) -> bytes:
    """Change the structure, and write fresh digests and a fresh seal."""
    header, arrays = deepcopy(header), dict(arrays)
    for _ in range(rng.integers(1, 3)):
        if arrays and rng.random() < 0.4:
            change_array(rng, arrays)
        else:
            change_tree(rng, header if rng.random() < 0.1 else header["model"])
    header["digests"] = {name: _digest(np.asarray(value)) for name, value in arrays.items()}
    header["seal"] = seal_of(header)
    return archive(header, arrays)


def bytes_changed(rng: np.random.Generator, header: Any, arrays: Any, whole: bytes) -> bytes:
    """Change the bytes of the file."""
    return BYTES[rng.integers(len(BYTES))](rng, whole)


WAYS = (altered, forged_anew, bytes_changed)


def change_array(rng: np.random.Generator, arrays: dict[str, Any]) -> None:
    """Give an array another shape, type or numbers, another's place, or none."""
    names = list(arrays)
    name, other = (names[k] for k in rng.integers(len(names), size=2))
    old = np.asarray(arrays[name])
    huge = np.full(old.shape, [1e300, -1e300, np.inf, np.nan, 0.0, -1.0][rng.integers(6)])
    ways = [
        old[:-1] if old.ndim else old[None],
        old.reshape(-1),
        old[None],
        np.zeros((0, 3)),
        huge,
    ]
    ways += [arrays[other], old.T, np.concatenate([old.reshape(-1)] * 2)]
    if old.dtype.kind != "U":  # which another change may have made of it
        with np.errstate(invalid="ignore"):
            ways += [
                huge.astype(old.dtype),
                -old.astype(float),
                *(old.astype(t) for t in ("f4", "i8", "U", "c16", ">f8", "?")),
            ]
    if rng.random() < 0.1:
        del arrays[name]
    elif rng.random() < 0.1:
        arrays[f"{name}.more"] = old
    else:
        arrays[name] = ways[rng.integers(len(ways))]


def change_tree(rng: np.random.Generator, tree: Any) -> None:
    """Change a place of a JSON tree: another value, a place gone, a number scaled, a list longer, a level more."""
    spots = list(places(tree))
    if not spots:
        return
    node, key = spots[rng.integers(len(spots))]
    way, old = rng.integers(6), node[key]
    if way == 0 and isinstance(node, dict):
        del node[key]
    elif way == 1 and isinstance(old, int | float) and not isinstance(old, bool):
        node[key] = old * [-1, 0, 2, 1e6, 1e300, 1e-300][rng.integers(6)]
    elif way == 2:
        node[key] = [old]
    elif way == 3 and isinstance(old, list):
        node[key] = old + old if rng.random() < 0.5 else old[:-1]
    elif way == 4 and isinstance(node, dict):
        node[f"{key}_"] = old
    else:
        node[key] = deepcopy(VALUES[rng.integers(len(VALUES))])
