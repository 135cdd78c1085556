"""Real wrist and arm of a dVRK: `gpcorrect fit` beside scikit-learn's exact GPR on the same features, same run.

The peer is given 800 training samples (exact regression grows with the cube) of the very features and residuals that
ours learns from, and optimises its own hyperparameters. Held out: the last 20 % of the trajectories, the same
samples for both.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from support import print_table, real_data, save_results

from gpcorrect.calibration import Experiment, error_table, run_experiment
from gpcorrect.calibration.poses import pose_pair
from gpcorrect.logs import read_log
from gpcorrect.rigid import apply_residual, pose_residual
from gpcorrect.types import CalibrationLog, FloatArray

PEER_SAMPLES = 800
SEED = 0


def main() -> None:
    log = read_log(real_data("dvrk_random.csv"))
    start = time.perf_counter()
    ours = run_experiment(log)
    seconds = time.perf_counter() - start
    errors: dict[str, Any] = ours.evaluation.clean_errors
    peer, peer_seconds = peer_errors(ours)
    rows = {
        "raw": errors["raw"],
        "rigid": errors["rigid"],
        "scikit-learn exact, 800": peer,
        "gpcorrect": errors["corrected"],
    }
    leaves = ("mean", "rmse", "p95")
    head = ["held out", *(f"{p} {leaf}" for p in ("mm", "deg") for leaf in leaves)]
    print_table(
        head,
        [
            [name, *(t[p]["norm"][x] for p in ("position_mm", "rotation_deg") for x in leaves)]
            for name, t in rows.items()
        ],
    )
    print(f"\nfit: gpcorrect {seconds:.1f} s in all; scikit-learn regression alone {peer_seconds:.1f} s")
    print(f"held-out samples {len(ours.evaluation.clean.rows)}, dropped {ours.to_dict()['dropped']}")
    print(f"95 % intervals of gpcorrect cover {np.round(100 * ours.evaluation.clean.coverage95, 1)} %")
    save_results("real_dvrk", {"rows": rows, "seconds": seconds, "peer_seconds": peer_seconds})


def peer_errors(ours: Experiment) -> tuple[Any, float]:
    """Table of errors of scikit-learn's regression on our features and residuals."""
    X, Y, _ = inputs_and_residuals(ours, ours.fit.log, None)
    X_test, _, reference = inputs_and_residuals(ours, ours.test, ours.evaluation.clean.rows)
    rows = np.random.default_rng(SEED).choice(len(X), min(PEER_SAMPLES, len(X)), replace=False)
    start = time.perf_counter()
    predicted = np.column_stack([peer_output(X[rows], Y[rows, i], X_test) for i in range(Y.shape[1])])
    seconds = time.perf_counter() - start
    _, command = pose_pair(ours.test)
    command = command[ours.evaluation.clean.rows]
    return error_table(pose_residual(apply_residual(reference, predicted), command)), seconds


def peer_output(X: FloatArray, y: FloatArray, X_test: FloatArray) -> FloatArray:
    kernel = ConstantKernel(1.0) * RBF(np.full(X.shape[1], 3.0), (1e-2, 1e3)) + WhiteKernel(0.1, (1e-6, 1e1))
    regressor = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=1, random_state=SEED)
    return regressor.fit(X, y).predict(X_test)


def inputs_and_residuals(fit: Experiment, log: CalibrationLog, rows: Any) -> tuple[FloatArray, FloatArray, Any]:
    """Features (n, d), residuals (n, 6) and reference poses: of the given rows, or of all that the fit learned from."""
    corrector = fit.corrector
    keep = fit.fit.cleaning.keep if rows is None else fit.evaluation.cleaning.keep
    observed, command = pose_pair(log)
    samples = corrector.samples(log, keep)
    rows = samples.rows if rows is None else rows
    reference = corrector.rigid.apply(observed[rows])
    return samples.X[rows], pose_residual(reference, command[rows]), reference


if __name__ == "__main__":
    main()
