"""Measure cleaning on planted faults: which share is found, and which share of good samples is rejected with them.

Each fault is planted in simulated reaches whose arm misses smoothly (10 mm, 8 degrees), drags with velocity, has play
and noise. "labelled by training" learns on the first 70 % of the trajectories, without faults, and labels the others,
with them. "simulated faults" are those of `gpcorrect simulate debridement`, in few reaches.

    python bench/cleaning_faults.py --seeds 3
    python bench/cleaning_faults.py --seeds 10 --only simulated
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from support import ROOT, print_table, save_results

from gpcorrect.cleaning import clean_with, fit_cleaner
from gpcorrect.sim import debridement_log
from gpcorrect.types import BoolArray, CalibrationLog

# The tests' own worlds.
sys.path.insert(0, str(ROOT / "tests" / "cleaning"))
from cleaning_synthetic import FAULTS, Faulty, World, make_log

TRAIN_SHARE = 0.7
CLEANING_SEED = 1
HEAD = ("fault", "recall", "worst", "false rejection", "worst")
Plant = Callable[[CalibrationLog, np.random.Generator], Faulty]


def no_fault(log: CalibrationLog, rng: np.random.Generator) -> Faulty:
    """Leave the log as it is."""
    return log, np.zeros(len(log), dtype=bool)


def shares(keep: BoolArray, faulty: BoolArray) -> tuple[float, float]:
    """Recall (NaN without faults) and false rejection."""
    recall = float((~keep)[faulty].mean()) if faulty.any() else float("nan")
    return recall, float((~keep)[~faulty].mean())


def cleaned(plant: Plant, world: World, seed: int) -> tuple[float, float]:
    """Clean a log that holds the fault."""
    rng = np.random.default_rng(seed)
    log, faulty = plant(make_log(world, rng), rng)
    return shares(fit_cleaner(log, rng=np.random.default_rng(CLEANING_SEED))[1].keep, faulty)


def labelled_by_training(plant: Plant, world: World, seed: int) -> tuple[float, float]:
    """Learn on clean trajectories, and judge held-out ones that hold the fault."""
    rng = np.random.default_rng(seed)
    log = make_log(world, rng)
    early = log.trajectory < TRAIN_SHARE * world.reaches
    cleaner, _ = fit_cleaner(log.select(early), rng=np.random.default_rng(CLEANING_SEED))
    held_out, faulty = plant(log.select(~early), rng)
    return shares(clean_with(cleaner, held_out).keep, faulty)


def simulated(reaches: int, seed: int) -> tuple[float, float]:
    """Clean a simulated debridement recording; faulty is what differs from the same recording without faults."""
    log, whole = (debridement_log(seed, reaches=reaches, faults=faults) for faults in (True, False))
    same = np.isclose(log.tracker_cp.position, whole.tracker_cp.position, rtol=0, atol=1e-9).all(axis=1)
    same &= np.isclose(log.tracker_cp.quaternion, whole.tracker_cp.quaternion, rtol=0, atol=1e-9).all(axis=1)
    return shares(fit_cleaner(log, rng=np.random.default_rng(CLEANING_SEED))[1].keep, ~same)


def measured(run: Callable[[int], tuple[float, float]], seeds: int) -> dict[str, float]:
    """Medians and worst cases over the seeds."""
    recall, false = np.array([run(seed) for seed in range(seeds)]).T
    return {
        "recall": float(np.median(recall)),
        "worst_recall": float(recall.min()),
        "false_rejection": float(np.median(false)),
        "worst_false_rejection": float(false.max()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="worlds a fault")
    parser.add_argument("--only", default="", help="rows whose name holds this")
    arguments = parser.parse_args()
    seeds = arguments.seeds
    rough = World(field_m=0.02, field_rad=float(np.radians(20)))
    seen = World(position_only=True)
    runs: dict[str, Callable[[int], tuple[float, float]]] = {
        "none": lambda seed: cleaned(no_fault, World(), seed),
        "none, misses 2 cm and 20 deg": lambda seed: cleaned(no_fault, rough, seed),
    }
    for reaches in (15, 30):
        few = World(reaches=reaches, position_only=True)
        runs[f"none, {reaches} reaches, positions only"] = lambda seed, few=few: cleaned(no_fault, few, seed)
    for name, plant in FAULTS.items():
        runs[name] = lambda seed, plant=plant: cleaned(plant, World(), seed)
    for name in ("scattered", "offset block", "occlusion jumps"):
        runs[f"{name}, misses 2 cm and 20 deg"] = lambda seed, plant=FAULTS[name]: cleaned(plant, rough, seed)
        runs[f"{name}, positions only"] = lambda seed, plant=FAULTS[name]: cleaned(plant, seen, seed)
    for name in ("scattered", "offset block", "wandering block", "frozen block", "occlusion jumps"):
        runs[f"{name}, labelled by training"] = lambda seed, plant=FAULTS[name]: labelled_by_training(
            plant, World(), seed
        )
    for reaches in (8, 12, 20):
        runs[f"simulated faults, {reaches} reaches"] = partial(simulated, reaches)
    results = {name: measured(run, seeds) for name, run in runs.items() if arguments.only in name}
    print_table(HEAD, [[name, *result.values()] for name, result in results.items()])
    known = {name: {k: v for k, v in row.items() if np.isfinite(v)} for name, row in results.items()}
    save_results("cleaning_faults", {"seeds": seeds, "results": known})


if __name__ == "__main__":
    main()
