"""What a default `gpcorrect fit` costs: processor time of its parts, beside what it leaves at held-out trajectories.

One thread. The recordings are simulated debridement, short and as long as the paper's, and the real wrist. Run it in
two checkouts to see what a change of the code brings and costs.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time
from collections.abc import Callable

import numpy as np
from support import print_table, real_data, save_results
from threadpoolctl import threadpool_limits

from gpcorrect.calibration import run_experiment
from gpcorrect.logs import read_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog

# Column: file and name of the function whose time it is; none of them calls another.
PARTS = {
    "cleaning": ("cleaning/cleaner.py", "fit_cleaner"),
    "registration": ("calibration/poses.py", "register"),
    "joint features": ("calibration/joint_features.py", "learn"),
    "likelihood": ("gpr/learning.py", "learn"),
    "points": ("gpr/sparse.py", "choose_inducing"),
    "sums": ("gpr/statistics.py", "collect"),
    "measuring": ("calibration/evaluate.py", "_measured"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, nargs="*", default=[16, 60, 303], help="lengths of the simulated ones")
    options = parser.parse_args()
    recordings: dict[str, Callable[[], CalibrationLog]] = {
        f"debridement, {count} reaches": lambda count=count: debridement_log(0, reaches=count)
        for count in options.reaches
    }
    recordings["real wrist"] = lambda: read_log(real_data("dvrk_random.csv"))
    rows = [[name, *measured(make())] for name, make in recordings.items()]
    head = ["recording", "samples", "rmse mm", "rmse deg", "95 % covers", "processor s", *PARTS, "rest"]
    print_table(head, rows)
    save_results("fit_time", {"head": head, "rows": rows})


def measured(log: CalibrationLog) -> list[float]:
    """Return samples learned from, errors and coverage at those held out, seconds of all, each part and the rest."""
    profile = cProfile.Profile(time.process_time)
    with threadpool_limits(1):
        start = time.process_time()
        plain = run_experiment(log)
        seconds = time.process_time() - start
        profile.runcall(run_experiment, log)
    errors = plain.evaluation.clean_errors["corrected"]
    entries = pstats.Stats(profile).stats.items()
    total = max(entry[3] for _, entry in entries)
    found = [
        sum(entry[3] for (path, _, name), entry in entries if path.endswith(file) and name == function)
        for file, function in PARTS.values()
    ]
    shares = np.append(found, total - sum(found)) / total  # the profiler's own time left out
    return [
        plain.fit.n_train,
        errors["position_mm"]["norm"]["rmse"],
        errors["rotation_deg"]["norm"]["rmse"],
        100 * float(np.mean(plain.evaluation.clean.coverage95)),
        seconds,
        *(seconds * shares).tolist(),
    ]


if __name__ == "__main__":
    main()
