"""What it brings to count neighbouring samples, which err together, as fewer than they are.

Held-out errors of the same fit with every sample counted as one of its own (inflation 1), and with the inflation that
left-out trajectories choose: simulated debridement, random reaches of a simulated PSM, and the real wrist (its last
fifth, and a random fifth of its trajectories).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any
from unittest.mock import patch

import numpy as np
from support import print_table, real_data, save_results

from gpcorrect.calibration import run_experiment
from gpcorrect.gpr import intervals
from gpcorrect.logs import read_log
from gpcorrect.sim import debridement_log, random_reaches_log
from gpcorrect.types import CalibrationLog

PSM_SEED = 13
HEAD = ("held out", "inflation", "mm mean", "mm rmse", "deg mean", "deg rmse", "95 % covers", "fit s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, default=200)
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12])
    options = parser.parse_args()
    rows = []
    for name, log, shuffle in recordings(options.reaches, options.seeds):
        with patch.object(intervals, "INFLATIONS", (1.0,)):
            rows.append([name, *scores(log, shuffle)])
        rows.append(["", *scores(log, shuffle)])
        print(f"{name}: done", flush=True)
    print_table(HEAD, rows)
    save_results("correlated_noise", [HEAD, *rows])


def recordings(reaches: int, seeds: list[int]) -> Iterator[tuple[str, CalibrationLog, bool]]:
    for seed in seeds:
        yield f"simulated debridement, seed {seed}", debridement_log(seed, reaches=reaches), False
    yield "simulated dVRK PSM, random reaches", random_reaches_log("dvrk_psm", 60, PSM_SEED), False
    wrist = read_log(real_data("dvrk_random.csv"))
    yield "real wrist, last fifth", wrist, False
    yield "real wrist, a random fifth", wrist, True


def scores(log: CalibrationLog, shuffle: bool) -> list[Any]:
    experiment = run_experiment(log, shuffle=shuffle)
    clean = experiment.evaluation.clean
    errors: Any = experiment.evaluation.clean_errors["corrected"]
    norms = [errors[part]["norm"][leaf] for part in ("position_mm", "rotation_deg") for leaf in ("mean", "rmse")]
    chosen = ", ".join(f"{part.inflation:g}" for part in experiment.corrector.law.learned.statistics)
    return [chosen, *norms, 100 * float(np.mean(clean.coverage95)), experiment.seconds]


if __name__ == "__main__":
    main()
