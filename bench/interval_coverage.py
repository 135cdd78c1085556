"""Are the intervals honest? Share of errors inside their 95 % intervals, an axis each, on trajectories never seen.

Simulated debridement (the simulator's RAVEN II, clean samples), simulated reaches with noise that neighbours share, and
the real wrist, where every fifth of the trajectories is held out in turn. Then the same learned from few trajectories
(`--few 8 16`), where a model is most easily too sure of itself; of the real wrist these are trajectories in a row, and
those that follow are asked.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from correct_latency import as_log
from residual_field import simulate_reaches
from support import print_table, real_data, save_results

from gpcorrect.calibration import COMPONENTS, FitSettings, evaluate_model, fit_corrector
from gpcorrect.logs import read_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray

FIFTHS = 5
ASKED = 24  # trajectories that those who learned from few are asked about
ASKED_WRIST = 8
POSE, JOINTS = ("pose", "velocity"), ("pose", "velocity", "joints")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, default=150)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--few", type=int, nargs="*", default=[8, 16], help="numbers of trajectories to learn from")
    parser.add_argument("--only-few", action="store_true", help="leave the long recordings out")
    options = parser.parse_args()
    rows = []
    cases = [] if options.only_few else list(long_cases(options.reaches, options.seeds))
    for name, runs in (*cases, *few_cases(options.few, options.seeds)):
        shares = [coverage(*run) for run in runs]
        rows.append([name, *np.mean(shares, axis=0), float(np.mean(shares))])
        print(f"{name}: {len(shares)} fits, {rows[-1][-1]:.1f} % covered", flush=True)
    print_table(["95 % intervals cover [%]", *COMPONENTS, "mean"], rows)
    save_results("interval_coverage", rows)


Run = tuple[CalibrationLog, BoolArray, FitSettings]


def long_cases(count: int, seeds: int) -> Iterator[tuple[str, Iterator[Run]]]:
    yield "simulated debridement", debridement(count, seeds)
    yield "simulated reaches, correlated noise", reaches(count, seeds)
    yield "real wrist, five fifths", real(FitSettings(features=POSE))
    yield "real wrist, five fifths, joints", real(FitSettings(features=JOINTS))


def few_cases(numbers: list[int], seeds: int) -> Iterator[tuple[str, Iterator[Run]]]:
    for count in numbers:
        yield f"simulated debridement, {count} reaches", debridement(count + ASKED, seeds, ASKED)
        yield f"simulated reaches, {count} of them", reaches(count + ASKED, seeds, ASKED)
        yield f"real wrist, {count} trajectories", real_few(count)


def last(log: CalibrationLog, asked: int | None) -> BoolArray:
    """Mask of the last trajectories: so many, or a fifth."""
    ids = log.trajectory_ids
    return np.isin(log.trajectory, ids[-(asked or len(ids) // FIFTHS) :])


def real_few(count: int) -> Iterator[Run]:
    log = read_log(real_data("dvrk_random.csv"))
    ids = log.trajectory_ids
    for first in range(0, len(ids) - count - ASKED_WRIST + 1, ASKED_WRIST):
        rows = np.isin(log.trajectory, ids[first : first + count + ASKED_WRIST])
        part = log.select(rows)
        yield part, last(part, ASKED_WRIST), FitSettings()


def coverage(log: CalibrationLog, held: BoolArray, settings: FitSettings) -> FloatArray:
    corrector = fit_corrector(log.select(~held), settings)
    return 100 * evaluate_model(corrector, log.select(held)).clean.coverage95


def debridement(count: int, seeds: int, asked: int | None = None) -> Iterator[Run]:
    for seed in range(seeds):
        log = debridement_log(seed, reaches=count)
        yield log, last(log, asked), FitSettings()


def reaches(count: int, seeds: int, asked: int | None = None) -> Iterator[Run]:
    for seed in range(seeds):
        log = as_log(simulate_reaches(count, 64, np.random.default_rng(seed), noise_correlation=0.9))
        yield log, last(log, asked), FitSettings(marker="none")


def real(settings: FitSettings) -> Iterator[Run]:
    log = read_log(real_data("dvrk_random.csv"))
    parts = np.array_split(log.trajectory_ids, FIFTHS)
    for part in parts:
        yield log, np.isin(log.trajectory, part), settings


if __name__ == "__main__":
    main()
