"""Damaged recordings at the readers' door, and through the dry run: each is read, or refused in the project's words."""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

import numpy as np

from fuzzing.examples import Example, examples
from fuzzing.trial import FAULTS, Trial, tried
from gpcorrect.calibration import with_uses
from gpcorrect.errors import GpCorrectError
from gpcorrect.logs import read_log, validate_log

HELD = ("crashed its reader", "did not end", "asks for more memory")  # what only the process apart kept from the user


def fuzz_readers(count: int, seed: int = 0, only: str = "") -> dict[str, Any]:
    """Damage every kind of recording `count` times; return what came of it, by kind."""
    results = {}
    with TemporaryDirectory() as folder:
        for example in examples(Path(folder)):
            if only in example.name:
                results[example.name] = damage(example, count, seed)
                print(f"{example.name}: {results[example.name]}", flush=True)
    return results


def damage(example: Example, count: int, seed: int) -> dict[str, Any]:
    """Damage one recording again and again; print what must not come through."""
    counts, held, slowest, largest = Counter[str](), Counter[str](), 0.0, 0
    whole = {target: target.read_bytes() for target in example.targets}
    outcome, said = _read(example, "keep")
    if outcome != "read":
        raise RuntimeError(f"the sound {example.name} is {outcome}: {said}")

    def work(number: int) -> tuple[str, str]:
        for target, (_, damaged) in _damaged(example, whole, (seed, number)).items():
            target.write_bytes(damaged)
        try:
            return _read(example, "keep" if number % 2 else "refuse")
        finally:
            for target, content in whole.items():
                target.write_bytes(content)

    for trial in tried(work, count):
        counts[trial.outcome] += 1
        slowest, largest = max(slowest, trial.seconds), max(largest, trial.grown)
        held.update(words for words in HELD if words in trial.said)
        if trial.outcome in FAULTS:
            _report(example, trial, _damaged(example, whole, (seed, trial.number)))
    for target, content in whole.items():
        target.write_bytes(content)
    return {**counts, "held apart": sum(held.values()), "slowest s": round(slowest, 2), "most MB": largest >> 20}


def _damaged(example: Example, whole: dict[Path, bytes], seed: tuple[int, int]) -> dict[Path, tuple[str, bytes]]:
    """Draw what is damaged, in which way, and what comes of it."""
    rng = np.random.default_rng(seed)
    target = example.targets[rng.integers(len(example.targets))]
    way = example.ways[rng.integers(len(example.ways))]
    return {target: (way.__name__, way(rng, whole[target]))}


def _read(example: Example, disorder: Any) -> tuple[str, str]:
    warnings.simplefilter("ignore")
    try:
        log = read_log(example.path, columns=example.columns, disorder=disorder, arm=example.arm)
        if disorder == "keep":  # as the dry run reads
            with_uses(validate_log(log), log)
    except GpCorrectError as error:
        if not error.message.strip():
            return "traceback", "an error without words"
        return "refused", str(error)
    return "read", ""


def _report(example: Example, trial: Trial, damaged: dict[Path, tuple[str, bytes]]) -> None:
    for target, (way, content) in damaged.items():
        kept = Path(gettempdir()) / f"fuzz_{example.name.replace(' ', '_')}_{trial.number}{target.suffix}"
        kept.write_bytes(content)
        print(f"{kept} ({way}): {trial.outcome} after {trial.seconds:.1f} s: {trial.said.strip()[-900:]}", flush=True)
