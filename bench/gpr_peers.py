"""Ours beside scikit-learn's exact regression: same data, same features, same run.

Exact regression grows with the cube of the samples, so the peer is given a subset (460, as the paper's smallest; more
with `--samples 460 2000`). It optimises an ARD kernel and a noise variance for every output, or one for all of them.
"""

from __future__ import annotations

import argparse
import time
import warnings
from typing import Any

import numpy as np
from gpr_support import Split, query_times, real, scores, simulated
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from support import print_table, save_results

from gpcorrect.gpr import ExactGPR, SparseGPR
from gpcorrect.types import FloatArray

HEAD = ["", "samples", "fit s", "rmse mm", "rmse deg", "NLPD", "95 % covers", "query us", "p99 us"]
SEED = 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, nargs="+", default=[460], help="sizes of the peers' subsets")
    parser.add_argument("--data", choices=["simulated", "real", "both"], default="both")
    options = parser.parse_args()
    results: dict[str, Any] = {}
    for name, load in (("simulated", simulated), ("real", real)):
        if options.data in (name, "both"):
            data = load()
            results[data.name] = compare(data, options.samples)
            print(f"\n{data.name}: {len(data.X)} training samples, {len(data.X_test)} held out")
            print_table(HEAD, [[row["name"], *list(row.values())[1:]] for row in results[data.name]])
    save_results("gpr_peers", results)


def compare(data: Split, sizes: list[int]) -> list[dict[str, Any]]:
    rows = []
    for size in sizes:
        subset = np.random.default_rng(SEED).choice(len(data.X), min(size, len(data.X)), replace=False)
        rows.append(peer_row(data, subset, shared=False))
        rows.append(peer_row(data, subset, shared=True))
        rows.append(our_row("ours, exact", data, ExactGPR, {"n_learn": 500}, np.sort(subset)))
    everything = np.arange(len(data.X))
    for name, options in (
        ("ours, sparse 500", {"n_inducing": 500}),
        ("ours, sparse (default)", {}),
        ("ours, sparse 1500, variance 500", {"n_inducing": 1500, "n_variance": 500}),
    ):
        rows.append(our_row(name, data, SparseGPR, options, everything))
    return rows


def our_row(name: str, data: Split, make: Any, options: dict[str, Any], rows: FloatArray) -> dict[str, Any]:
    model = make(feature_groups=data.feature_groups, output_groups=(3, 3), **options)
    start = time.perf_counter()
    model.fit(data.X[rows], data.Y[rows], groups=data.trajectory[rows], times=data.times[rows])
    seconds = time.perf_counter() - start
    mean, std = model.predict(data.X_test, return_std=True)
    median, p99 = query_times(model.predictor_.mean_std, data.X_test)
    return row(name, len(rows), seconds, scores(data, mean, std), median, p99)


def peer_row(data: Split, rows: FloatArray, *, shared: bool) -> dict[str, Any]:
    X, Y = data.X[rows], data.Y[rows]
    columns = [Y] if shared else [Y[:, [o]] for o in range(Y.shape[1])]
    start = time.perf_counter()
    models = [peer().fit(X, column) for column in columns]
    seconds = time.perf_counter() - start
    mean, std = (np.column_stack(parts) for parts in zip(*(predict(m, data.X_test) for m in models), strict=True))
    median, p99 = query_times(lambda x: [m.predict(x[None], return_std=True) for m in models], data.X_test, 300)
    name = "scikit-learn, one kernel" if shared else "scikit-learn, a kernel each"
    return row(name, len(rows), seconds, scores(data, mean, std), median, p99)


def peer() -> GaussianProcessRegressor:
    kernel = ConstantKernel(1.0) * RBF(np.full(12, 3.0), (1e-2, 1e3)) + WhiteKernel(0.1, (1e-6, 1e1))
    return GaussianProcessRegressor(kernel, normalize_y=True, random_state=SEED)


def predict(model: GaussianProcessRegressor, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean, std = model.predict(X, return_std=True)
    return mean, std


def row(name: str, samples: int, seconds: float, score: dict[str, float], median: float, p99: float) -> dict[str, Any]:
    return {"name": name, "samples": str(samples), "fit_s": seconds, **score, "query_us": median, "query_p99_us": p99}


if __name__ == "__main__":
    warnings.simplefilter("ignore", ConvergenceWarning)
    main()
