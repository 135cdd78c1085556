"""Do the 95 % intervals of joints hold? Every real set with outside joints, each fifth of its trajectories held out.

    python bench/joint_intervals.py [--sets dvrk_random --methods gp,ukf]

Prints the share of errors in their intervals, joint by joint, and the mean half width in deg (mm). The last table
counts joints and splits where fewer than 93 % hold, 93 to 97, and more, and says how wide intervals are: the geometric
mean of the half widths over the root mean square errors, 1.96 where errors are normal and alike. Run it in two
checkouts to see what a change brings and costs.
"""

from __future__ import annotations

import argparse

import numpy as np
from joint_peers import SETS
from support import print_table, real_data, save_results

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model
from gpcorrect.calibration.metrics import joint_units
from gpcorrect.logs import read_log

FIFTHS = 5
LOW, HIGH = 93.0, 97.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", default=",".join(SETS))
    parser.add_argument("--methods", default="gp,auto,ukf,linear")
    args = parser.parse_args()
    rows, totals = [], []
    for method in args.methods.split(","):
        shares, widths = [], []
        for name in args.sets.split(","):
            log = read_log(real_data(SETS[name]))
            for k, part in enumerate(np.array_split(log.trajectory_ids, FIFTHS)):
                held = np.isin(log.trajectory, part)
                model = fit_model(log.select(~held), FitSettings(method=method), task=JointCorrector).corrector
                measured = evaluate_model(model, log.select(held)).dirty
                share = 100 * measured.coverage95
                half = measured.interval95.mean(axis=0)
                shares.append(share)
                widths.append(half / np.sqrt((measured.corrected**2).mean(axis=0)))
                shown = [
                    " ".join(f"{value:.1f}" for value in share),
                    " ".join(f"{v:.3g}" for v in half * joint_units(model.types)[1]),
                ]
                rows.append([f"{name}, fifth {k + 1}, {method}", *shown])
                print(*rows[-1], sep=" | ", flush=True)
        all_shares, all_widths = np.concatenate(shares), np.concatenate(widths)
        low, high = int((all_shares < LOW).sum()), int((all_shares > HIGH).sum())
        numbers = [low, len(all_shares) - low - high, high, all_shares.min(), all_shares.mean()]
        totals.append([method, *numbers, float(np.exp(np.log(all_widths).mean()))])
    print_table(["joints and splits", "< 93 %", "93 to 97", "> 97 %", "least %", "mean %", "width"], totals)
    save_results("joint_intervals", {"rows": rows, "totals": totals})


if __name__ == "__main__":
    main()
