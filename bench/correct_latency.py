"""One `correct(pose, twist)` in process beside scikit-learn's `predict(return_std=True)` on as many points, same run.

Asked are poses of the model's own recording, in blocks that alternate between ours and the peers, so that whatever else
the machine does falls on all. The peers have as many training points as ours has inducing points. "Same kernels" has
ours: one for positions, one for rotations, three components each. "One plain kernel" shares a single component between
all six outputs: the least that the peer can be asked, and a lesser model. Hyperparameters are set, not searched: a
query costs the same whatever they are.

"Cold" is the first query of a block, after others have filled the caches; the other figures leave it out.

What the machine itself adds is shown by three compiled loops in the same blocks: one that does nothing, one that
computes for as long as a query of ours, one that reads as much memory. With `--alone` (needs the right to it) the
kernel runs nothing else on this processor in between: what is left of the tail is ours and the hardware's.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit
from residual_field import Reaches, simulate_reaches
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel, WhiteKernel
from support import print_table, save_results
from threadpoolctl import threadpool_limits

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, FitSettings, fit_corrector
from gpcorrect.rigid import apply_residual
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

SEED = 7
BLOCKS = 40
UNSEEN = 1e6  # length scale that stands for an infinite one: the component does not see the feature
PER_QUERY, ROUNDS = 25.0, 1000  # microseconds of a query of ours, about; rounds of arithmetic to gauge the machine by
RATE = 20.0  # samples a second of the simulated reaches
Call = Callable[[int], object]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, default=300, help="simulated reaches of 64 samples to learn from")
    parser.add_argument("--queries", type=int, default=4000, help="queries of ours; the peer gets a tenth")
    parser.add_argument("--alone", action="store_true", help="ask the kernel for real-time priority")
    options = parser.parse_args()
    corrector = fit_corrector(recording(options.reaches), FitSettings(marker="none", time_offset="none"))
    queries = corrector.check_queries[np.arange(512) % len(corrector.check_queries)]
    queries = queries + np.random.default_rng(SEED).normal(0, 1e-3, queries.shape) * [1, 1, 1, 0, 0, 0, 0, *[1] * 6]
    calls = {
        "gpcorrect: correct(pose, twist)": (our_call(corrector, queries), 10),
        "gpcorrect: the regression alone": (regression_call(corrector), 10),
        "scikit-learn: same kernels": (peer_call(same_kernels(corrector)), 1),
        "scikit-learn: a plain kernel for each output": (peer_call(plain_kernels(corrector, apart=True)), 1),
        "scikit-learn: one plain kernel": (peer_call(plain_kernels(corrector, apart=False)), 1),
    }
    calls |= {f"the machine: {name}": (call, 10) for name, call in machine_calls(corrector).items()}
    if options.alone:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    rows = measure(calls, options.queries)
    head = ["microseconds", "median", "p90", "p99", "p99 / median", "cold"]
    print_table(head, rows)
    points = len(corrector.law.learned.predictor.parts[0].basis)
    ratios = {name: float(median) / float(rows[0][1]) for name, median, *_ in rows if "scikit" in str(name)}
    print(f"\n{points} points; medians over gpcorrect's: " + ", ".join(f"{r:.1f} ({n})" for n, r in ratios.items()))
    save_results("correct_latency", {"head": head, "rows": rows, "points": points, "ratios": ratios})


def recording(n_reaches: int) -> CalibrationLog:
    return as_log(simulate_reaches(n_reaches, 64, np.random.default_rng(SEED)))


def as_log(reaches: Reaches) -> CalibrationLog:
    """Return reaches as a log: what was observed, and the commands that the planted residual makes of it."""
    seen = PoseSignal(reaches.positions, se3.quaternion_from_matrix(reaches.rotations))
    return CalibrationLog(
        time=np.arange(len(reaches.positions)) / RATE,
        trajectory=reaches.trajectory,
        session=np.zeros(len(reaches.positions)),
        tracker_cp=seen,
        setpoint_cp=apply_residual(seen, reaches.residuals),
        name="simulated reaches",
    )


def our_call(corrector: CommandCorrector, queries: FloatArray) -> Call:
    poses, twists = list(queries[:, :7]), list(queries[:, 7:])
    return lambda i: corrector.correct(poses[i % len(poses)], twists[i % len(poses)])


def regression_call(corrector: CommandCorrector) -> Call:
    inputs = list(corrector.law.learned.predictor.parts[0].basis)
    return lambda i: corrector.law.learned.predictor.mean_std(inputs[i % len(inputs)])


def machine_calls(corrector: CommandCorrector) -> dict[str, Call]:
    """Loops beside which a query's tail is to be seen."""
    as_long = int(PER_QUERY / np.median([timed(lambda _: arithmetic(ROUNDS), i) for i in range(200)]) * ROUNDS)
    read = np.ones(sum(table.nbytes for table in corrector.law.learned.predictor.tables) // 8)
    return {
        "nothing": lambda _: arithmetic(0),
        "arithmetic as long": lambda _: arithmetic(as_long),
        "reading as much": lambda _: reading(read),
    }


@njit
def arithmetic(rounds: int) -> float:
    total = 0.0
    for i in range(rounds):
        total = 0.999999 * total + i
    return total


@njit(fastmath=True)
def reading(values: FloatArray) -> float:
    total = 0.0
    for i in range(len(values)):
        total += values[i]
    return total


def same_kernels(corrector: CommandCorrector) -> list[GaussianProcessRegressor]:
    peers = []
    for part in corrector.law.learned.predictor.parts:
        kernel = WhiteKernel(0.1)
        for weight, scales in zip(part.kernel.weights, part.kernel.length_scales, strict=True):
            kernel += ConstantKernel(weight) * RBF(np.minimum(scales, UNSEEN))
        peers.append(peer(kernel, part.basis, corrector.law.learned.predictor.mean_std_batch(part.basis)[0][:, :3]))
    return peers


def plain_kernels(corrector: CommandCorrector, *, apart: bool) -> list[GaussianProcessRegressor]:
    part = corrector.law.learned.predictor.parts[0]
    outputs = corrector.law.learned.predictor.mean_std_batch(part.basis)[0]
    kernel = RBF(part.kernel.length_scales[-1]) + WhiteKernel(0.1)
    return [peer(kernel, part.basis, column) for column in (outputs.T if apart else [outputs])]


def peer(kernel: Kernel, X: FloatArray, Y: FloatArray) -> GaussianProcessRegressor:
    return GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True).fit(X, Y)


