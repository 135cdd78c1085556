"""Joint calibrators on the real wrist and arm of a dVRK, last fifth held out, beside the reference points of the task.

Then the model of that motion on two recordings of another kind: the wrist wiggled at two poses of the arm, also with
zeros set anew from their first minute and measured on the rest.
"""

from __future__ import annotations

import numpy as np
from support import print_table, real_data, save_results

from gpcorrect.calibration import LEARNERS, FitSettings, JointCorrector, evaluate_model, run_experiment
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog

REFERENCES = {
    "linear with history (ref.)": [np.nan, np.nan, np.nan, 2.3, 5.5, 4.4],
    "plain GP with velocity (ref.)": [0.045, 0.041, 0.144, 1.06, 7.6, 6.3],
    "offset, gain, coupling, play (ref.)": [np.nan, np.nan, np.nan, 2.2, 3.6, 2.9],
    "play ladder and GP (ref.)": [0.042, 0.035, 0.110, 1.36, 3.7, 2.65],
}
HEAD = ["RMSE", "J1 deg", "J2 deg", "J3 mm", "J4 deg", "J5 deg", "J6 deg", "seconds"]


ZERO_SECONDS = 60.0


def rmse_rows(model: JointCorrector, log: CalibrationLog) -> dict[str, list[object]]:
    evaluation = evaluate_model(model, log)
    return {name: [r["rmse"] for r in part] for name, part in evaluation.dirty_errors.items()}


def main() -> None:
    log = read_log(real_data("dvrk_random.csv"))
    rows: list[list[object]] = []
    coverage: list[list[object]] = []
    for method in LEARNERS:
        experiment = run_experiment(log, FitSettings(method=method), task=JointCorrector)
        errors = experiment.evaluation.dirty_errors
        if not rows:
            rows.append(["raw", *(row["rmse"] for row in errors["raw"]), 0.0])
        rows.append([method, *(row["rmse"] for row in errors["corrected"]), experiment.seconds])
        coverage.append([method, *(100.0 * experiment.evaluation.dirty.coverage95)])
    rows += [[name, *values, np.nan] for name, values in REFERENCES.items()]
    print_table(HEAD, rows)
    print_table(["95 % intervals cover %", *HEAD[1:-1]], coverage)
    others: list[list[object]] = []
    model = experiment.corrector
    for number in (1, 2):
        log = read_log(real_data(f"dvrk_wiggle_{number}.csv"))
        others += [[f"wiggle {number}, {name}", *cells, np.nan] for name, cells in rmse_rows(model, log).items()]
        first = log.time - log.time[0] < ZERO_SECONDS
        rest = rmse_rows(model.rezeroed(log.select(first)), log.select(~first))
        others.append([f"wiggle {number}, corrected, new zero", *rest["corrected"], np.nan])
    print_table(HEAD, others)
    save_results("joint_compare", {"rows": rows, "others": others})


if __name__ == "__main__":
    main()
