"""Time and memory of the sparse fit against the number of samples, hyperparameters and posterior apart.

Each size runs in a process of its own, so that its peak memory is its own; the data themselves are subtracted.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time

import numpy as np
from support import print_table, save_results

from gpcorrect.gpr import SparseGPR
from gpcorrect.types import FloatArray, Progress

FEATURES, OUTPUTS, WAVES = 12, 6, 60
BLOCK = 10_000


class Stopwatch(Progress):
    """Remembers when each stage was last heard of."""

    def __init__(self) -> None:
        self.times: dict[str, float] = {}

    def step(self, stage: str, done: float) -> None:
        """Note the time."""
        self.times[stage] = time.perf_counter()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 30_000, 100_000, 300_000, 1_000_000])
    parser.add_argument("--inducing", type=int, default=1000)
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    rows = []
    for size in options.sizes:
        with context.Pool(1) as pool:
            rows.append(pool.apply(measure, (size, options.inducing)))
    print_table(
        ["samples", "hyperparameters s", "posterior s", "working memory MB", "rmse / noise"],
        [[str(row["samples"]), *list(row.values())[1:]] for row in rows],
    )
    sizes = np.log([row["samples"] for row in rows])
    slope = np.polyfit(sizes, np.log([row["posterior_s"] for row in rows]), 1)[0] if len(rows) > 1 else float("nan")
    print(f"\nposterior time grows with the {slope:.2f}th power of the samples")
    save_results("gpr_scale", {"rows": rows, "posterior_slope": slope})


def measure(samples: int, inducing: int) -> dict[str, float]:
    X, Y, noise = data(samples + 2000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    watch, start = Stopwatch(), time.perf_counter()
    model = SparseGPR(inducing).fit(X[:samples], Y[:samples], progress=watch)
    end, learned = time.perf_counter(), watch.times["hyperparameters"]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    error = model.predict(X[samples:]) - Y[samples:]
    return {
        "samples": samples,
        "hyperparameters_s": learned - start,
        "posterior_s": end - learned,
        "working_memory_mb": (peak - before) / 1024,
        "rmse_over_noise": float(np.sqrt((error**2).mean())) / noise,
    }


def data(samples: int, noise: float = 0.1) -> tuple[FloatArray, FloatArray, float]:
    """Draw smooth fields of unit variance over normal inputs, made in blocks."""
    rng = np.random.default_rng(0)
    X = rng.standard_normal((samples, FEATURES))
    waves, phase = rng.standard_normal((FEATURES, WAVES)) / 5.0, rng.uniform(0, 2 * np.pi, WAVES)
    weights = rng.standard_normal((WAVES, OUTPUTS)) * np.sqrt(2.0 / WAVES)
    Y = noise * rng.standard_normal((samples, OUTPUTS))
    for start in range(0, samples, BLOCK):
        rows = slice(start, start + BLOCK)
        Y[rows] += np.cos(X[rows] @ waves + phase) @ weights
    return X, Y, noise


if __name__ == "__main__":
    main()
