"""Damaged recordings at the readers' door, and through the dry run: each is read, or refused in the project's words."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

import numpy as np

from fuzzing.examples import Example, examples
from fuzzing.trial import FAULTS, Trial, tried
from gpcorrect.calibration import with_uses
from gpcorrect.errors import GpCorrectError
from gpcorrect.logs import read_log, validate_log
from gpcorrect.logs.reader import format_of

HELD = ("crashed its reader", "did not end", "asks for more memory")  # what only the process apart kept from the user


def fuzz_readers(count: int, seed: int = 0, only: str = "") -> dict[str, Any]:
    """Damage every kind of recording `count` times; return what came of it, by kind, and print what must not come."""
    with TemporaryDirectory() as folder:
        chosen = [_Kind(example, seed) for example in examples(Path(folder)) if re.search(only, example.name)]

        def work(number: int) -> tuple[str, str]:
            return chosen[number // count].trial(number % count)

        # All kinds by one process, which loads the readers' libraries once.
        for trial in tried(work, count * len(chosen)):
            kind = chosen[trial.number // count]
            kind.take(replace(trial, number=trial.number % count))
            if trial.number % count == count - 1:
                print(f"{kind.example.name} ({format_of(kind.example.path).title}): {kind.results}", flush=True)
    return {kind.example.name: kind.results for kind in chosen}


class _Kind:
    """A kind of recording, and what came of its trials."""

    def __init__(self, example: Example, seed: int) -> None:
        self.example, self._seed = example, seed
        self._counts, self._held, self._slowest, self._largest = Counter[str](), Counter[str](), 0.0, 0
        self._whole = {target: target.read_bytes() for target in example.targets}
        outcome, said = _read(example, "keep")
        if outcome != "read":
            raise RuntimeError(f"the sound {example.name} is {outcome}: {said}")

    def trial(self, number: int) -> tuple[str, str]:
        """Damage the recording, and read it."""
        for target, (_, damaged) in _damaged(self.example, self._whole, (self._seed, number)).items():
            target.write_bytes(damaged)
        try:
            return _read(self.example, "keep" if number % 2 else "refuse")
        finally:
            self.mend()

    def mend(self) -> None:
        """Write the sound recording again."""
        for target, content in self._whole.items():
            target.write_bytes(content)

    def take(self, trial: Trial) -> None:
        """Count what came of a trial; keep the file of one that failed."""
        self._counts[trial.outcome] += 1
        self._slowest, self._largest = max(self._slowest, trial.seconds), max(self._largest, trial.grown)
        self._held.update(words for words in HELD if words in trial.said)
        if trial.outcome in FAULTS:
            self.mend()
            _report(self.example, trial, _damaged(self.example, self._whole, (self._seed, trial.number)))

    @property
    def results(self) -> dict[str, Any]:
        """Numbers of trials by outcome, those that were refused for what the process apart kept away, s and MB."""
        most = {"slowest s": round(self._slowest, 2), "most MB": self._largest >> 20}
        return {**self._counts, "held apart": sum(self._held.values()), **most}


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
