"""Ours beside scikit-learn, GPyTorch, GPy and tinygp: same data, same features, same run, each in a process of its own.

    pip install -e ".[bench]"
    python bench/gpr_peers.py                      # exact peers on a subset of 460 samples, the paper's smallest fit
    python bench/gpr_peers.py --sparse --limit 600 # and the sparse models of GPyTorch and GPy on all samples

A peer whose library is not installed is left out and named. A sparse peer stops after `--limit` seconds of processor
time, and the table says how many of its 100 steps it came to. Memory is what a fit adds at its peak to what the process
held before it.
Everything runs on one thread; compiling, where a library compiles, is part of the fit.
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import Any

from gpr_support import Split, query_times, real, scores, simulated
from support import print_table, save_results
from threadpoolctl import threadpool_limits

HEAD = [
    "",
    "samples",
    "fit s",
    "cpu s",
    "rmse mm",
    "rmse deg",
    "NLPD",
    "95 % covers",
    "query us",
    "p99 us",
    "memory MB",
]
QUERIES, FEWER_QUERIES = 3000, 300
POINTS = 500  # of the sparse peers: ours has 700


@dataclass(frozen=True)
class Line:
    """One line of the table: what it is called, which package and function, and its options."""

    name: str
    package: str
    module: str
    function: str
    samples: int | None
    options: dict[str, Any] = field(default_factory=dict)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="*", default=[460], help="sizes of the exact models' subsets")
    parser.add_argument("--data", choices=["simulated", "real", "both"], default="both")
    parser.add_argument(
        "--sparse",
        action="store_true",
        help="also the sparse models of GPyTorch and GPy, and ours at its most thorough (minutes)",
    )
    parser.add_argument("--limit", type=float, default=600.0, help="seconds of processor time for a sparse peer's fit")
    options = parser.parse_args()
    results: dict[str, Any] = {}
    for name, load in (("simulated", simulated), ("real", real)):
        if options.data in (name, "both"):
            data = load()
            print(f"\n{data.name}: {len(data.X)} training samples, {len(data.X_test)} held out", flush=True)
            results[data.name] = [compare(line, data, options.limit) for line in lines(options.samples, options.sparse)]
            print_table(HEAD, [[row["name"], *list(row.values())[1:-1]] for row in results[data.name]])
            print("\n".join(f"{row['name']}: {row['said']}" for row in results[data.name] if row["said"]))
    save_results("gpr_peers", results)


def lines(sizes: list[int], sparse: bool) -> Iterator[Line]:
    """Lines of the table whose libraries are installed; names the others."""
    for line in _all_lines(sizes, sparse):
        if importlib.util.find_spec(line.package) is None:
            print(f"left out: {line.name} (pip install {line.package})")
        else:
            yield line


def _all_lines(sizes: list[int], sparse: bool) -> Iterator[Line]:
    for n in sizes:
        size = {"size": n}
        yield Line("scikit-learn exact", "sklearn", "scikit_learn", "exact", n, {**size, "shared": False})
        yield Line("scikit-learn exact, one kernel", "sklearn", "scikit_learn", "exact", n, {**size, "shared": True})
        yield Line("GPyTorch exact", "gpytorch", "gpytorch_models", "exact", n, size)
        yield Line("GPy exact, one kernel", "GPy", "gpy_models", "exact", n, size)
        yield Line("tinygp exact", "tinygp", "tinygp_models", "exact", n, size)
        yield Line("ours, exact", "gpcorrect", "ours", "exact", n, size)
    if sparse:
        yield Line("GPyTorch SGPR", "gpytorch", "gpytorch_models", "sgpr", None, {"inducing": POINTS})
        yield Line("GPy sparse, one kernel", "GPy", "gpy_models", "sparse", None, {"inducing": POINTS})
    yield Line("ours, sparse (default)", "gpcorrect", "ours", "sparse", None)
    yield Line("ours, as `gpcorrect fit` does it", "gpcorrect", "ours", "shipped", None)
    if sparse:
        thorough = {"n_inducing": 1500, "n_learn": 1000, "output_groups": (1,) * 6}
        yield Line("ours, a kernel each, 1500 points", "gpcorrect", "ours", "sparse", None, thorough)


def compare(line: Line, data: Split, limit: float) -> dict[str, Any]:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found: dict[str, Any] = pool.apply(measure, (line, data, limit))
    print(
        "; ".join(f"{key} {value:.4g}" if isinstance(value, float) else str(value) for key, value in found.items()),
        flush=True,
    )
    return found


def measure(line: Line, data: Split, limit: float) -> dict[str, Any]:
    """Fit, score and time one line, in a process of its own."""
    make = getattr(import_module(f"peers.{line.module}"), line.function)
    if line.package == "gpcorrect":  # what a recording tells beside inputs and outputs
        fit = make(data.feature_groups, data.trajectory, data.times, **line.options)
    else:
        fit = partial(make, **line.options)
    with threadpool_limits(1):
        before, start, busy = peak_mb(), time.perf_counter(), time.process_time()
        peer, said = fit(data.X, data.Y, limit)
        seconds, busy = time.perf_counter() - start, time.process_time() - busy
        memory = peak_mb() - before
        mean, std = peer.predict(data.X_test)
        count = QUERIES if line.package == "gpcorrect" else FEWER_QUERIES
        median, p99 = query_times(lambda x: peer.predict(x[None]), data.X_test, count)
    return {
        "name": line.name,
        "samples": str(min(line.samples or len(data.X), len(data.X))),
        "fit_s": seconds,
        "fit_cpu_s": busy,
        **scores(data, mean, std),
        "query_us": median,
        "query_p99_us": p99,
        "memory_mb": memory,
        "said": said,
    }


def peak_mb() -> float:
    """Most memory that the process has held so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