def peer_call(peers: list[GaussianProcessRegressor]) -> Call:
    X = peers[0].X_train_
    return lambda i: [one.predict(X[[i % len(X)]], return_std=True) for one in peers]


def measure(calls: dict[str, tuple[Call, int]], count: int) -> list[Sequence[str | float]]:
    """Microseconds of each call: median, 90th and 99th percentile and their ratio; and of the first in each block."""
    elapsed: dict[str, list[float]] = {name: [] for name in calls}
    first: dict[str, list[float]] = {name: [] for name in calls}
    with threadpool_limits(1):
        for block in range(BLOCKS + 1):
            for name, (call, share) in calls.items():
                times = [timed(call, i) for i in range(1 + count * share // (10 * BLOCKS))]
                if block:  # the very first block warms up
                    first[name].append(times[0])
                    elapsed[name] += times[1:]
    rows: list[Sequence[str | float]] = []
    for name, times in elapsed.items():
        median, p90, p99 = np.percentile(times, [50, 90, 99])
        rows.append([name, median, p90, p99, p99 / median, float(np.median(first[name]))])
    return rows


def timed(call: Call, index: int) -> float:
    start = time.perf_counter_ns()
    call(index)
    return (time.perf_counter_ns() - start) / 1e3


if __name__ == "__main__":
    main()
