"""Does heavy-tailed noise pay, and noise that changes? The shipped posterior beside both.

The robust posterior is that of Student-t noise with four degrees of freedom by iterated reweighting: after each
posterior a sample's noise is divided by `w = 5 / (4 + z^2)`, z its error over its standard deviation, the whole
scaled so that well-behaved samples keep the noise that was learned. Compared are errors on held-out samples without
faults: simulated reaches with a share of faulty residuals (single samples off by 5 to 20 times the noise, as cleaning
may miss them), and the real wrist as it is. "Varying noise" scales the shipped
deviations by a log-linear function of pose and speed that was fitted to left-out training errors.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from gpr_support import Split, real, scores, simulated
from support import print_table, save_results

from gpcorrect.calibration import folds_of
from gpcorrect.gpr import Predictor, SharedPredictor, SparseGPR, Statistics
from gpcorrect.gpr.statistics import Points
from gpcorrect.types import FloatArray, Progress

DEGREES = 4.0
ROUNDS = 4
RIDGE = 1e-2
SHARES = (0.0, 0.01, 0.05)
HEAD = ["", "rmse mm", "rmse deg", "NLPD", "95 % covers"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, default=150)
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    results: dict[str, Any] = {}
    clean = simulated(options.reaches, 40)
    cases = [(f"simulated, {100 * share:g} % faulty", clean, share) for share in SHARES] + [("real wrist", real(), 0.0)]
    rows = []
    for name, data, share in cases:
        found = [both(faulty(data, share, seed), seed) for seed in range(options.seeds)]
        for i, kind in enumerate(("shipped", "robust", "varying noise")):
            mean = {key: float(np.mean([f[i][key] for f in found])) for key in found[0][i]}
            results[f"{name}, {kind}"] = mean
            rows.append([f"{name}: {kind}", *mean.values()])
    print_table(HEAD, rows)
    save_results("gpr_tails", results)


def faulty(data: Split, share: float, seed: int) -> Split:
    """Replace a share of the training residuals by faulty ones."""
    rng = np.random.default_rng(seed)
    rows = np.flatnonzero(rng.random(len(data.Y)) < share)
    Y, noise = np.array(data.Y), np.repeat([2e-4, 2e-3], 3)
    Y[rows] += noise * rng.uniform(5, 20, (len(rows), 6)) * rng.choice([-1, 1], (len(rows), 6))
    return replace(data, Y=Y)


def both(data: Split, seed: int) -> list[dict[str, float]]:
    model = SparseGPR(feature_groups=data.feature_groups, output_groups=(3, 3), random_state=seed)
    model.fit(data.X, data.Y, groups=data.trajectory, times=data.times)
    predictors = [model.predictor_, robust(model.predictor_, data.X, data.Y)]
    answers = [p.mean_std_batch(data.X_test)[:2] for p in predictors]
    return [scores(data, *answer) for answer in (*answers, varying(model.predictor_, model, data))]


def varying(predictor: Predictor, model: SparseGPR, data: Split) -> tuple[FloatArray, FloatArray]:
    """Means and deviations at the test inputs, the latter as left-out training errors vary with pose and speed."""
    folds, z = folds_of(data.trajectory), np.empty(data.Y.shape)
    for fold in np.unique(folds):
        out = folds == fold
        mean, std, _ = model.refit(data.X[~out], data.Y[~out]).predictor_.mean_std_batch(data.X[out])
        z[out] = (data.Y[out] - mean) / std
    A = sizes(data.X)
    weights = np.linalg.solve(A.T @ A + RIDGE * len(A) * np.eye(A.shape[1]), A.T @ np.log(z**2 + 1e-4))
    mean, std, _ = predictor.mean_std_batch(data.X_test)
    level = np.sqrt((z**2 / np.exp(A @ weights)).mean(axis=0))
    return mean, std * level * np.exp(0.5 * (sizes(data.X_test) @ weights))


def sizes(X: FloatArray) -> FloatArray:
    """Return what the logarithm of the variance is linear in: saturated features and the logarithm of both speeds."""
    speeds = [np.log(0.1 + np.linalg.norm(X[:, columns], axis=1)) for columns in (slice(6, 9), slice(9, 12))]
    return np.column_stack([np.ones(len(X)), np.tanh(X / 2), *speeds])


def robust(predictor: Predictor, X: FloatArray, Y: FloatArray) -> Predictor:
    for _ in range(ROUNDS):
        mean, std, _ = predictor.mean_std_batch(X)
        weight = (DEGREES + 1) / (DEGREES + ((Y - mean) / std) ** 2)
        # One weight a sample and group of outputs: the shared spectrum needs the same samples for all of a group.
        groups = weight.reshape(len(X), -1, 3).mean(axis=2)
        parts = [weighted(part, X, Y[:, 3 * g : 3 * g + 3], groups[:, g]) for g, part in enumerate(predictor.parts)]
        predictor = Predictor(tuple(parts))
    return predictor


def weighted(part: SharedPredictor, X: FloatArray, Y: FloatArray, weight: FloatArray) -> SharedPredictor:
    """Return the posterior in which sample i has its noise divided by its weight."""
    points, weight = Points.of(part), weight / np.median(weight)
    total = Statistics(np.zeros((len(part.basis),) * 2), np.zeros((len(part.basis), 3)), 0.0)
    levels = np.clip(np.round(8 * np.log2(weight)) / 8, -6, 2)  # samples of like weight are summed together
    for level in np.unique(levels):
        rows = levels == level
        sums = points.collect(X[rows], Y[rows], Progress())
        total = total.plus(Statistics(2**level * sums.G, 2**level * sums.Vy, 2**level * sums.n))
    return points.posterior(total)


if __name__ == "__main__":
    main()
