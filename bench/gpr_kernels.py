"""Kernels of the regression by held-out error, log density and time of a fit: squared exponential, Matern 5/2, auto.

python bench/gpr_kernels.py --seeds 3
"""

from __future__ import annotations

import argparse

from gpr_choices import HEAD, average, measured
from gpr_support import real, simulated
from support import print_table, save_results

from gpcorrect.gpr import SparseGPR
from gpcorrect.gpr.kernels import KERNELS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="each line is the mean over so many seeds")
    seeds = range(parser.parse_args().seeds)
    results = {}
    for data in (real(), simulated(n_reaches=100, noise_correlation=0.9)):
        known = {"groups": data.trajectory, "times": data.times}
        rows = {}
        for kernel in (*KERNELS, "auto"):
            models = [
                SparseGPR(feature_groups=data.feature_groups, output_groups=(3, 3), kernel=kernel, random_state=seed)
                for seed in seeds
            ]
            rows[kernel] = average([measured(data, model, known) for model in models])
            taken = [learned.kernel.name for model in models for learned in model.learned_]
            rows[kernel]["matern52_taken"] = taken.count("matern52") / len(taken)
        results[data.name] = rows
        print(f"\n{data.name}: {len(data.X)} training samples, {len(data.X_test)} held out", flush=True)
        print_table([*HEAD, "matern taken"], [[n, *r.values()] for n, r in rows.items()])
    save_results("gpr_kernels", results)


if __name__ == "__main__":
    main()
