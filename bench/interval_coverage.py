"""Are the intervals honest? Share of errors inside their 95 % intervals, an axis each, on trajectories never seen.

Simulated debridement (the simulator's RAVEN II, clean samples), simulated reaches with noise that neighbours share, and
the real wrist, where every fifth of the trajectories is held out in turn.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from correct_latency import as_log
from residual_field import simulate_reaches
from support import print_table, real_data, save_results

from gpcorrect.corrector import FitSettings, fit_corrector
from gpcorrect.experiment import COMPONENTS, evaluate
from gpcorrect.logs import read_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray

FIFTHS = 5
ALL = ("pose", "velocity", "memory")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, default=150)
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    rows = []
    for name, cases in (
        ("simulated debridement", debridement(options.reaches, options.seeds)),
        ("simulated reaches, correlated noise", reaches(options.reaches, options.seeds)),
        ("real wrist, five fifths", real(FitSettings())),
        ("real wrist, five fifths, memory", real(FitSettings(features=ALL))),
    ):
        shares = [coverage(*case) for case in cases]
        rows.append([name, *np.mean(shares, axis=0)])
        print(f"{name}: {len(shares)} fits done", flush=True)
    print_table(["95 % intervals cover [%]", *COMPONENTS], rows)
    save_results("interval_coverage", rows)


def coverage(log: CalibrationLog, held: BoolArray, settings: FitSettings) -> FloatArray:
    corrector = fit_corrector(log.select(~held), settings)
    shares: FloatArray = 100 * evaluate(corrector, log.select(held)).clean.coverage95
    return shares


def debridement(count: int, seeds: int) -> Iterator[tuple[CalibrationLog, BoolArray, FitSettings]]:
    for seed in range(seeds):
        log = debridement_log(seed, reaches=count)
        yield log, log.trajectory >= np.quantile(log.trajectory_ids, 0.8), FitSettings()


def reaches(count: int, seeds: int) -> Iterator[tuple[CalibrationLog, BoolArray, FitSettings]]:
    for seed in range(seeds):
        log = as_log(simulate_reaches(count, 64, np.random.default_rng(seed), noise_correlation=0.9))
        yield log, log.trajectory >= np.quantile(log.trajectory_ids, 0.8), FitSettings(marker="none")


def real(settings: FitSettings) -> Iterator[tuple[CalibrationLog, BoolArray, FitSettings]]:
    log = read_log(real_data("dvrk_random.csv"))
    parts = np.array_split(log.trajectory_ids, FIFTHS)
    for part in parts:
        yield log, np.isin(log.trajectory, part), settings


if __name__ == "__main__":
    main()
