"""Does the monitor's drift alarm keep its promise for models of few reaches? An unchanged simulated arm, hours of it.

A model is learned from the first reaches of a simulated debridement (`--learned 8`), and the monitor's test watches all
that follow, with nothing changed. The alarm promises no more than one false alarm in 10^5 votes (seconds). A row shows
the votes, how many said "outside" (the promise holds as long as at most a tenth do), the largest evidence, and whether
there was an alarm. The last column is the same test after a shift of the arm by twice the learned interval: it must
rise.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from support import print_table, save_results

from gpcorrect.calibration import FitSettings, evaluate_model, fit_corrector
from gpcorrect.sim import debridement_log
from gpcorrect.types import FloatArray
from gpcorrect_service.monitor.drift import SETTINGS, DriftWatch, outside

HEAD = ("learned from", "seed", "seconds", "votes", "outside [%]", "largest evidence", "alarm", "alarm after a shift")
SHIFT = 2.0  # half widths of the 95 % intervals


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--learned", type=int, nargs="*", default=[8, 30], help="reaches that models are learned from")
    options.add_argument("--watched", type=int, default=150, help="reaches that are watched")
    options.add_argument("--seeds", type=int, default=4)
    given = options.parse_args()
    rows = [watched(learned, given.watched, seed) for learned in given.learned for seed in range(given.seeds)]
    print_table(HEAD, rows)
    save_results("drift_watch", [HEAD, *rows])


def watched(learned: int, count: int, seed: int) -> list[Any]:
    """Return a row: a model of so many reaches, watched over the reaches after them."""
    log = debridement_log(seed, reaches=learned + count, faults=False)
    first = np.isin(log.trajectory, log.trajectory_ids[:learned])
    corrector = fit_corrector(log.select(first), FitSettings(seed=seed))
    seen = evaluate_model(corrector, log.select(~first)).dirty
    near = seen.in_domain
    time, errors, half = seen.time[near], seen.corrected[near], seen.interval95[near]
    quiet, shares = watch(time, errors, half)
    shifted, _ = watch(time, errors + SHIFT * half, half)
    row = [learned, seed, f"{np.ptp(time):.0f}", quiet.votes, f"{100 * np.mean(shares):.1f}"]
    return [*row, f"{max_evidence(shares):.3g}", quiet.alarm, shifted.alarm]


def watch(time: FloatArray, errors: FloatArray, half: FloatArray) -> tuple[DriftWatch, list[bool]]:
    """Return the monitor's test after these samples, and its votes."""
    votes: list[bool] = []

    class Watch(DriftWatch):
        def _vote(self, outside: bool) -> None:
            votes.append(outside)
            super()._vote(outside)

    test = Watch()
    for stamp, miss, width in zip(time.tolist(), errors.tolist(), half.tolist(), strict=True):
        test.see(stamp, outside(miss, width))
    return test, votes


def max_evidence(votes: list[bool]) -> float:
    """Return the largest evidence that the votes came to."""
    level = largest = 1.0
    for vote in votes:
        usual, changed = SETTINGS.usual, SETTINGS.changed
        level = max(level, 1.0) * (changed / usual if vote else (1.0 - changed) / (1.0 - usual))
        largest = max(largest, level)
    return largest


if __name__ == "__main__":
    main()
