"""Joint errors of the simulated calibration machine beside the published ones: raw, and after a fixed offset.

The offset is the mean error on a zig-zag along all joints; the test is four minutes of random sweeps. A machine whose
figures leave the published ones' size is no stand-in for the paper's.
"""

from __future__ import annotations

import argparse

import numpy as np
from support import print_table, save_results

from gpcorrect.types import FloatArray
from gpcorrect_studies.peng2024 import RavenStudy
from gpcorrect_studies.peng2024.study import CLAIMS

UNITS = np.array([np.rad2deg(1.0), np.rad2deg(1.0), 1e3])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=201)
    options = parser.parse_args()
    rows: list[list[object]] = []
    for seed in range(options.first, options.first + options.seeds):
        study = RavenStudy(seed)
        logs = study.zigzags("J1-J2-J3", 6), study.random_run(4.0)
        train, test = (np.subtract(log.external_jp, log.measured_jp) for log in logs)
        rows.append([f"seed {seed}", *rmse(test), *rmse(test - train.mean(axis=0))])
    means = np.mean([row[1:] for row in rows], axis=0)
    rows.append(["mean", *means.tolist()])
    printed = CLAIMS.printed["table1"]["J1-J2-J3"]
    rows.append(["printed", *printed["raw"]["mean"], *printed["fixed_offset"]["mean"]])
    names = ("J1 deg", "J2 deg", "J3 mm")
    print_table(["RMSE", *(f"raw {n}" for n in names), *(f"offset {n}" for n in names)], rows)
    save_results("raven_joints", {"rows": rows})


def rmse(error: FloatArray) -> list[float]:
    found: list[float] = (np.sqrt(np.mean(error**2, axis=0)) * UNITS).tolist()
    return found


if __name__ == "__main__":
    main()
