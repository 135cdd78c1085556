"""Table I of Mahler et al. 2014 on simulated debridement data: six methods, clean and dirty held-out samples.

The six columns, in the paper's order: no correction, offset (rigid registration), GPR on the pose alone, offset + GPR,
offset + GPR + velocity, offset + GPR + velocity + cleaning. All but the last learn from the recording as it came,
faults included.
"""

from __future__ import annotations

import argparse
import time

from support import print_table, save_results

from gpcorrect.corrector import FitSettings
from gpcorrect.experiment import Experiment, run_experiment
from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog

METHODS = {
    "GPR": FitSettings(features=("pose",), rigid=False, clean=False),
    "offset + GPR": FitSettings(features=("pose",), clean=False),
    "offset + GPR + velocity": FitSettings(clean=False),
    "offset + GPR + velocity + cleaning": FitSettings(),
}
PARTS = ("position_mm", "rotation_deg")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, default=303)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    log = debridement_log(arguments.seed, reaches=arguments.reaches)
    print(
        f"{arguments.reaches} reaches, {len(log)} samples, seed {arguments.seed}; last 20 % of the reaches held out\n"
    )
    results = table(log)
    for part, unit in (("position_mm", "mm"), ("rotation_deg", "deg")):
        head = [f"norm [{unit}]", "clean mean", "SD", "dirty mean", "SD", "% of raw (dirty)"]
        raw = results["no correction"]["dirty"][part]["mean"]
        rows = [
            [
                name,
                r["clean"][part]["mean"],
                r["clean"][part]["sd"],
                r["dirty"][part]["mean"],
                r["dirty"][part]["sd"],
                100 * r["dirty"][part]["mean"] / raw,
            ]
            for name, r in results.items()
        ]
        print_table(head, rows)
        print()
    save_results("mahler_table1", results)


def table(log: CalibrationLog) -> dict[str, dict[str, dict[str, dict[str, float]]]]:
    """Statistics of the error norms by method, for samples that pass cleaning and for all."""
    fits = {}
    for name, settings in METHODS.items():
        start = time.perf_counter()
        fits[name] = run_experiment(log, settings)
        print(f"fitted {name} in {time.perf_counter() - start:.1f} s", flush=True)
    dirty_fit = fits["offset + GPR"]
    return {
        "no correction": norms(dirty_fit, "raw"),
        "offset": norms(dirty_fit, "rigid"),
        **{name: norms(fit, "corrected") for name, fit in fits.items()},
    }


def norms(fit: Experiment, method: str) -> dict[str, dict[str, dict[str, float]]]:
    assert fit.evaluation is not None
    sets = {"clean": fit.evaluation.clean, "dirty": fit.evaluation.dirty}
    return {
        which: {part: measured.errors()[method][part]["norm"] for part in PARTS} for which, measured in sets.items()
    }


if __name__ == "__main__":
    main()
