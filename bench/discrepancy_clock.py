"""Which clock samples were taken on, and what the servo loop comes to on it.

    python bench/discrepancy_clock.py

Recordings of 500 Hz without noise, of which every fifth sample is kept: taken early and late, only stamped so, both,
or with rows that are lost. The columns of errors are the first two motors' root mean square difference from the loop
with the true effects, urad (the effects are milliradians); where no loop is run nothing in the servo can be named.
Numbers that decide are halved and doubled.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from unittest import mock

import numpy as np
from support import ROOT, print_table

from gpcorrect.discrepancy.recording import build, servo_clock
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.settings import CLOCK
from gpcorrect.types import CalibrationLog, FloatArray

sys.path.append(str(ROOT / "tests" / "discrepancy"))
from discrepancy_core import EVERY, IN_SERVO, SERVO_MODEL
from discrepancy_core import fine as recorded

STEP = 0.01


def logs(fine: CalibrationLog) -> Iterator[tuple[str, CalibrationLog]]:
    """Yield what logs may come to, by what happened to them."""
    rng, rows = np.random.default_rng(5), np.arange(0, len(fine), EVERY)

    def taken(kept: np.ndarray) -> CalibrationLog:
        return fine.select(np.isin(np.arange(len(fine)), kept))

    def stamped(log: CalibrationLog, jitter: float) -> CalibrationLog:
        return replace(log, time=log.time + np.clip(rng.normal(0.0, jitter, len(log)), -4e-3, 4e-3))

    yield "even", taken(rows)
    for ticks in (1, 2):
        early = np.clip(rows + rng.integers(-ticks, ticks + 1, len(rows)), 0, len(fine) - 1)
        yield f"taken up to {2 * ticks} ms early or late", taken(early)
        yield f"the same, and stamped {ticks} ms so", stamped(taken(early), 1e-3 * ticks)
    for jitter in (1e-4, 3e-4, 1e-3, 3e-3):
        yield f"stamped {1e3 * jitter:g} ms early or late", stamped(taken(rows), jitter)
    yield "stamps rounded to 5 ms", replace(taken(rows), time=np.round(taken(rows).time / 0.005 + 0.3) * 0.005)
    for lost in (0.01, 0.05, 0.2):
        yield f"{100 * lost:g} % of rows lost", taken(rows[rng.random(len(rows)) > lost])
    yield "5 % lost, and stamped 1 ms early or late", stamped(taken(rows[rng.random(len(rows)) > 0.05]), 1e-3)
    for hole in (0.1, 0.3, 0.6, 1.2):
        n = round(hole / STEP)
        middles = range(300, len(rows), 800)
        yield (
            f"a hole of {hole:g} s in every motion",
            taken(np.delete(rows, [i + k for i in middles for k in range(n)])),
        )
    shaken = fine.setpoint_jp + rng.normal(0.0, 2e-4, fine.setpoint_jp.shape)
    noisy = replace(fine, setpoint_jp=shaken).select(np.isin(np.arange(len(fine)), rows))
    yield "noise of 0.2 mrad on commands, stamped 1 ms so", stamped(noisy, 1e-3)


def outcome(log: CalibrationLog) -> tuple[str, FloatArray]:
    """Return which clock the loop runs on, and the first two motors' root mean square error with the true effects."""
    scene = build_scene(log, SERVO_MODEL, np.ones(len(log), dtype=np.bool_))
    if scene.plan is None:
        return "no loop", np.full(2, np.nan)
    error = np.sqrt(np.nanmean(scene.residual(IN_SERVO)[:, :2] ** 2, axis=0))
    return ("the stamps'" if scene.stamps is not None else "an even one"), error


def main() -> None:
    """Print the table."""
    fine = recorded(runs=6)
    made = list(logs(fine))
    variants = {"as set": CLOCK}
    for field in fields(CLOCK):
        for factor, word in ((0.5, "half"), (2.0, "twice")):
            variants[f"{word} `{field.name}`"] = replace(CLOCK, **{field.name: factor * getattr(CLOCK, field.name)})
    results = {}
    for name, numbers in variants.items():
        with mock.patch.object(servo_clock, "CLOCK", numbers), mock.patch.object(build, "CLOCK", numbers):
            results[name] = [outcome(log) for _, log in made]
    rows = []
    for i, (what, _) in enumerate(made):
        clock, error = results["as set"][i]
        others = [
            f"{name}: {c}" + ("" if np.isnan(e).any() else f", {1e6 * e[0]:.0f}, {1e6 * e[1]:.0f}")
            for name, found in results.items()
            for c, e in [found[i]]
            if c != clock or not np.allclose(e, error, rtol=0.1, atol=2e-6, equal_nan=True)
        ]
        rows.append([what, clock, *(f"{1e6 * e:.0f}" for e in error), "; ".join(others)])
    print_table(["recording", "clock", "motor 1", "motor 2", "otherwise with"], rows)


if __name__ == "__main__":
    main()
