"""Choices behind the regression by held-out error: kernel, noise, shared or own length scales, inducing points.

docs/design/0002-shared-kernel.md quotes this table.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from gpr_support import Split, query_times, real, scores, simulated
from sklearn.cluster import MiniBatchKMeans
from sklearn.linear_model import LinearRegression
from support import print_table, save_results

from gpcorrect.gpr import SparseGPR
from gpcorrect.gpr.kernels import Kernel
from gpcorrect.types import FloatArray

HEAD = ["", "rmse mm", "rmse deg", "NLPD", "95 % covers", "fit s", "query us"]


class KMeansGPR(SparseGPR):
    """Inducing points at the centres of clusters, in inputs divided by the length scales of the last component."""

    def _inducing_points(self, kernel: Kernel, X: FloatArray, rng: np.random.Generator) -> FloatArray:
        scales = kernel.length_scales[-1]
        clusters = MiniBatchKMeans(self.n_inducing, n_init=1, batch_size=4096, max_iter=30, random_state=0)
        centres: FloatArray = clusters.fit(X[rng.permutation(len(X))[:10_000]] / scales).cluster_centers_
        return np.unique(centres * scales, axis=0)


class RandomGPR(SparseGPR):
    """Inducing points at random samples."""

    def _inducing_points(self, kernel: Kernel, X: FloatArray, rng: np.random.Generator) -> FloatArray:
        return np.unique(X[rng.permutation(len(X))[: self.n_inducing]], axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="each line is the mean over so many seeds")
    seeds = range(parser.parse_args().seeds)
    results = {}
    for data in (simulated(), simulated(noise_correlation=0.9), real()):
        rows = {"straight line": straight_line(data)}
        for name, (make, options, known) in choices(data).items():
            rows[name] = average([measured(data, make(**options, random_state=seed), known) for seed in seeds])
        results[data.name] = rows
        print(f"\n{data.name}: {len(data.X)} training samples, {len(data.X_test)} held out")
        print_table(HEAD, [[n, *r.values()] for n, r in rows.items()])
    save_results("gpr_choices", results)


def choices(data: Split) -> dict[str, Any]:
    additive: dict[str, Any] = {"feature_groups": data.feature_groups}
    split: dict[str, Any] = {**additive, "output_groups": (3, 3)}
    stretches = {"groups": data.trajectory, "times": data.times}
    return {
        "one component, white noise": (SparseGPR, {}, {}),
        "one component, correlated noise": (SparseGPR, {}, stretches),
        "pose + velocity + both, white noise": (SparseGPR, additive, {}),
        "pose + velocity + both, correlated": (SparseGPR, additive, stretches),
        "the same, position and rotation apart": (SparseGPR, split, stretches),
        "the same, every output apart": (SparseGPR, {**additive, "output_groups": (1,) * 6}, stretches),
        "apart, 500 points": (SparseGPR, {**split, "n_inducing": 500}, stretches),
        "apart, 500, centres of k-means": (KMeansGPR, {**split, "n_inducing": 500}, stretches),
        "apart, 500, random samples": (RandomGPR, {**split, "n_inducing": 500}, stretches),
        "apart, 1500 points, 500 of variance": (SparseGPR, {**split, "n_inducing": 1500, "n_variance": 500}, stretches),
        "apart, learned from 1000 samples": (SparseGPR, {**split, "n_learn": 1000}, stretches),
    }


def measured(data: Split, model: SparseGPR, known: dict[str, Any]) -> dict[str, float]:
    start = time.perf_counter()
    model.fit(data.X, data.Y, **known)
    seconds = time.perf_counter() - start
    mean, std = model.predict(data.X_test, return_std=True)
    query, _ = query_times(model.predictor_.mean_std, data.X_test, 1000)
    return {**scores(data, mean, std), "fit_s": seconds, "query_us": query}


def straight_line(data: Split) -> dict[str, float]:
    start = time.perf_counter()
    line = LinearRegression().fit(data.X, data.Y)
    seconds = time.perf_counter() - start
    std = np.tile((data.Y - line.predict(data.X)).std(axis=0), (len(data.X_test), 1))
    return {**scores(data, line.predict(data.X_test), std), "fit_s": seconds, "query_us": float("nan")}


def average(rows: list[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


if __name__ == "__main__":
    main()
