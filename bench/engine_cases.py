"""What benchmarks of other engines share: waves to follow, a log of what was done, and a table of what was said."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
from support import print_table, save_results

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.outcome.sentences import verdict_sentences
from gpcorrect.sim import Model
from gpcorrect.types import CalibrationLog, FloatArray

Question = tuple[str, str, Model, CalibrationLog]
LATER = 10.0  # s between two motions


def on(joint: int, value: FloatArray) -> FloatArray:
    """Return a value of one joint, and nothing of the others."""
    return np.where(np.arange(len(value)) == joint - 1, value, 0.0)


def waves(
    rng: np.random.Generator,
    home: FloatArray,
    reach: FloatArray,
    seconds: float,
    rate_hz: int,
    frequencies: tuple[float, float] = (0.05, 0.45),
) -> FloatArray:
    """Return joints `(m, dof)` at a controller's steps: three waves each, from rest at home within a second."""
    t, dof = np.arange(round(seconds * rate_hz) + 1) / rate_hz, len(home)
    size, phase = rng.uniform(0.1, 0.3, (dof, 3)) * reach[:, None], rng.uniform(0.0, 2.0 * np.pi, (dof, 3))
    moved = size * np.sin(2.0 * np.pi * rng.uniform(*frequencies, (dof, 3)) * t[:, None, None] + phase)
    part = np.clip(t, 0.0, 1.0)
    return home + (part**3 * (10.0 - 15.0 * part + 6.0 * part**2))[:, None] * moved.sum(axis=-1)


def stamps(motions: int, rows: int, seconds: float, log_hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, motion and session of each row of motions that are all as long."""
    motion = np.repeat(np.arange(motions), rows)
    return np.tile(np.arange(rows) / log_hz, motions) + motion * (seconds + LATER), motion, np.zeros_like(motion)


def ask(name: str, questions: Iterable[Question]) -> None:
    """Ask the workflow about each recording (what is hidden, its name, model, log), and print and keep what it says."""
    rows = []
    for hidden, right, model, log in questions:
        start = time.process_time()
        found = find_discrepancy(model, log)
        said = "; ".join(f"{e.level} {e.name} {e.joint}" for e in found.effects)
        rows.append([hidden, right or "-", str(found.level), said, time.process_time() - start])
        print(f"{hidden} ({rows[-1][-1]:.0f} s) |", *verdict_sentences(found), flush=True)
    print()
    head = ["hidden", "name", "level", "named", "processor s"]
    print_table(head, rows)
    save_results(name, {"head": head, "rows": rows})
