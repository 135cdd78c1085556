"""Which cases the blind protocol is made of: sets, numbers and seeds of each truth, and cases as files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import chain, count, islice
from pathlib import Path
from types import ModuleType

import numpy as np
import truth as numpy_truth
from discrepancy_cases import Job
from truth import write_case
from truth.spec import Case

TRUTHS = ("numpy", "mujoco")
FIRST_SEED = {"numpy": 930_000, "mujoco": 500_000}
NUMBERS = {
    "numpy": {
        "null": 300,
        "null_awkward": 300,
        "one": 1000,
        "zigzag": 200,
        "pairs": 200,
        "triples": 100,
        "outside": 300,
        "advised": 400,  # of which those that are ambiguous at first count
    },
    "mujoco": {"null": 60, "one": 120, "ahead": 48, "pairs": 40, "outside": 40},
}
SHORT = {
    "numpy": {
        "null": 3,
        "null_awkward": 2,
        "one": 6,
        "zigzag": 2,
        "pairs": 1,
        "triples": 1,
        "outside": 3,
        "advised": 2,
    },
    "mujoco": {"null": 3, "one": 8, "ahead": 1, "pairs": 1, "outside": 3},
}


def truth_named(name: str) -> ModuleType:
    """Return the package that makes recordings; ends with the reason where MuJoCo is not installed."""
    if name == "numpy":
        return numpy_truth
    try:
        import truth_mujoco
    except ImportError as error:
        raise SystemExit(f"the MuJoCo truth needs the extra: pip install 'gpcorrect[mujoco]' ({error})") from error
    return truth_mujoco


def jobs_of(arguments: argparse.Namespace) -> Iterator[Job]:
    """Yield the cases that are asked for, of one truth or both."""
    names = TRUTHS if arguments.truth == "both" else (arguments.truth,)
    asked = {suite for name in names for suite in arguments.suite or NUMBERS[name]}
    if unknown := asked - {suite for name in names for suite in NUMBERS[name]}:
        raise SystemExit(f"{', '.join(sorted(unknown))}: no set of --truth {arguments.truth}")
    return chain.from_iterable(_jobs_of(name, arguments) for name in names)


def _jobs_of(name: str, arguments: argparse.Namespace) -> Iterator[Job]:
    """Yield the cases of one truth: of each set evenly spread ones, so that every effect and size has its share.

    Sets take turns, so that a run that is stopped has seen something of all.
    """
    turns, numbers, module = [], NUMBERS[name], truth_named(name)
    first = FIRST_SEED[name] if arguments.first_seed is None else arguments.first_seed
    for suite in [s for s in arguments.suite or numbers if s in numbers]:
        few = arguments.short and arguments.share is None
        number = SHORT[name][suite] if few else max(1, round((arguments.share or 1.0) * numbers[suite]))
        offsets = range(number) if few else (i * numbers[suite] // number for i in range(number))
        large = (s for s in count(first) if _size(module, suite, s) >= (arguments.least_ratio))
        seeds = list(islice(large, numbers[suite]))
        turns += [((i + 0.5) / number, suite, seeds[o]) for i, o in enumerate(offsets)]
    every = arguments.baselines_every
    for turn, (_, suite, seed) in enumerate(sorted(turns)):
        spec, _ = next(module.specs(suite, 1, seed))
        baselines = every > 0 and turn % every == 0
        yield Job(module.short(spec) if arguments.short else spec, seed, baselines)


def _size(module: ModuleType, suite: str, seed: int) -> float:
    """Return the size over the noise at which a set has its seed; infinite where nothing is hidden."""
    spec, _ = next(module.specs(suite, 1, seed))
    return float(spec.ratio) if spec.hidden else np.inf


def write_files(job: Job, case: Case, folder: Path) -> None:
    """Write log, model and labels, and of a MuJoCo case the arm as a robot file."""
    write_case(case, folder, folder / "labels.json")
    if job.truth == "mujoco":
        from truth_mujoco.arms import ARMS
        from truth_mujoco.body import robot_xml

        arm = ARMS[job.spec.arm]
        gravity = np.array(case.nominal.get("gravity", arm.gravity))
        (folder / "robot.xml").write_text(robot_xml(arm, gravity), encoding="utf-8")
