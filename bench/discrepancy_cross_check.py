"""Do the effects named on one recording of a real wrist hold on others? Joints 4 to 6 of a dVRK.

    python bench/discrepancy_cross_check.py            # about a minute

Named on dvrk_random; then the residual of the two dvrk_wiggle recordings, which the run has never seen, with the
nominal model and with the one that it wrote.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
from support import print_table, real_data, save_results

from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.logs import read_log
from gpcorrect.sim import Model, model_from_dict
from gpcorrect.types import CalibrationLog, FloatArray

JOINTS = (4, 5, 6)


def residual_deg(log: CalibrationLog, model: Model) -> FloatArray:
    """Root mean square `(3,)` of measured minus simulated, deg."""
    error = build_scene(log, model, np.ones(len(log), dtype=np.bool_)).residual()
    return np.degrees(np.sqrt(np.nanmean(error**2, axis=0)))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    warnings.simplefilter("ignore")
    nominal = model_from_dict({"arm": "joints", "joints": list(JOINTS), "joint_types": "RRR"})
    found = find_discrepancy(nominal, read_log(real_data("dvrk_random.csv")), seed=given.seed)
    for effect in found.effects:
        print(f"{effect.level:6} {effect.name} {effect.joint}")
    rows = {}
    for g in found.gap:
        rows[f"dvrk_random, test set, {g.channel.name}"] = np.degrees([g.before, g.after])
    for number in (1, 2):
        log = read_log(real_data(f"dvrk_wiggle_{number}.csv"))
        before, after = residual_deg(log, nominal), residual_deg(log, found.model)
        rows |= {f"dvrk_wiggle_{number}, joint {j}": np.array(e) for j, *e in zip(JOINTS, before, after, strict=True)}
    print()
    print_table(["RMS, deg", "before", "with the named"], [[k, f"{b:.2f}", f"{a:.2f}"] for k, (b, a) in rows.items()])
    save_results("discrepancy_cross_check", {k: v.tolist() for k, v in rows.items()})


if __name__ == "__main__":
    main()
